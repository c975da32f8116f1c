"""The evaluator's side of a guest: its process, its limits, and what it may ask for.

A guest computes scores and answers; the evaluator counts its windows, frames, travel and time, and compares. Whatever
the guest does, the worst that can happen is that its own runs fail.
"""

import atexit
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, Protocol, Self

import numpy as np

from saf_gen.benchmark.guests.wire import MessageReader, write_message_within
from saf_gen.benchmark.records import OVER_A_LIMIT
from saf_gen.benchmark.view.restricted_view import BudgetSpentError, MeteredScorer
from saf_gen.core.child import SharedMemory
from saf_gen.core.finding import Finding
from saf_gen.errors import BadInput
from saf_gen.parts import View
from saf_gen.stream.measure_input import Form

PROGRAM = "saf_gen.benchmark.guests.process"
KEPT_VARIABLES = (
    *("PATH", "LANG", "LC_", "TZ", "LD_LIBRARY_PATH", "DYLD_", "VIRTUAL_ENV", "CONDA_", "SYSTEMROOT", "WINDIR"),
    *("PROCESSOR_", "CUDA_", "NVIDIA_", "OMP_", "MKL_", "OPENBLAS_", "NUMBA_"),
)
"""Beginnings of the names of environment variables that a guest gets; all others, such as keys, it does not get."""
WATCH_S = 0.1
"""Time between two looks at the memory of a guest that is computing."""
SEND_S = 5.0
"""Time within which a guest reads a message."""
PINGS = 11
"""Messages that are sent to measure how long one takes, and once more for each size of image."""
FORMS = ("counts", "halves", "intervals", "polarities")
MIN_RESIDENT_BYTES = 1 << 28
"""Lowest limit of memory: Python, numpy and this package take a third of it."""
MAX_OPENED, MAX_PATH_CHARACTERS = 1_000, 4_096
"""Number of files that a guest opens late, and length of their paths, of which account is kept."""
MAX_TAIL_BYTES = 2_000
"""Bytes that are kept of what a guest prints."""
MARK = "SAF_GEN_GUEST"
"""Environment variable by which the processes that a guest starts are found."""


