"""The process of a guest: it loads one method, and runs it on what the evaluator sends.

``python -m saf_gen.benchmark.guests.process DESCRIPTOR PATH SECONDS`` talks over its standard input and output, which
it then closes for the method. It has neither the path nor the truth of a recording. If it cannot look for the evaluator
for so many seconds, because a method holds the interpreter, it ends.
"""

import faulthandler
import os
import shutil
import sys
import threading
import time
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from importlib.util import source_from_cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, BinaryIO, NoReturn

import numpy as np

from saf_gen.benchmark.guests.host import end_marked
from saf_gen.benchmark.guests.wire import read_message, write_message
from saf_gen.core.child import SharedMemory

if TYPE_CHECKING:
    from saf_gen.errors import BadInput

PARENT_CHECK_S = 2.0
"""Time between two checks of whether the evaluator is still there."""
MAX_FILE_BYTES = 1 << 30
"""Largest file that a method may write."""


class Line:
    """The guest's end of the wire: each request has one reply."""

    def __init__(self, incoming: BinaryIO, outgoing: BinaryIO, *, memory: SharedMemory) -> None:
        self._incoming, self._outgoing, self.memory = incoming, outgoing, memory
        self.owner, self.run, self._folder = os.getpid(), 0, Path.cwd().parent
        self._sending = threading.RLock()  # any thread may open a file, which is told

    def send(self, message: dict[str, Any]) -> None:
        """Send a message of the current run; a copy of this process, made by a method that forks, ends here."""
        if os.getpid() != self.owner:
            os._exit(1)
        with self._sending:
            write_message(self._outgoing, {**message, "run": self.run})

    def receive(self) -> dict[str, Any]:
        """Return the next message that is no ping; the process ends if the evaluator is gone."""
        while True:
            message = read_message(self._incoming)
            if message is None:  # the evaluator was killed, or its folder would be gone already
                _end(self._folder)
            if "ping" not in message:
                return message
            if "shape" in message:
                self.memory.read(message)
            self.send({"pong": 1})

    def receive_order(self) -> dict[str, Any]:
        """Return the first message, after which a method may import its neighbours."""
        order = self.receive()
        sys.path[:0] = order["folders"]
        return order

    def ask(self, message: dict[str, Any]) -> dict[str, Any]:
        """Return the reply to a request; raises BudgetSpentError or BadInput if the reply says so."""
        from saf_gen.benchmark.view.restricted_view import BudgetSpentError
        from saf_gen.errors import BadInput

        self.send(message)
        reply = self.receive()
        if "spent" in reply:
            raise BudgetSpentError(reply["spent"])
        if "refused" in reply:
            raise BadInput(**reply["refused"])
        return reply


class RemoteView:
    """The view of a recording or camera on the other side of the wire; see :class:`saf_gen.parts.View`."""

    def __init__(self, line: Line, start: dict[str, Any], *, measure: Any) -> None:
        from saf_gen.benchmark.view.restricted_view import MeteredScorer

        self._line, self.scorer = line, MeteredScorer(measure)
        self.frames, self.readout_hz, self.lag_s = start["frames"], start["readout_hz"], start["lag_s"]
        self.now = start["now"]
        self._sensed = line.memory.read(start["positions"])

    def score(self, first: int, stop: int, measure: str | None = None) -> float:
        image = self._image(self.scorer.form(measure), first=first, stop=stop)
        return self.scorer.rate(image, first=first, stop=stop, measure=measure)

    def counts(self, first: int, stop: int) -> np.ndarray:
        counts = self._image("counts", first=first, stop=stop)
        self.scorer.note_look()
        return counts

    def polarities(self, first: int, stop: int) -> np.ndarray:
        events = self._image("polarities", first=first, stop=stop)
        self.scorer.note_look()
        return events

    def _image(self, form: str, *, first: int, stop: int) -> np.ndarray:
        reply = self._line.ask({"image": form, "first": _whole(first), "stop": _whole(stop)})
        self.now = reply["now"]
        self.scorer.windows += 1
        return self._line.memory.read(reply)

    def position(self, frame: int) -> float:
        frame = _whole(frame)
        if not (isinstance(frame, int) and 0 <= frame < len(self._sensed)):
            reply = self._line.ask({"position": frame, "known": len(self._sensed)})
            self._sensed = np.concatenate([self._sensed, self._line.memory.read(reply["positions"])])
            return float(reply["position"])
        return float(self._sensed[frame])

    def move(self, to: float) -> None:
        self._line.ask({"move": float(to)})

    def wait(self, frames: int) -> None:
        self.now = self._line.ask({"wait": float(frames)})["now"]


