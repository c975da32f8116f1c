"""A method of others: what it is made of, and its runs in a process of its own."""

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.benchmark.guests.host import GuestLost, GuestProcess, GuestView, Limits
from saf_gen.benchmark.records import OVER_A_LIMIT
from saf_gen.benchmark.search_run import answer_fault, to_one_line, to_plain_numbers
from saf_gen.benchmark.view.operations import DeclaredCost, number_or_none
from saf_gen.benchmark.view.restricted_view import BudgetSpentError, MeteredScorer
from saf_gen.errors import BadInput
from saf_gen.parts import Answer

MAX_ALIVE = 32
"""Processes of guests that are kept, each of about 100 MiB. Methods take turns, so of more the last idle one is ended:
the others stay."""


@dataclass(frozen=True)
class GuestSpec:
    """A method as its guest loads it: names and options of measure and search, and the folders of its files."""

    name: str
    measure: tuple[str, dict[str, Any]]
    search: tuple[str, dict[str, Any]]
    files: tuple[str, ...] = ()
    """Absolute paths of the files that the names and options name."""
    folders: tuple[str, ...] = ()
    shown: tuple[tuple[str, str], ...] = field(default=())
    """Absolute paths in the options, each with the spelling of the user, which is what results show."""


class Guest:
    """A method in a process of its own, which is started once, kept, and started again if it ended.

    Parameters
    ----------
    spec : GuestSpec
        The method.
    limits : Limits
        What it may use.

    Attributes
    ----------
    names : tuple of str
        Names of its measure and its search without their options.
    parameters : str
        The measure and the search with every option.
    commands : bool
        Whether its search commands the lens.
    polarities : bool
        Whether its search needs events with their polarities.
    measures : tuple of str
        Names of the measures by which its search finds its answer, besides the method's.
    limits : Limits
        What it may use, with the version of Landlock that shuts it in.
    files : list of (str, str)
        Name and digest of each file that the method read while it was loaded.
    plugins : list of dict
        Descriptions of the measure and the search.
    search_options : dict of str to object
        Options of the search that are numbers, texts or flags.
    measure : dict of str to bool
        What the measure states of its input: ``halves``, ``intervals`` and ``timed``.
    cost : DeclaredCost
        Operations that the measure and the search declare.

    Raises
    ------
    BadInput
        If the method cannot be loaded.
    """

    def __init__(self, spec: GuestSpec, limits: Limits) -> None:
        self._spec, self.limits, self._lock = spec, limits, threading.Lock()
        self._process: GuestProcess | None = None
        self._lost = ""  # why it ended while it was loaded; it is then not started again
        self.names = spec.measure[0], spec.search[0]
        self.parameters, self.commands, self.plugins = spec.name.replace("+", " + "), False, list[dict[str, Any]]()
        self.polarities, self.measures = False, tuple[str, ...]()
        self.search_options, self.measure = dict[str, Any](), dict[str, bool]()
        self.cost = DeclaredCost()
        self._loaded, self._named = list[list[str]](), self._stat_named()
        try:
            self._describe(self._start())
        except GuestLost as lost:
            is_limit = str(lost).startswith(OVER_A_LIMIT)
            self._lost = str(lost) if is_limit else f"while it was loaded, {lost}"
            self.close()
        self.files = self._loaded

    def _describe(self, hello: dict[str, Any]) -> None:
        try:
            self.parameters, self.commands = self._as_written(str(hello["parameters"])), bool(hello["commands"])
            self.polarities = bool(hello["polarities"])
            self.measures = tuple(map(str, hello["measures"]))
            self.plugins = list(hello["plugins"])
            self.cost = DeclaredCost(*(number_or_none(hello["cost"][name]) for name in ("measure", "window", "look")))
            self.search_options = {str(name): value for name, value in hello["search_options"].items()}
            self.measure = {str(name): bool(value) for name, value in hello["measure"].items()}
        except (KeyError, TypeError, AttributeError) as error:
            raise GuestLost("its process sent nonsense") from error

    def _start(self) -> dict[str, Any]:
        """Start the process, and return the message that describes the method."""
        order = {"name": self._spec.name, "measure": self._spec.measure, "search": self._spec.search}
        spec = self._spec
        process = self._process = GuestProcess({"load": order}, spec.folders, files=spec.files, limits=self.limits)
        _ALIVE.append(self)
        if len(_ALIVE) > MAX_ALIVE:  # a tuning may have hundreds of methods
            for other in _ALIVE[-2::-1]:
                if other._lock.acquire(blocking=False):
                    other.close()
                    other._lock.release()
                    break
        try:
            return process.load()
        except BadInput:
            self.close()
            raise
        finally:
            self._loaded, self.limits = process.files, replace(self.limits, landlock=process.landlock)

    def _as_written(self, text: str) -> str:
        for absolute, shown in self._spec.shown:
            text = text.replace(absolute, shown)
        return text

    def _stat_named(self) -> list[tuple[int, int]]:
        """Return time and size of the files that the user named."""
        states = [Path(file).stat() for file in self._spec.files if Path(file).is_file()]
        return [(state.st_mtime_ns, state.st_size) for state in states]

    @property
    def is_current(self) -> bool:
        """Whether the method's files are still what they were when it was loaded, as far as its process knows."""
        with self._lock:
            if self._lost:
                return self._named == self._stat_named()
            try:
                return self._process is not None and self._process.digests() == self.files
            except GuestLost:
                return False

    def run(self, view: GuestView, *, scorer: MeteredScorer, stream_path: str = "") -> tuple[Answer, str]:
        """Return the answer and '', or an empty answer and one line that says why the method failed.

        Raises BudgetSpentError, and BadInput if the error concerns the file ``stream_path``.
        """
        with self._lock:
            try:
                last = self._running().run(view, scorer, stream_path=stream_path)
                answer, problem = _read_answer(last, commanding=self.commands)
                _note_scores(scorer, last)
            except BudgetSpentError:
                raise
            except (GuestLost, BadInput) as error:
                self.close()
                if isinstance(error, BadInput) and stream_path and error.where == stream_path:
                    raise
                return Answer(), to_one_line(str(error))
            except (
                BaseException
            ):  # the evaluator's own: the guest still waits for a reply, and would take the next for it
                self.close()
                raise
            return answer, problem

    def _running(self) -> GuestProcess:
        """Return the process, started again if it ended; raises GuestLost if it cannot be."""
        if self._lost:
            raise GuestLost(self._lost)
        if self._process is None or not self._process.alive:
            self.close()
            self._start()
            if self._loaded != self.files:
                raise GuestLost("its files changed since the evaluation began")
        return self._process  # type: ignore[return-value]

    def rate(self, image: np.ndarray, *, frames: int) -> float:
        """Return the score of a window of so many frames; raises GuestLost or BadInput as the process does."""
        with self._lock:
            try:
                return self._running().rate(image, frames=frames)
            except BaseException:
                self.close()
                raise

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.close()
        self._process = None
        if self in _ALIVE:
            _ALIVE.remove(self)