@dataclass(frozen=True)
class Limits:
    """What a guest may use: seconds to load, seconds on a sequence, and bytes of resident memory."""

    load_s: float = 120.0
    run_s: float = 60.0
    resident_bytes: int = 2 << 30

    def __post_init__(self) -> None:
        if not self.run_s > 0:
            raise BadInput(f"the limit is {self.run_s:g} s", allowed="seconds, above 0")
        if self.resident_bytes < MIN_RESIDENT_BYTES:
            raise BadInput(f"the limit is {self.resident_bytes / (1 << 30):g} GiB of memory", allowed="0.25 and above")

    def __str__(self) -> str:
        return f"{self.run_s:g} s, {self.resident_bytes >> 20:,} MiB"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the limits that were written as this text; raise BadInput if they were not."""
        match = re.fullmatch(r"(\d{1,6}(?:\.\d{1,6})?) s, (\d[\d,]{1,9}) MiB", text, re.ASCII)
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
    """A process that has loaded one method, or plug-ins to check.

    Parameters
    ----------
    order : dict
        What its program loads: names with their options and with absolute paths.
    folders : sequence of str
        Folders whose modules the method may import.
    limits : Limits
        What it may use.
    program : str, optional
        Module that it runs.
    hear : callable, optional
        Called with what the plug-ins print.

    Attributes
    ----------
    hello : dict
        What it said of its method.
    opened : list of str
        Paths of the files that it opened after it had loaded its method, MAX_OPENED at most.

    Raises
    ------
    BadInput
        If the method cannot be loaded.
    GuestLost
        If it ends while it loads, or takes too long.
    """

    def __init__(
        self,
        order: dict[str, Any],
        folders: list[str],
        *,
        limits: Limits,
        program: str = PROGRAM,
        hear: Callable[[str], object] = lambda said: None,
    ) -> None:
        self._hear = hear
        self._limits, self._run, self._tail, self._checked, self._closed = limits, 0, b"", 0.0, False
        self.opened: list[str] = []
        self._folder = Path(tempfile.mkdtemp(prefix="saf-gen-guest-"))
        self._memory = SharedMemory.create(self._folder)
        inherited = [self._memory.descriptor] if self._memory.descriptor >= 0 else []
        work = self._folder / "work"
        work.mkdir()
        longest_s = max(limits.load_s, limits.run_s)
        command = [sys.executable, "-P", "-m", program, str(self._memory.descriptor), self._memory.path, str(longest_s)]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                cwd=work,
                env=_environment(self._folder),
                pass_fds=inherited,
                start_new_session=True,
            )
        except OSError as error:
            self._memory.close()
            shutil.rmtree(self._folder, ignore_errors=True)
            raise GuestLost(f"its process cannot be started: {error.strerror or error}") from error
        atexit.register(self.close)
        self._incoming = MessageReader(self._process.stdout)  # type: ignore[arg-type]
        self._drainer = threading.Thread(target=self._drain, daemon=True)
        self._drainer.start()
        try:
            self._send({**order, "folders": folders})
            self.hello, _ = self._receive(limits.load_s, "load")
            if "refused" in self.hello:
                raise BadInput(**{key: str(text) for key, text in self.hello["refused"].items()})
            if "broken" in self.hello:
                raise GuestLost(str(self.hello["broken"]))
            self._ping_s: dict[tuple[int, ...], float] = {(): self._ping({"ping": 1})}  # by the shape of an image
        except BaseException:
            self.close()
            raise

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def run(self, view: GuestView, scorer: MeteredScorer, *, stream_path: str = "") -> dict[str, Any]:
        """Let the method search in a view, and return its last message.

        Its time is added to ``scorer``: from each reply to the next request, less what an empty message takes.

        Raises GuestLost, BudgetSpentError, and BadInput if the file ``stream_path`` cannot be read.
        """
        self._run += 1
        left = self._limits.run_s
        known = view.positions(0)
        message: dict[str, Any] = {"start": self._run, "now": view.now, "positions": self._memory.write(known)}
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
            used = max(arrived - sent - self._ping_s[shape], 0.0)
            left -= used
            if spent is None:
                scorer.add_seconds(used)
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
                            self._ping_s[shape] = self._ping({"ping": 1, **message})
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
        self._send({"rate": frames, "start": self._run, **self._memory.write(image)})
        reply, _ = self._receive(self._limits.run_s, "answer")
        if "refused" in reply:
            raise BadInput(**{key: str(text) for key, text in reply["refused"].items()})
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
                return {"now": view.now, **self._memory.write(image)}
            if "position" in request:
                position = view.position(request["position"])
                return {"position": position, "positions": self._memory.write(view.positions(int(request["known"])))}
            if "move" in request:
                view.move(float(request["move"]))
                return {"now": view.now}
            if "wait" in request:
                view.wait(float(request["wait"]))  # type: ignore[arg-type]
                return {"now": view.now}
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise GuestLost(f"its process sent a request that is wrong: {type(error).__name__}") from error
        raise GuestLost("its process sent what is no request")

    def _ping(self, message: dict[str, Any]) -> float:
        """Return the time, in seconds, that a message takes to the guest and back."""
        times = []
        for _ in range(PINGS):
            sent = self._send(message)
            times.append(self._receive(self._limits.load_s, "load")[1] - sent)
        return median(times)

    def _send(self, message: dict[str, Any]) -> float:
        """Send a message, and return the time just before; raises GuestLost if the guest does not read."""
        sent = perf_counter()
        with suppress(OSError, ValueError):  # that the guest is gone is found when it is waited for
            if not write_message_within(self._process.stdin, message, seconds=SEND_S):  # type: ignore[arg-type]
                raise self._lost("its process does not read the replies to its requests")
        return sent

    def _receive(self, seconds: float, doing: str) -> tuple[dict[str, Any], float]:
        """Return the next message and the time at which it came; raises GuestLost at a limit or at the end."""
        deadline = perf_counter() + seconds
        while True:
            wait = min(WATCH_S, max(deadline - perf_counter(), 0.0))
            if not self._incoming.wait(wait):
                self._check_memory()
                if perf_counter() >= deadline:
                    raise self._over_time(doing)
                continue
            arrived = perf_counter()
            try:
                message = self._incoming.read()
            except ValueError as error:
                raise self._lost(f"its process sent {error}") from error
            if message is None:
                raise self._lost("")
            if arrived - self._checked >= WATCH_S:  # a guest that asks all the time is watched, too
                self._check_memory()
            if "opened" not in message:
                return message, arrived
            if len(self.opened) < MAX_OPENED:
                self.opened.append(str(message["opened"])[:MAX_PATH_CHARACTERS])
            if arrived >= deadline:
                raise self._over_time(doing)

    def _over_time(self, doing: str) -> GuestLost:
        limit = self._limits.load_s if doing == "load" else self._limits.run_s
        return self._lost(f"{OVER_A_LIMIT}it did not {doing} within {limit:g} s")

    def _check_memory(self) -> None:
        self._checked, allowed = perf_counter(), self._limits.resident_bytes
        if (resident := resident_bytes(self._process.pid)) > allowed:
            raise self._lost(f"{OVER_A_LIMIT}it used {resident >> 20:,} MiB of memory; allowed: {allowed >> 20:,} MiB")

    def _lost(self, why: str) -> GuestLost:
        """End the process, and return the error that says why it is lost."""
        if not why:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)
            why = f"its process {_describe_end(self._process.poll())}"
        self.close()
        said = self._tail.decode(errors="replace").strip().splitlines()
        return GuestLost(why + (f"; it said: {said[-1].strip()[:200]}" if said else ""))

    def _drain(self) -> None:
        with self._process.stderr as pipe, suppress(OSError):  # type: ignore[union-attr]
            while said := os.read(pipe.fileno(), 1 << 16):
                self._tail = (self._tail + said)[-MAX_TAIL_BYTES:]
                self._hear(said.decode(errors="replace"))

    def close(self) -> None:
        """End the process and everything that it started, and delete its folder."""
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        _end_tree(self._process, self._folder)
        self._drainer.join(1.0)
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        self._memory.close()
        shutil.rmtree(self._folder, ignore_errors=True)


def _environment(folder: Path) -> dict[str, str]:
    """Return the environment of a guest, in which it finds this package and a home and temporary folder of its own."""
    kept = {name: text for name, text in os.environ.items() if name.upper().startswith(KEPT_VARIABLES)}
    paths = [str(Path(path).absolute()) for path in sys.path]  # '' is the working folder
    own = dict.fromkeys(("HOME", "USERPROFILE", "TMPDIR", "TEMP", "TMP"), str(folder / "work"))
    python = {"PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
    return kept | python | own | {MARK: str(folder)}


def _describe_end(code: int | None) -> str:
    if code is None:
        return "closed its wire to the evaluator"
    if code >= 0:
        return f"ended with exit code {code}"
    names = {number.value: number.name for number in signal.Signals}
    return f"was ended by signal {-code} ({names.get(-code, 'unknown')})"


def resident_bytes(process: int) -> int:
    """Return the resident memory of a process and of all that it started, in bytes; 0 where /proc does not tell."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except (OSError, IndexError, ValueError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE") + sum(resident_bytes(int(child)) for child in children)


def _end_tree(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Kill a guest, its process group, and the processes with its mark in their environment."""
    if hasattr(os, "killpg"):
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()
    end_marked(folder)


def end_marked(folder: Path) -> None:
    """Kill the processes that a guest with this folder started, but not this one."""
    mark = f"{MARK}={folder}".encode()
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if mark in environment.read_bytes().split(b"\0") and int(environment.parent.name) != os.getpid():
                os.kill(int(environment.parent.name), signal.SIGKILL)
