"""A policy as a method of the benchmark: run on every sequence, judged and recorded like the others."""

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
from saf_gen.benchmark.records import RECORDS_FILE, Record, write_benchmark_records
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun
from saf_gen.benchmark.tracks.search_run import describe_method_exception
from saf_gen.benchmark.tracks.sequence_tasks import describe_evaluated_sequence, measure_rate_of_evaluated_stream
from saf_gen.benchmark.view import WindowCounts
from saf_gen.errors import BadInput
from saf_gen.stream.stream_file import open_stream

Policy = Callable[[dict[str, np.ndarray]], np.ndarray | None]
"""An observation in, an action out; None abstains."""
NAME = r"[A-Za-z0-9][A-Za-z0-9_.:=,+-]{0,79}"


def evaluate_policy(
    env: gymnasium.Env[Any, Any],
    make_policy: Callable[[], Policy],
    *,
    method: str,
    code: str = "",
    out: str | Path | None = None,
) -> list[Record]:
    """Run a policy on every sequence of an environment, as the benchmark would, and return the records.

    The lens begins where it does for every method, with the noise of the recording, and the benchmark judges
    it. A policy that raises fails on that sequence, as a search does; the action None abstains.

    Parameters
    ----------
    env : an :class:`AutofocusEnv`, in any wrappers; the policy sees and acts through them.
    make_policy : called for each sequence, so that nothing is carried over from one to the next.
    method : the name in the leaderboard.
    code : the version of the policy, which learned weights need. Without it, a digest of the source of the
        module that defines ``make_policy``; weights are not part of that.
    out : a folder where ``records.jsonl`` is written, for ``saf-gen leaderboard``.

    Returns
    -------
    list[Record]
        One per sequence. ``windows`` is the number of images, ``seconds`` the time that the policy took.

    Raises
    ------
    BadInput : for a name that is not allowed, for a source that cannot be read, for what the environment refuses, and
        for focal stacks that cannot be read.
    """
    inner = env.unwrapped
    if not isinstance(inner, AutofocusEnv):
        raise BadInput(f"the environment is {inner!r:.60}", allowed="an AutofocusEnv, in wrappers or without")
    if not re.fullmatch(NAME, method):
        raise BadInput(f"the method is called {method!r:.90}", allowed="1 to 80 of A-Z a-z 0-9 _ . : = , + -")
    code = code or _digest_source(make_policy, inner.parameters)
    records = []
    for task in inner.tasks:
        sequence = inner.load_sequence(task)
        with open_stream(task.path) as stream:
            rate = measure_rate_of_evaluated_stream(WindowCounts(stream, region=sequence.box))
            budget = inner.protocol.count_frames(sequence.capture)[0]
            common = describe_evaluated_sequence(task, stream, rate=rate, track="closed_loop", frames=budget)
        run = _run_policy(env, inner, make_policy=make_policy, sequence=task.id)
        records.append(
            sequence.make_record(
                run, inner.protocol, method=method, code=code, parameters=inner.parameters, common=common
            )
        )
    if out is not None:
        write_benchmark_records(Path(out) / RECORDS_FILE, records)
    return records


def _run_policy(
    env: gymnasium.Env[Any, Any], inner: AutofocusEnv, *, make_policy: Callable[[], Policy], sequence: str
) -> ClosedLoopRun:
    observation, _ = env.reset(options={"sequence": sequence})
    episode, seconds, over = inner.episode, 0.0, False
    try:
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
    except Exception as error:  # noqa: BLE001 anybody's policy may raise anything
        episode.fail(describe_method_exception(error))
    run = episode.run
    if run is None:
        raise RuntimeError("an episode ended without a run")
    return replace(run, windows=episode.observations, seconds=seconds)


def _digest_source(make_policy: Callable[[], Policy], parameters: str) -> str:
    """Return 12 digits of a sha256 over the source of the module that defines a policy, and what it sees."""
    module = sys.modules.get(getattr(make_policy, "__module__", ""))
    try:
        source = inspect.getsource(module) if module else ""
    except (OSError, TypeError):
        source = ""
    if not source:
        raise BadInput(
            f"the source of the policy {make_policy!r:.60} cannot be read", hint="say which version it is: code='1'"
        )
    name = getattr(make_policy, "__qualname__", "")
    return hashlib.sha256("\n".join([name, parameters, source]).encode()).hexdigest()[:12]
