"""How long a search that commands the lens takes, found by a rehearsal in front of a target without noise."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.clock import Clock
from saf_gen.benchmark.view.restricted_view import BudgetSpentError
from saf_gen.benchmark.view.running_camera import RunningCamera
from saf_gen.errors import SafGenError
from saf_gen.optics.actuators import Actuator
from saf_gen.parts import Search, commands
from saf_gen.stream.stream_file import open_stream

START, FOCUS, WIDTH = 0.2, 0.6, 0.08
LONGEST_S = 10.0
BOARD = np.where(np.indices((8, 8)).sum(axis=0) % 2, 1, -1)


class _Board:
    """Frames of a board whose contrast is a bell over the lens positions; stands in for the captured frames."""

    textures_s = 0.0

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        self._position = position

    def window(self, first: int, stop: int) -> np.ndarray:
        bell = 1 / (1 + ((self._position[first:stop].mean() - FOCUS) / WIDTH) ** 2)
        counts: np.ndarray = np.rint(1e6 * (1 + 0.9 * bell * BOARD)).astype(np.uint32)
        return counts


def seconds_needed(search: Search, actuator: Actuator, *, readout_hz: float) -> float:
    """Return the seconds that a search takes to its answer and the lens to that; infinity if over LONGEST_S.

    Computing takes no time here, and the lens has no scatter. Raises what the search raises.
    """
    board: Any = _Board()
    camera = RunningCamera(
        board,
        lambda counts: float(counts.std()),
        actuator=replace(actuator, place_rms=0.0),
        start=START,
        seed=0,
        budget=math.ceil(LONGEST_S * readout_hz),
        clock=Clock(readout_hz),
    )
    try:
        answer = search(camera)
        if answer.position is not None:
            camera.move(min(max(answer.position, 0.0), 1.0))
            camera.settle()
    except BudgetSpentError:
        return math.inf
    return math.inf if "out of frames" in answer.note else camera.now / readout_hz


def describe_short_budget(path: str | Path, methods: Iterable[Method], *, protocol: ClosedLoopProtocol) -> str:
    """Return a line that names the searches that need more time than the budget on a stream, or ''.

    It names searches of saf_gen that command the lens. A stream that cannot be read is not described here.
    """
    searches = {m.search_name: m.search for m in methods if commands(m.search) and _is_shipped(m.search)}
    if not searches:
        return ""
    try:
        with open_stream(path) as stream:
            hz, frames = stream.readout_hz, stream.shape[0]
    except SafGenError:
        return ""
    budget_s = protocol.budget_s or protocol.usual_frames(frames, Clock(hz)) / hz
    needed = {name: seconds_needed(search, protocol.actuator, readout_hz=hz) for name, search in searches.items()}
    short = [
        f"{name} needs {'over ' if seconds == math.inf else ''}{1e3 * min(seconds, LONGEST_S):.0f}"
        for name, seconds in needed.items()
        if seconds > budget_s
    ]
    if not short:
        return ""
    wanted = math.ceil(10 * min(max(needed.values()), LONGEST_S)) * 100
    return f"{1e3 * budget_s:g} ms with {protocol.actuator.label}: {', '.join(short)}; for example --budget {wanted}"


def _is_shipped(search: Search) -> bool:
    """Return whether a search is part of saf_gen; one of others may do anything, and is a guest."""
    return type(search).__module__.startswith("saf_gen.plugins.searches.")