@dataclass(frozen=True)
class GuestMeasure:
    """A focus measure of others, which scores windows in a process of its own.

    What it raises is a BadInput that names it, whatever happens to its process.
    """

    name: str
    guest: Guest

    def __getattr__(self, key: str) -> Any:
        if key in ("halves", "intervals", "timed"):
            return self.guest.measure.get(key, False)
        raise AttributeError(key)

    def __call__(self, image: np.ndarray, *, frames: int = 0) -> float:
        try:
            return self.guest.rate(image, frames=frames)
        except GuestLost as lost:
            problem = to_one_line(f"focus measure {self.name!r} fails: {lost}")
            raise BadInput(problem, hint="repair it") from lost


def _read_answer(last: dict[str, Any], *, commanding: bool) -> tuple[Answer, str]:
    problem = last.get("problem")
    if problem:
        return Answer(), to_one_line(str(problem))
    said = last["answer"]
    try:
        answer = Answer(said["frame"], tuple(said["trace"]), said["note"], said["position"])
    except (KeyError, TypeError) as error:
        raise GuestLost("its process sent an answer that is none") from error
    if fault := answer_fault(answer, commanding=commanding):
        return Answer(), to_one_line("; ".join(fault))
    return to_plain_numbers(answer), ""


def _note_scores(scorer: MeteredScorer, last: dict[str, Any]) -> None:
    """Take over the scores of a guest, for charts."""
    try:
        scorer.scores.update({(int(first), int(stop)): float(score) for first, stop, score in last["scores"]})
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise GuestLost("its process sent scores that are none") from error


def guest_of(spec: GuestSpec, limits: Limits) -> Guest:
    """Return the guest of a method, which this process starts once, and again if its files changed.

    Raises BadInput if the method cannot be loaded.
    """
    key = repr((spec, limits))
    known = _GUESTS.get(key)
    if known is None or not known.is_current:
        if known is not None:
            known.close()
        known = _GUESTS[key] = Guest(spec, limits)
    return known


_GUESTS: dict[str, Guest] = {}
_ALIVE: list[Guest] = []
