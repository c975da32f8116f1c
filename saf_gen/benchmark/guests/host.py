"""The evaluator's side of a guest: its process, its limits, and what it may ask for.

A guest computes scores and answers; the evaluator counts its windows, frames, travel and time, and compares. Whatever
the guest does, the worst that can happen is that its own runs fail.
"""

import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, Protocol, Self

import numpy as np

from saf_gen.benchmark.guests.process import MAX_MESSAGE_BYTES, to_json
from saf_gen.benchmark.guests.reach import reach_of
from saf_gen.benchmark.records import OVER_A_LIMIT
from saf_gen.benchmark.view.restricted_view import BudgetSpentError, MeteredScorer
from saf_gen.core.child import Child, ChildLost, SharedMemory
from saf_gen.core.finding import Finding
from saf_gen.errors import BadInput
from saf_gen.parts import View
from saf_gen.stream.measure_input import Form

PROGRAM = "saf_gen.benchmark.guests.process:serve"
KEPT_VARIABLES = (
    *("PATH", "LANG", "LC_", "TZ", "LD_LIBRARY_PATH", "DYLD_", "VIRTUAL_ENV", "CONDA_", "SYSTEMROOT", "WINDIR"),
    *("PROCESSOR_", "CUDA_", "NVIDIA_", "OMP_", "MKL_", "OPENBLAS_", "NUMBA_"),
)
"""Beginnings of the names of environment variables that a guest gets; all others, such as keys, it does not get."""
WATCH_S = 0.1
"""Time between two looks at the memory of a guest that is computing."""
PINGS = 11
"""Messages that are sent to measure how long one takes, and once more for each size of image."""
MAX_TRIP_S, MIN_COPY_BYTES_PER_S = 2e-3, 1e9
"""Longest time of an empty message, and lowest speed of an image, that a guest is not charged for."""
FORMS = ("counts", "halves", "intervals", "polarities")
MIN_RESIDENT_BYTES = 1 << 28
"""Lowest limit of memory: Python, numpy and this package take a third of it."""
MAX_FILE_BYTES = 1 << 30
"""Largest file that a guest may write."""
MAX_TAIL_BYTES = 2_000
"""Bytes that are kept of what a guest prints."""


@dataclass(frozen=True)
class Limits:
    """What a guest may use: seconds to load, seconds on a sequence, and bytes of resident memory."""

    load_s: float = 120.0
    run_s: float = 60.0
    resident_bytes: int = 2 << 30
    landlock: int | None = field(default=None, compare=False)
    """Version of Landlock that shuts the guest in, 0 for none; None for a guest that has not started."""

    def __post_init__(self) -> None:
        if not self.run_s > 0:
            raise BadInput(f"the limit is {self.run_s:g} s", allowed="seconds, above 0")
        if self.resident_bytes < MIN_RESIDENT_BYTES:
            raise BadInput(f"the limit is {self.resident_bytes / (1 << 30):g} GiB of memory", allowed="0.25 and above")

    def __str__(self) -> str:
        shut_in = "" if self.landlock is None else f", Landlock {self.landlock}"
        return f"{self.run_s:g} s, {self.resident_bytes >> 20:,} MiB{shut_in}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the limits that were written as this text; raise BadInput if they were not."""
        match = re.fullmatch(r"(\d{1,6}(?:\.\d{1,6})?) s, (\d[\d,]{1,9}) MiB(, Landlock \d+)?", text, re.ASCII)
        if not match:
            raise BadInput(f"the limits are {text!r:.60}", allowed=f"seconds and memory, such as {str(cls())!r}")
        return cls(run_s=float(match[1]), resident_bytes=int(match[2].replace(",", "")) << 20)


class GuestView(View, Protocol):
    """A view that gives images to a guest, which scores them itself."""

    def image(self, form: Form, *, first: int, stop: int) -> np.ndarray:
        """Return a window as a measure is called with it."""
        ...

    def positions(self, first: int) -> np.ndarray:
        """Return the lens positions of all frames from ``first`` that have passed, float64 (n,)."""
        ...


