"""Evaluation of a policy as a method of the benchmark: it runs on every sequence, and each answer is judged."""

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

from saf_gen.benchmark.gym.autofocus_env import AutofocusEnv
from saf_gen.benchmark.judgement import Run
from saf_gen.benchmark.records import RECORDS_FILE, Record, Who, write_records
from saf_gen.benchmark.search_run import describe_exception
from saf_gen.benchmark.tracks.predictions import METHOD_NAME
from saf_gen.core.cores import describe_machine
from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput
from saf_gen.stream.stream_file import open_stream

Policy = Callable[[dict[str, np.ndarray]], np.ndarray | None]
"""A function that turns an observation into an action; None abstains."""


def evaluate_policy(
    env: gymnasium.Env[Any, Any],
    make_policy: Callable[[], Policy],
    *,
    method: str,
    code: str = "",
    out: str | Path | None = None,
) -> list[Record]:
    """Run a policy on every sequence of an environment under the conditions of the benchmark, and return the records.

    The lens starts at the same position as for every method, with the noise of the recording, and the benchmark judges
    the answer. A policy that raises an exception fails on that sequence, like a search; the action None abstains.

    Parameters
    ----------
    env : gymnasium.Env
        An :class:`AutofocusEnv`, in any wrappers; the policy sees and acts through them.
    make_policy : callable
        Returns a policy. It is called for each sequence, so that a policy carries nothing over to the next sequence.
    method : str
        Name in the leaderboard.
    code : str, optional
        Version of the policy, which must be given if weights were learned. By default it is a digest of the source of
        the module that defines ``make_policy``, which does not include weights.
    out : str or Path, optional
        Folder in which ``records.jsonl`` is written, for ``saf-gen leaderboard``.

    Returns
    -------
    list of Record
        One record per sequence. ``windows`` is the number of images, ``seconds`` the time that the policy took.

    Raises
    ------
    BadInput
        If the name is not allowed, if the source or the focal stacks cannot be read, or if the environment raises it.
    """
    inner = env.unwrapped
    if not isinstance(inner, AutofocusEnv):
        raise BadInput(f"the environment is {inner!r:.60}", allowed="an AutofocusEnv, with or without wrappers")
    if not re.fullmatch(METHOD_NAME, method):
        raise BadInput(f"the method is called {method!r:.90}", allowed="1 to 80 of A-Z a-z 0-9 _ . : = , + -")
    code = code or _digest_source(make_policy, inner.parameters)
    records = []
    for task in inner.tasks:
        sequence = inner.load_sequence(task)
        with open_stream(task.path) as stream:
            what = sequence.describe(stream, inner.protocol, region=sequence.region)
        run = _run_policy(env, inner, make_policy=make_policy, sequence=task.id)
        who = Who(method, code, sequence.region, inner.parameters, machine=describe_machine())
        records.append(sequence.make_record(run, who=who, what=what))
    if out is not None:
        write_records(Path(out) / RECORDS_FILE, records)
    return records


def _run_policy(
    env: gymnasium.Env[Any, Any], inner: AutofocusEnv, *, make_policy: Callable[[], Policy], sequence: str
) -> Run:
    observation, _ = env.reset(options={"sequence": sequence})
    episode, seconds, over = inner.episode, 0.0, False
    try:
        with user_code():
            policy = make_policy()
            while not over:
                begin = perf_counter()
                action = policy(observation)
                seconds += perf_counter() - begin
                if action is None:
                    episode.abstain()
                    break
                observation, _, terminated, truncated, _ = env.step(action)
                over = terminated or truncated
            if episode.run is None:
                episode.fail("a wrapper of the environment ended the episode")
    except Exception as error:  # noqa: BLE001 a third-party policy may raise anything
        episode.fail(describe_exception(error))
    run = episode.run
    if run is None:
        raise RuntimeError("an episode ended without a run")
    return replace(run, windows=episode.observations, seconds=seconds)


def _digest_source(make_policy: Callable[[], Policy], parameters: str) -> str:
    """Return 12 digits of a SHA-256 over a policy's name, the observation parameters and the source of its module."""
    module = sys.modules.get(getattr(make_policy, "__module__", ""))
    try:
        source = inspect.getsource(module) if module else ""
    except (OSError, TypeError):
        source = ""
    if not source:
        raise BadInput(
            f"the source of the policy {make_policy!r:.60} cannot be read", hint="state its version, such as code='1'"
        )
    name = getattr(make_policy, "__qualname__", "")
    return hashlib.sha256("\n".join([name, parameters, source]).encode()).hexdigest()[:12]
