"""The closed loop as a Gymnasium environment; importing this module registers ``saf_gen/Autofocus-v0``.

>>> import gymnasium, saf_gen.benchmark.gym  # doctest: +SKIP
>>> env = gymnasium.make("saf_gen/Autofocus-v0", dataset="datasets/quickstart")  # doctest: +SKIP

The reward is computed from the true focus, and a policy runs in the process that knows it. So this is a place to train
and test your own policies, and none for code of others: that is evaluated as a search, in a process of its own.

This module needs the extra ``gym``. The id ends with a version, which is increased whenever the observations or the
rewards of a policy change.
"""

from saf_gen.errors import BadInput

try:
    import gymnasium
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    raise BadInput("saf_gen.benchmark.gym needs the package gymnasium", hint="pip install 'saf-gen[gym]'") from None

from saf_gen.benchmark.gym.autofocus_env import ENVIRONMENT_ID, AutofocusEnv
from saf_gen.benchmark.gym.policy_evaluation import evaluate_policy

__all__ = ["ENVIRONMENT_ID", "AutofocusEnv", "evaluate_policy"]

gymnasium.register(ENVIRONMENT_ID, entry_point="saf_gen.benchmark.gym.autofocus_env:AutofocusEnv")
