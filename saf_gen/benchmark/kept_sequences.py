"""The results of single sequences, kept beside an evaluation until it is written, so that a killed one goes on.

They lie in a hidden folder, some sequences to a file, which is signed: a folder that came with somebody's data holds
nothing that is taken for the work of this user. Nothing in a file is run.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from io import BytesIO
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from saf_gen import __version__
from saf_gen.benchmark.curve_quality import AssessedCurve, CurveQuality
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Drawn, Evaluation, FocusCurve, LensPath, SweepSummary
from saf_gen.benchmark.thumbnails import Thumbnails
from saf_gen.benchmark.tracks.predictions import PredictionSet
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask
from saf_gen.benchmark.versions import evaluator_version
from saf_gen.core.files import write_atomically
from saf_gen.core.object_store import AnyPath
from saf_gen.core.user_folder import SIGNATURE_BYTES, is_signed_by_user, sign_as_user
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

KEEP_EVERY_S = 5.0
"""Sequences that are evaluated quicker than this are written together; a kill loses what was not written."""
_KINDS = {
    kind.__name__: kind
    for kind in (Evaluation, Record, AssessedCurve, CurveQuality, SweepSummary, FocusCurve, Thumbnails, LensPath)
}
FORMAT = {
    "format": "saf-gen kept sequences 2",
    **{name: [f.name for f in fields(kind)] for name, kind in _KINDS.items()},
}


class KeptSequences:
    """The results of the sequences of one evaluation, those of an earlier run that was stopped among them.

    Without a ``folder``, or where it cannot be signed, nothing is kept. ``taken`` counts what the earlier run had made.
    """

    def __init__(self, folder: str | Path | None = None) -> None:
        self._folder = None if folder is None else Path(folder)
        self._decisive: list[Any] = []
        self._found: dict[str, Evaluation] = {}
        self._new: dict[str, Evaluation] = {}
        self._written, self.taken = monotonic(), 0

    def begin(
        self,
        groups: Mapping[str, Sequence[Method]],
        *,
        protocol: "ClosedLoopProtocol | None",
        predictions: PredictionSet | None,
        stacks: AnyPath,
    ) -> Self:
        """Read what is there, for an evaluation of these methods by region, this protocol and these predictions.

        ``stacks`` is the folder of the focal stacks, from which a closed loop is captured.
        """
        methods = [
            [region, [[m.name, m.code, m.parameters, m.tuning] for m in group]] for region, group in groups.items()
        ]
        version = evaluator_version("recorded" if protocol is None else "closed_loop")
        answers = None if predictions is None else predictions.code
        state = [] if protocol is None else sorted((p.name, p.stat().st_mtime_ns) for p in Path(str(stacks)).glob("*"))
        self._decisive = [FORMAT, __version__, version, methods, repr(protocol), answers, state]
        for path in sorted(self._folder.glob("*.npz")) if self._folder else ():
            self._found |= _read(path)
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: object) -> None:
        if kind is not None:  # what comes after an evaluation is quick
            self.write()

    def take(self, task: SequenceTask, *, draw: Drawn) -> Evaluation | None:
        """Return the result of a sequence that an earlier run had made of the same methods and files, else None."""
        result = self._found.pop(self._key(task, draw), None) if self._folder else None
        self.taken += result is not None
        return result

    def keep(self, task: SequenceTask, result: Evaluation, *, draw: Drawn) -> None:
        """Keep the result of a sequence; it is on disk at once, or with those that follow within KEEP_EVERY_S.

        Raises BadInput where it cannot be written.
        """
        if self._folder is not None:
            self._new[self._key(task, draw)] = result
            if monotonic() - self._written >= KEEP_EVERY_S:
                self.write()

    def write(self) -> None:
        """Write what is not on disk yet; raises BadInput where it cannot be written."""
        if self._folder is not None and self._new:
            _write(self._folder, self._new)
        self._new, self._written = {}, monotonic()

    def remove(self) -> None:
        """Remove what is kept: the evaluation is written."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _key(self, task: SequenceTask, draw: Drawn) -> str:
        """Return a digest of all that decides the result of a sequence; the file counts by its size and time."""
        try:
            status = task.path.stat()
            file = [status.st_size, status.st_mtime_ns]
        except (OSError, BadInput):  # a store has errors of its own
            file = []
        decisive = [*self._decisive, {**asdict(task), "path": file}, draw]
        return hashlib.sha256(json.dumps(decisive).encode()).hexdigest()


def _write(folder: Path, results: Mapping[str, Evaluation]) -> None:
    arrays: dict[str, np.ndarray] = {}
    document = {"of": FORMAT, "results": {key: _to_plain(result, arrays) for key, result in results.items()}}
    arrays["document"] = np.frombuffer(json.dumps(document).encode(), np.uint8)
    held = BytesIO()
    np.savez(held, allow_pickle=False, **arrays)
    data = held.getvalue()
    signature = sign_as_user(data)
    if signature is not None:
        with write_atomically(folder / f"{min(results)[:32]}.npz") as part:
            part.write_bytes(signature + data)


def _read(path: Path) -> dict[str, Evaluation]:
    """Return the results of a file by their keys; none of a file that is damaged, or not of this user."""
    try:
        held = path.read_bytes()
    except OSError:
        return {}
    signature, data = held[:SIGNATURE_BYTES], held[SIGNATURE_BYTES:]
    if not is_signed_by_user(data, signature):
        return {}
    with np.load(BytesIO(data), allow_pickle=False) as arrays:
        document = json.loads(arrays["document"].tobytes())
        if document["of"] != FORMAT:
            return {}
        return {key: _from_plain(plain, arrays) for key, plain in document["results"].items()}


def _to_plain(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Return a value as JSON; arrays go into ``arrays``, by number."""
    if isinstance(value, np.ndarray):
        arrays[str(len(arrays))] = value
        return {"array": str(len(arrays) - 1)}
    if is_dataclass(value):
        plain = {f.name: _to_plain(getattr(value, f.name), arrays) for f in fields(value)}
        return {"is": type(value).__name__, "of": plain}
    if isinstance(value, tuple | list):
        return [_to_plain(one, arrays) for one in value]
    return value.item() if isinstance(value, np.generic) else value


def _from_plain(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if isinstance(plain, list):
        return tuple(_from_plain(one, arrays) for one in plain)
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        return arrays[plain["array"]]
    return _KINDS[plain["is"]](**{name: _from_plain(one, arrays) for name, one in plain["of"].items()})
