"""A method of others: what it is made of, and its runs in a process of its own."""

import sys
import sysconfig
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.benchmark.guests.host import MAX_OPENED, GuestLost, GuestProcess, GuestView, Limits
from saf_gen.benchmark.records import OVER_A_LIMIT
from saf_gen.benchmark.search_run import answer_fault, to_one_line, to_plain_numbers
from saf_gen.benchmark.view.operations import DeclaredCost, number_or_none
from saf_gen.benchmark.view.restricted_view import BudgetSpentError, MeteredScorer
from saf_gen.core.config.source_digest import source_digest
from saf_gen.core.files import file_sha256
from saf_gen.errors import BadInput
from saf_gen.parts import Answer

MAX_ALIVE = 96
"""Processes of guests that are kept; the one that was started first is ended for another, and started again if needed.
"""
PACKAGE = Path(__file__).resolve().parents[2]
PACKAGES = {"site-packages", "dist-packages"}
"""Names of folders that hold installed packages, wherever they are."""


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
    files : list of (str, str)
        Name and digest of each file that the method read while it was loaded.
    read_late : set of (str, str)
        Path and digest of each file that it read only when it was called, so that ``files`` does not hold it; a file
        that changed meanwhile is there twice. The digest is '' if there is no such file.
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
        self._own, self._packages = {Path(file) for file in spec.files}, list[Path]()
        self._paths = list(self._own)
        self.read_late: set[tuple[str, str]] = set()
        self._late_states: dict[str, tuple[int, int]] = {}
        try:
            self._process = self._start()
            self._describe(self._process.hello)
        except GuestLost as lost:
            is_limit = str(lost).startswith(OVER_A_LIMIT)
            self._lost = str(lost) if is_limit else f"while it was loaded, {lost}"
            self.close()
        self.files = self._digest_files()

    def _describe(self, hello: dict[str, Any]) -> None:
        try:
            self.parameters, self.commands = self._as_written(str(hello["parameters"])), bool(hello["commands"])
            self.polarities = bool(hello["polarities"])
            self.measures = tuple(map(str, hello["measures"]))
            self.plugins = list(hello["plugins"])
            self.cost = DeclaredCost(*(number_or_none(hello["cost"][name]) for name in ("measure", "window", "look")))
            self.search_options = {str(name): value for name, value in hello["search_options"].items()}
            self.measure = {str(name): bool(value) for name, value in hello["measure"].items()}
            self._own |= {Path(str(path)) for path in hello["class_files"]}
            self._packages = [Path(str(path)) for path in hello["packages"]]
            self._paths += [*self._own, *(Path(str(path)) for path in hello["read"])]
        except (KeyError, TypeError, AttributeError) as error:
            raise GuestLost("its process sent nonsense") from error

    def _start(self) -> GuestProcess:
        order = {"name": self._spec.name, "measure": self._spec.measure, "search": self._spec.search}
        process = GuestProcess({"load": order}, list(self._spec.folders), limits=self.limits)
        _ALIVE.append(self)
        if len(_ALIVE) > MAX_ALIVE:  # a tuning may have hundreds of methods
            _ALIVE[0].close()
        return process

    def _as_written(self, text: str) -> str:
        for absolute, shown in self._spec.shown:
            text = text.replace(absolute, shown)
        return text

    def _digest_files(self) -> list[tuple[str, str]]:
        """Return name and digest of the method's own files, and of those of saf_gen that it uses, sorted."""
        named = {path: name for path in self._paths if (name := self._name_file(path))}
        return sorted({(name, digest) for path, name in named.items() if (digest := _digest(path))})

    def _name_file(self, path: Path) -> str:
        """Return the name of a file in the digest: relative to the method's folder; '' for a file of no method."""
        if path.is_relative_to(PACKAGE):
            return path.name if path.parent.parent == PACKAGE / "plugins" else ""
        packages = [package.parent for package in self._packages if package in path.parents]
        for folder in (*map(Path, self._spec.folders), *packages):
            if path.is_relative_to(folder):
                return path.relative_to(folder).as_posix()
        is_of_the_machine = path not in self._own and (
            not PACKAGES.isdisjoint(path.parts)
            or path.parent.suffix == ".dist-info"
            or any(path.is_relative_to(root) for root in _SYSTEM)
        )
        return "" if is_of_the_machine else path.name

    def _note_late_files(self, opened: list[str]) -> None:
        """Note what the method has opened since it was loaded, and whether it has changed since."""
        if len(opened) >= MAX_OPENED:
            self.read_late.add(("more files than are counted", "?"))
        for text in {*opened, *self._late_states}:
            path = Path(text).resolve()
            if not (name := self._name_file(path)):
                continue
            try:
                status = path.stat()
                state = (status.st_mtime_ns, status.st_size)
            except OSError:
                state = (0, 0)
            if self._late_states.get(text) != state:
                self._late_states[text] = state
                digest = _digest(path)
                if (name, digest) not in self.files:
                    self.read_late.add((str(path), digest))

    @property
    def is_current(self) -> bool:
        """Whether the method's files are still what they were when it was loaded."""
        return self._digest_files() == self.files

    def run(self, view: GuestView, *, scorer: MeteredScorer, stream_path: str = "") -> tuple[Answer, str]:
        """Return the answer and '', or an empty answer and one line that says why the method failed.

        Raises BudgetSpentError, and BadInput if the error concerns the file ``stream_path``.
        """
        with self._lock:
            try:
                process = self._running()
                try:
                    last = process.run(view, scorer, stream_path=stream_path)
                finally:
                    self._note_late_files(process.opened)
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
            if not self.is_current:
                raise GuestLost("its files changed since the evaluation began")
            self._process = self._start()
        return self._process

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


def _digest(path: Path) -> str:
    """Return the digest of a file, of which remarks in Python are no part; '' if it cannot be read."""
    try:
        return source_digest(path) if path.suffix == ".py" else file_sha256(path)
    except (OSError, BadInput):
        return ""


def is_as_read(path: str, digest: str) -> bool:
    """Return whether a file that a guest read late is still what it was; see :attr:`Guest.read_late`."""
    return _digest(Path(path)) == digest


_SYSTEM = [
    Path(root).resolve()
    for root in {sys.prefix, sys.base_prefix, *sysconfig.get_paths().values(), "/proc", "/sys", "/dev", "/etc", "/usr"}
]
"""Folders whose files belong to Python, to packages or to the machine, not to a method."""


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