def _whole(number: Any) -> Any:
    """Return a number of numpy as one of Python; others as they are, to be refused by the evaluator."""
    return number.item() if isinstance(number, np.generic) else number


class FilesRead:
    """The files that Python opens for reading: those while a method is loaded, and later each new one at once.

    Files of Python, of the machine and of the process's own folder are left out, except those of packages that offer
    the method. A copy of this process tells nothing.
    """

    def __init__(self, line: Line) -> None:
        self._line, self._loading, self._seen = line, True, set[str]()
        self._own: tuple[str, ...] = ()
        self._left_out = (*{sys.prefix, sys.base_prefix, str(Path.cwd())}, "/proc/", "/sys/", "/dev/")
        sys.addaudithook(self._note)

    def _note(self, event: str, details: tuple[Any, ...]) -> None:
        if event not in _OPENING or not details:
            return
        name = details[1] if event == "import" else details[0]
        if not isinstance(name, str | bytes) or (event == "open" and not _is_reading(details[2])):
            return
        with suppress(OSError, ValueError):
            path = os.path.abspath(os.fsdecode(name))  # noqa: PTH100  pathlib is slower, and each call counts
            if path in self._seen or path.endswith(_COMPILED) or os.getpid() != self._line.owner:
                return
            self._seen.add(path)
            is_left_out = path.startswith(self._left_out) or "-packages/" in path  # those of Python, in any folder
            if not self._loading and (path.startswith(self._own) or not is_left_out):
                self._line.send({"opened": _source_of(path)})

    def finish(self, modules: list[ModuleType], own: list[str]) -> list[str]:
        """Return the paths of these modules and of the files that were opened; from now on each new one is told.

        Files in the folders ``own`` belong to the method, wherever they are.
        """
        self._own, self._loading = tuple(f"{folder}{os.sep}" for folder in own), False
        sources = [file for module in modules if (file := getattr(module, "__file__", None))]
        paths = {Path(_source_of(path)).resolve() for path in (*self._seen, *sources)}
        return sorted(str(path) for path in paths if path.is_file() and Path.cwd() not in path.parents)


_COMPILED = (".nbi", ".nbc")
"""Endings of the files in which numba keeps what it compiled."""
_OPENING = ("open", "import", "ctypes.dlopen", "sqlite3.connect")
"""Audit events (PEP 578) of which the first detail, or the second one of an import, is the path of a file."""


def _is_reading(flags: Any) -> bool:
    """Return whether a file is opened with its content, which a file that is made or emptied does not have."""
    return not isinstance(flags, int) or not flags & (os.O_WRONLY | os.O_TRUNC | os.O_EXCL)


def _source_of(path: str) -> str:
    """Return the source of a compiled module, whose time stamp would change the digest."""
    if path.endswith(".pyc") and "__pycache__" in path:
        with suppress(ValueError, NotImplementedError):
            return source_from_cache(path)
    return path


def main() -> None:
    """Serve the evaluator until it is gone."""
    _serve(open_line())


def open_line() -> Line:
    """Return this end of the wire, which a method cannot use by mistake; this process now ends with the evaluator."""
    descriptor, path = int(sys.argv[1]), sys.argv[2]
    line = Line(os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb"), memory=SharedMemory.attach(descriptor, path))
    with open(os.devnull) as nothing:  # noqa: PTH123
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)  # what the method prints goes where its errors go
    _limit()
    watch = partial(_end_with, os.getppid(), seconds=float(sys.argv[3]), folder=Path.cwd().parent)
    threading.Thread(target=watch, daemon=True).start()
    return line


def _limit() -> None:
    with suppress(ImportError):
        import resource

        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_FSIZE, (MAX_FILE_BYTES, MAX_FILE_BYTES))


def _end_with(parent: int, *, seconds: float, folder: Path) -> None:
    """End this process when its parent ends, also if a method never lets this thread run."""
    nothing = open(os.devnull, "w")  # noqa: PTH123, SIM115
    while os.getppid() == parent:
        faulthandler.dump_traceback_later(seconds + 2 * PARENT_CHECK_S, exit=True, file=nothing)
        time.sleep(PARENT_CHECK_S)
    _end(folder)


def _end(folder: Path) -> NoReturn:
    """End this process and all that it started, and delete its folder."""
    end_marked(folder)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(0)


