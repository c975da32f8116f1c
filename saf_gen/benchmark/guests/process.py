"""The process of a guest: it loads one method, and runs it on what the evaluator sends.

It has neither the path nor the truth of a recording. Messages are JSON; each request has one reply.
"""

import json
import os
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from saf_gen.benchmark.guests.code_files import CodeFiles
from saf_gen.core.child import Line, SharedMemory

if TYPE_CHECKING:
    from saf_gen.errors import BadInput

MAX_MESSAGE_BYTES = 8 << 20
"""Largest message, enough for a trace of the longest allowed length."""
MAX_SCORES = 20_000
"""Largest number of scores that are sent for charts."""
to_json = json.JSONEncoder(separators=(",", ":")).encode  # json.dumps would make an encoder for each message


class GuestLine:
    """The guest's end of the line.

    Attributes
    ----------
    order : dict
        The first message, after which a method may import its neighbours.
    run : int
        Number of the run to which messages belong.
    """

    def __init__(self) -> None:
        self._line, self.run = Line(MAX_MESSAGE_BYTES), 0
        self.order = self._read()
        self.memory = SharedMemory.attach(*self.order["memory"])
        sys.path[:0] = self.order["folders"]

    def _read(self) -> dict[str, Any]:
        """Return the next message; the process ends if the evaluator is gone."""
        data = self._line.receive()
        return json.loads(data) if data else os._exit(0)

    def send(self, message: dict[str, Any]) -> None:
        """Send a message of the current run."""
        self._line.send(to_json({**message, "run": self.run}).encode())

    def receive(self) -> dict[str, Any]:
        """Return the next message that is no ping."""
        while "ping" in (message := self._read()):
            if "shape" in message:
                self.memory.read(message)
            self.send({"pong": 1})
        return message

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
    """The view of a recording or camera on the other side of the line; see :class:`saf_gen.parts.View`."""

    def __init__(self, line: GuestLine, start: dict[str, Any], *, measure: Any) -> None:
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


def serve() -> NoReturn:
    """Serve the evaluator until it is gone."""
    from saf_gen.benchmark.search_run import run_search
    from saf_gen.benchmark.view.restricted_view import BudgetSpentError
    from saf_gen.parts import Answer

    line = GuestLine()
    files = CodeFiles(line.order["files"], line.order["folders"])
    line.send({"files": files.digests()})  # before any code of the method runs
    method, hello = _load(line.order["load"], files)
    line.send(hello)
    while True:
        message = line.receive()
        line.run = message["start"]
        if "rate" in message:
            line.send(_rate(method.measure, line.memory.read(message), frames=message["rate"]))
            continue
        if "digests" in message:
            line.send({"files": files.digests()})
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
    """Return the message that lets the other end raise this error."""
    keys = ("problem", "allowed", "nearest", "hint", "where")
    return {"refused": {key: getattr(error, key) for key in keys}}


def _load(spec: dict[str, Any], files: CodeFiles) -> tuple[Any, dict[str, Any]]:
    """Return the method and the message that describes it or says why it cannot be loaded."""
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
            options = options_of(method.search)
            hello = {
                "parameters": method.parameters,
                "commands": commands(method.search),
                "polarities": any(map(wants_polarities, nested_plugins(method.search))),
                "measures": named_measures(method.search),
                "search_options": {
                    key: value for key, value in options.items() if isinstance(value, int | float | str)
                },
                "measure": {key: bool(getattr(method.measure, key, False)) for key in ("halves", "intervals", "timed")},
                "cost": asdict(declared_cost(method.measure, method.search)),
                "plugins": [asdict(plugin) for plugin in describe_plugins([method])],
            }
    except BadInput as error:
        return None, refusal(error)
    except Exception as error:  # noqa: BLE001  code of others may raise anything
        return None, {"broken": describe_exception(error)}
    files.finish([file for cls in classes for file in class_source_files(cls)], _packages_of(classes))
    return method, {**hello, "files": files.digests()}


def _packages_of(classes: set[type]) -> list[str]:
    """Return the folders of the packages that hold these classes, as a package with an entry point does."""
    names = {cls.__module__.partition(".")[0] for cls in classes} - {"saf_gen"}
    found = (getattr(sys.modules.get(name), "__path__", ()) for name in names)
    return sorted({str(Path(folder).resolve()) for folders in found for folder in folders})
