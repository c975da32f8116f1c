"""A policy as a method of the contest: run over every sequence, judged and written down like the others."""

import hashlib
import inspect
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np

from saf_gen.contest.answer import told
from saf_gen.contest.jobs import given, light_of
from saf_gen.contest.loop import Run
from saf_gen.dataset import write_text
from saf_gen.errors import BadInput
from saf_gen.gym.env import AutofocusEnv
from saf_gen.records import FILE, Record, records_to_text
from saf_gen.rig import Counts
from saf_gen.stream import open_stream

__all__ = ["Policy", "rollout"]

Policy = Callable[[dict[str, np.ndarray]], np.ndarray | None]
"""An observation in, an action out; None abstains."""
NAME = r"[A-Za-z0-9][A-Za-z0-9_.:=,+-]{0,79}"


def rollout(
    env: gymnasium.Env[Any, Any],
    make_policy: Callable[[], Policy],
    method: str,
    *,
    code: str = "",
    out: str | Path | None = None,
) -> list[Record]:
    """Run a policy over every sequence of an environment, as the contest would: a record each.

    The lens begins where it does for every method, the noise is that of the recording, the verdict that of
    the contest. A policy that breaks fails on that sequence, as a search does; None for an action abstains.

    Parameters
    ----------
    env : an :class:`AutofocusEnv`, in wrappers of any kind: the policy sees and acts through them.
    make_policy : called for each sequence, so that nothing is carried over from one to the next.
    method : the name in the leaderboard.
    code : which version of the policy it is. Learned weights need one: '' is a digest of the source of the
        module that ``make_policy`` is defined in, which they are not part of.
    out : a folder; ``records.jsonl`` is written there, for ``saf-gen leaderboard``.

    ``windows`` of a record is the number of images, ``seconds`` the time that the policy took. Raises
    BadInput for a name that is not allowed, for a source that cannot be read, for what the environment
    refuses, and for stacks that cannot be filmed.
    """
    inner = env.unwrapped
    if not isinstance(inner, AutofocusEnv):
        raise BadInput(f"the environment is {inner!r:.60}", allowed="an AutofocusEnv, in wrappers or without")
    if not re.fullmatch(NAME, method):
        raise BadInput(f"the method is called {method!r:.90}", allowed="1 to 80 of A-Z a-z 0-9 _ . : = , + -")
    code = code or _source_digest(make_policy, inner.parameters)
    records = []
    for job in inner.jobs:
        setting = inner.setting(job)
        with open_stream(job.path) as stream:
            light = light_of(Counts(stream, region=setting.box))
            said = given(job, stream, light, "closed_loop", frames=inner.terms.frames(setting.take)[0])
        run = _run(env, inner, make_policy, job.id)
        records.append(
            setting.record(run, inner.terms, method=method, code=code, parameters=inner.parameters, said=said)
        )
    if out is not None:
        write_text(Path(out) / FILE, records_to_text(records))
    return records


def _run(
    env: gymnasium.Env[Any, Any], inner: AutofocusEnv, make_policy: Callable[[], Policy], sequence: str
) -> Run:
    seen, _ = env.reset(options={"sequence": sequence})
    episode, seconds, over = inner.episode, 0.0, False
    try:
        policy = make_policy()
        while not over:
            begin = perf_counter()
            action = policy(seen)
            seconds += perf_counter() - begin
            if action is None:
                episode.abstain()
                break
            seen, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
        if episode.run is None:
            episode.fail("a wrapper of the environment ended the episode")
    except Exception as error:  # noqa: BLE001 anybody's policy may raise anything; fail() raises what is ours
        episode.fail(told(error))
    run = episode.run
    if run is None:
        raise RuntimeError("an episode ended without a run")
    return replace(run, windows=episode.looks, seconds=seconds)


def _source_digest(make_policy: Callable[[], Policy], parameters: str) -> str:
    """12 digits of a sha256 over the source of the module in which a policy is defined, and what it sees."""
    module = sys.modules.get(getattr(make_policy, "__module__", ""))
    try:
        source = inspect.getsource(module) if module else ""
    except (OSError, TypeError):
        source = ""
    if not source:
        raise BadInput(
            f"the source of the policy {make_policy!r:.60} cannot be read",
            hint="say which version it is: code='1'",
        )
    name = getattr(make_policy, "__qualname__", "")
    return hashlib.sha256("\n".join([name, parameters, source]).encode()).hexdigest()[:12]