class GuestLost(Exception):
    """Error for a guest that has ended, was ended at a limit, or sent nonsense."""


@dataclass(frozen=True)
class GuestPart:
    """What the evaluator knows of the measure or the search of a guest."""

    text: str
    intervals: bool = False
    commands: bool = False
    polarities: bool = False
    measures: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return self.text


class GuestProcess:
    """A process for one method, or for plug-ins to check.

    Parameters
    ----------
    order : dict
        What its program loads: names with their options and with absolute paths.
    folders : sequence of str
        Folders whose modules the method may import.
    files : sequence of str
        Files that the names and options name.
    limits : Limits
        What it may use.
    program : str, optional
        Function that it runs.
    on_output : callable, optional
        Called with what the plug-ins print.

    Attributes
    ----------
    landlock : int
        Version of Landlock that shuts it in, 0 for none.
    files : list of (str, str)
        Name and digest of each file that the method read while it was loaded; those of the files that the user named
        are known before any code of the method runs.

    Raises
    ------
    GuestLost
        If the system does not start it.
    """

    def __init__(
        self,
        order: dict[str, Any],
        folders: Sequence[str],
        *,
        files: Sequence[str],
        limits: Limits,
        program: str = PROGRAM,
        on_output: Callable[[str], object] = lambda text: None,
    ) -> None:
        self._on_output, self._limits, self._run, self._tail, self._checked = on_output, limits, 0, b"", 0.0
        self._ping_s = dict[tuple[int, ...], float]()  # by the shape of an image
        self.files = list[list[str]]()
        folder = Path(tempfile.mkdtemp(prefix="saf-gen-guest-"))
        (folder / "work").mkdir()
        self._memory = SharedMemory.create(folder)
        try:
            self._child = Child(
                program,
                max_bytes=MAX_MESSAGE_BYTES,
                environment=_environment(folder),
                folder=folder,
                memory=self._memory,
                file_bytes=MAX_FILE_BYTES,
                reach=reach_of(folders, files, own=folder),
                on_output=self._note,
            )
        except OSError as error:
            self._memory.close()
            shutil.rmtree(folder)
            raise GuestLost(f"its process cannot be started: {error.strerror or error}") from error
        self.landlock, memory = self._child.landlock(), (self._memory.descriptor, self._memory.path)
        self._send({**order, "folders": [*folders], "files": [*files], "memory": memory})

    def load(self) -> dict[str, Any]:
        """Return the message in which it describes what it has loaded.

        Raises GuestLost if it ends while it loads, or takes too long, and BadInput if the method cannot be loaded.
        """
        deadline = perf_counter() + self._limits.load_s
        self.files = _read_digests(self._receive(self._limits.load_s, "load")[0])
        message, _ = self._receive(deadline - perf_counter(), "load")
        if "refused" in message:
            raise _refusal(message)
        if "broken" in message:
            raise GuestLost(str(message["broken"]))
        if "files" in message:  # it states what it read besides, but cannot unsay what it was
            files = _read_digests(message)
            if not {digest for _, digest in self.files} <= {digest for _, digest in files}:
                raise GuestLost("its process sent nonsense")
            self.files = files
        self._ping_s[()] = self._ping({"ping": 1}, nbytes=0, deadline=deadline, doing="load")
        return message

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._child.alive

    def digests(self) -> list[list[str]]:
        """Return the names and digests of the files of its method as they are now; raises GuestLost."""
        self._run += 1
        self._send({"digests": 1, "start": self._run})
        return _read_digests(self._receive(self._limits.load_s, "load")[0])

    def run(self, view: GuestView, scorer: MeteredScorer, *, stream_path: str = "") -> dict[str, Any]:
        """Let the method search in a view, and return its last message.

        Its time is added to ``scorer``: from each reply to the next request, less what an empty message takes.

        Raises GuestLost, BudgetSpentError, and BadInput if the file ``stream_path`` cannot be read.
        """
        self._run += 1
        left = self._limits.run_s
        known = view.positions(0)
        message: dict[str, Any] = {"start": self._run, "now": view.now, "positions": self._write(known)}
        message |= {"frames": view.frames, "readout_hz": view.readout_hz, "lag_s": view.lag_s}
        spent: BudgetSpentError | None = None
        shape: tuple[int, ...] = ()  # of the image in the message
        while True:
            sent = self._send(message)
            try:
                request, arrived = self._receive(left, "answer")
            except GuestLost:
                if spent is not None:
                    raise spent from None
                raise
            left -= arrived - sent
            if spent is None:
                scorer.add_seconds(max(arrived - sent - self._ping_s[shape], 0.0))
            if request.get("run") != self._run:
                raise GuestLost("its process sent what nobody had asked for")
            if "answer" in request:
                if spent is not None:
                    raise spent
                return request
            if spent is None:
                try:
                    message, shape = self._reply(request, view), ()
                    if "shape" in message:
                        shape = tuple(message["shape"])
                        if shape not in self._ping_s:
                            ping = {"ping": 1, **message}
                            nbytes = np.dtype(message["dtype"]).itemsize * int(np.prod(shape))
                            deadline = perf_counter() + left
                            self._ping_s[shape] = self._ping(ping, nbytes=nbytes, deadline=deadline, doing="answer")
                            left = deadline - perf_counter()
                    continue
                except BudgetSpentError as error:
                    spent = error
                except BadInput as error:
                    if stream_path and error.where == stream_path:
                        raise
                    keys = ("problem", "allowed", "nearest", "hint", "where")
                    message, shape = {"refused": {key: getattr(error, key) for key in keys}}, ()
                    continue
            shape = ()
            message, left = {"spent": str(spent)}, min(left, 1.0)  # it may tidy up, but its run is over

    def rate(self, image: np.ndarray, *, frames: int) -> float:
        """Return the score of a window of so many frames by the guest's measure.

        Raises GuestLost, also if the measure raises an error, and BadInput if it does.
        """
        self._run += 1
        self._send({"rate": frames, "start": self._run, **self._write(image)})
        reply, _ = self._receive(self._limits.run_s, "answer")
        if "refused" in reply:
            raise _refusal(reply)
        score = reply.get("score")
        if not isinstance(score, float):
            raise GuestLost(str(reply.get("problem", "its process sent a score that is none")))
        return score

    def check(self) -> Iterator[Finding]:
        """Run the checks of what the guest has loaded, and yield their results; raises GuestLost."""
        self._send({"start": 0})
        while "end" not in (message := self._receive(self._limits.run_s, "answer")[0]):
            try:
                yield Finding(**{key: str(text) for key, text in message["finding"].items()})  # type: ignore[arg-type]
            except (KeyError, TypeError, AttributeError) as error:
                raise GuestLost("its process sent a finding that is none") from error

    def _reply(self, request: dict[str, Any], view: GuestView) -> dict[str, Any]:
        try:
            if "image" in request:
                form = request["image"]
                if form not in FORMS:
                    raise GuestLost(f"its process asked for an image of the form {form!r:.40}")
                first, stop = request["first"], request["stop"]
                seen = form == "polarities"
                image = view.polarities(first, stop) if seen else view.image(form, first=first, stop=stop)
                return {"now": view.now, **self._write(image)}
            if "position" in request:
                position = view.position(request["position"])
                return {"position": position, "positions": self._write(view.positions(int(request["known"])))}
            if "move" in request:
                view.move(float(request["move"]))
                return {"now": view.now}
            if "wait" in request:
                view.wait(float(request["wait"]))  # type: ignore[arg-type]
                return {"now": view.now}
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise GuestLost(f"its process sent a request that is wrong: {type(error).__name__}") from error
        raise GuestLost("its process sent what is no request")

    def _write(self, array: np.ndarray) -> dict[str, Any]:
        try:
            return self._memory.write(array)
        except (OSError, ValueError) as error:
            raise self._lost(f"its process has spoilt the memory for images: {error}") from error

    def _ping(self, message: dict[str, Any], *, nbytes: int, deadline: float, doing: str) -> float:
        """Return the time, in seconds, that a message with an image takes to the guest and back, as far as it may."""
        times = []
        for _ in range(PINGS):
            sent = self._send(message)
            times.append(self._receive(deadline - perf_counter(), doing)[1] - sent)
        return min(median(times), MAX_TRIP_S + nbytes / MIN_COPY_BYTES_PER_S)

    def _send(self, message: dict[str, Any]) -> float:
        """Send a message, and return the time just before; raises GuestLost if the guest does not read."""
        sent = perf_counter()
        try:
            self._child.send(to_json(message).encode())
        except ChildLost as lost:
            raise self._lost(f"its process {lost}") from lost
        return sent

    def _receive(self, seconds: float, doing: str) -> tuple[dict[str, Any], float]:
        """Return the next message and the time at which it came; raises GuestLost at a limit or at the end."""
        deadline = perf_counter() + seconds
        data = None
        while data is None:
            try:
                data = self._child.receive(min(WATCH_S, max(deadline - perf_counter(), 0.0)))
            except ChildLost as lost:
                raise self._lost(f"its process {lost}") from lost
            arrived = perf_counter()
            if arrived - self._checked >= WATCH_S:  # a guest that asks all the time is watched, too
                self._checked, allowed = arrived, self._limits.resident_bytes
                if (used := self._child.resident_bytes()) > allowed:
                    limit = f"allowed: {allowed >> 20:,} MiB"
                    raise self._lost(f"{OVER_A_LIMIT}it used {used >> 20:,} MiB of memory; {limit}")
            if data is None and arrived >= deadline:
                limit_s = self._limits.load_s if doing == "load" else self._limits.run_s
                raise self._lost(f"{OVER_A_LIMIT}it did not {doing} within {limit_s:g} s")
        try:
            message = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise self._lost("its process sent a message that is not JSON") from error
        if not isinstance(message, dict):
            raise self._lost("its process sent a message that is not a JSON object")
        return message, arrived

    def _lost(self, why: str) -> GuestLost:
        """End the process, and return the error that says why it is lost."""
        self.close()
        said = self._tail.decode(errors="replace").strip().splitlines()
        return GuestLost(why + (f"; it said: {said[-1].strip()[:200]}" if said else ""))

    def _note(self, said: bytes) -> None:
        self._tail = (self._tail + said)[-MAX_TAIL_BYTES:]
        self._on_output(said.decode(errors="replace"))

    def close(self) -> None:
        """End the process and everything that it started, and delete its folder."""
        self._child.close()
        self._memory.close()


def _read_digests(message: dict[str, Any]) -> list[list[str]]:
    """Return the names and digests of files in a message; raises GuestLost if there are none."""
    try:
        return [[str(name), str(digest)] for name, digest in message["files"]]
    except (KeyError, TypeError, ValueError) as error:
        raise GuestLost("its process sent nonsense") from error


def _refusal(message: dict[str, Any]) -> BadInput:
    """Return the error that a guest raised; raises GuestLost if the message states none."""
    keys = ("problem", "allowed", "nearest", "hint", "where")
    try:
        return BadInput(**{key: str(message["refused"][key]) for key in keys})
    except (KeyError, TypeError) as error:
        raise GuestLost("its process sent nonsense") from error


def _environment(folder: Path) -> dict[str, str]:
    """Return the environment of a guest, with a home and temporary folder, and a place for kernels, of its own."""
    kept = {name: text for name, text in os.environ.items() if name.upper().startswith(KEPT_VARIABLES)}
    own = dict.fromkeys(("HOME", "USERPROFILE", "TMPDIR", "TEMP", "TMP"), str(folder / "work"))
    return kept | own | {"PYTHONDONTWRITEBYTECODE": "1", "NUMBA_CACHE_DIR": str(folder / "kernels")}