def _serve(line: Line) -> NoReturn:
    from saf_gen.benchmark.search_run import run_search
    from saf_gen.benchmark.view.restricted_view import BudgetSpentError
    from saf_gen.parts import Answer

    order = line.receive_order()
    method, hello = _load(order["load"], folders=order["folders"], read=FilesRead(line))
    line.send(hello)
    while True:
        message = line.receive()
        line.run = message["start"]
        if "rate" in message:
            line.send(_rate(method.measure, line.memory.read(message), frames=message["rate"]))
            continue
        view = RemoteView(line, message, measure=method.measure)
        try:
            answer, problem = run_search(method.search, view, scorer=view.scorer)
        except BudgetSpentError as spent:  # the evaluator knows
            answer, problem = Answer(), str(spent)
        scores = [[*window, score] for window, score in view.scorer.scores.items()]
        line.send({"answer": asdict(answer), "problem": problem, "scores": scores[:MAX_SCORES]})


def _rate(measure: Any, image: np.ndarray, *, frames: int) -> dict[str, Any]:
    """Return the message with the score of a window, or with the reason why there is none."""
    from saf_gen.benchmark.search_run import describe_exception
    from saf_gen.core.user_code import user_code
    from saf_gen.errors import BadInput
    from saf_gen.parts import wants_frames

    try:
        with user_code():
            return {"score": float(measure(image, **({"frames": frames} if wants_frames(measure) else {})))}
    except BadInput as error:
        return refusal(error)
    except Exception as error:  # noqa: BLE001  code of others may raise anything
        return {"problem": describe_exception(error)}


def refusal(error: "BadInput") -> dict[str, Any]:
    """Return the message that lets the evaluator raise this error."""
    keys = ("problem", "allowed", "nearest", "hint", "where")
    return {"refused": {key: getattr(error, key) for key in keys}}


MAX_SCORES = 20_000
"""Largest number of scores that are sent for charts."""


def _load(spec: dict[str, Any], *, folders: list[str], read: FilesRead) -> tuple[Any, dict[str, Any]]:
    """Return the method and the first message, which describes it or says why it cannot be loaded."""
    before = set(sys.modules)
    from saf_gen.benchmark.method_spec import build_method, named_measures, nested_plugins, options_of
    from saf_gen.benchmark.plugin_description import describe_plugins
    from saf_gen.benchmark.search_run import describe_exception
    from saf_gen.benchmark.view.operations import declared_cost
    from saf_gen.core.config.source_digest import class_source_files
    from saf_gen.core.user_code import user_code
    from saf_gen.errors import BadInput
    from saf_gen.parts import commands, wants_polarities

    try:
        with user_code():
            method = replace(build_method(spec["measure"], spec["search"]), name=spec["name"])
            classes = {type(nested) for half in (method.measure, method.search) for nested in nested_plugins(half)}
            hello = {
                "parameters": method.parameters,
                "commands": commands(method.search),
                "polarities": any(map(wants_polarities, nested_plugins(method.search))),
                "measures": named_measures(method.search),
                "search_options": _plain_options(options_of(method.search)),
                "measure": {key: bool(getattr(method.measure, key, False)) for key in ("halves", "intervals", "timed")},
                "cost": asdict(declared_cost(method.measure, method.search)),
                "plugins": [asdict(plugin) for plugin in describe_plugins([method])],
            }
    except BadInput as error:
        return None, refusal(error)
    except Exception as error:  # noqa: BLE001  code of others may raise anything
        return None, {"broken": describe_exception(error)}
    modules = [module for name, module in list(sys.modules.items()) if name not in before]
    files = [str(file) for cls in classes for file in class_source_files(cls)]
    packages = _packages_of(classes)
    return method, {
        **hello,
        "class_files": files,
        "packages": packages,
        "read": read.finish(modules, packages + folders),
    }


def _packages_of(classes: set[type]) -> list[str]:
    """Return the folders of the packages that hold these classes, as a package with an entry point does."""
    names = {cls.__module__.partition(".")[0] for cls in classes} - {"saf_gen"}
    found = (getattr(sys.modules.get(name), "__path__", ()) for name in names)
    return sorted({str(Path(folder).resolve()) for folders in found for folder in folders})


def _plain_options(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that are numbers, texts or flags."""
    return {name: value for name, value in options.items() if isinstance(value, int | float | str)}


if __name__ == "__main__":
    main()
