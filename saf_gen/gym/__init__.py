"""The closed loop as a Gymnasium environment, ``saf_gen/Autofocus-v0``; needs the extra ``gym``.

The id carries a version: where what a policy sees or earns changes, it counts up.
"""

from saf_gen.errors import BadInput

try:
    import gymnasium
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    raise BadInput("saf_gen.gym needs the package gymnasium", hint="pip install 'saf-gen[gym]'") from None

from saf_gen.gym.env import ID, AutofocusEnv
from saf_gen.gym.rollout import rollout

__all__ = ["ID", "AutofocusEnv", "rollout"]

gymnasium.register(ID, entry_point="saf_gen.gym.env:AutofocusEnv")
