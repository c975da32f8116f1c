"""Results of finished sequences, kept until the evaluation is written, so that it can continue after it was killed.

They are kept in the user's cache folder, in files of several sequences each, so that results that came with other
people's data are never mistaken for this user's work. Nothing in a file is executed.
"""

import hashlib
import json
import os
import shutil
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from saf_gen import __version__
from saf_gen.benchmark.curve_quality import AssessedCurve, CurveQuality
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import Judgement, Record, What, Who
from saf_gen.benchmark.results import Drawn, Evaluation, FocusCurve, LensPath, SweepSummary
from saf_gen.benchmark.thumbnails import Thumbnails
from saf_gen.benchmark.tracks.predictions import PredictionSet
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.benchmark.versions import evaluator_version
from saf_gen.core.files import atomic_file
from saf_gen.core.user_folder import cache_folder

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

WRITE_INTERVAL_S = 5.0
"""Minimum time between two writes, in seconds; a killed process loses the results since its last write."""
_KINDS = {
    kind.__name__: kind
    for kind in (
        Evaluation,
        Record,
        Who,
        What,
        Judgement,
        AssessedCurve,
        CurveQuality,
        SweepSummary,
        FocusCurve,
        Thumbnails,
        LensPath,
    )
}
FORMAT = {
    "format": "saf-gen kept sequences 3",
    **{name: [f.name for f in fields(kind)] for name, kind in _KINDS.items()},
}


def kept_folder(target: Path) -> Path | None:
    """Return the folder for the results of an unfinished evaluation that will be written to ``target``.

    Returns None if this user has no cache folder, as in some containers.
    """
    cache = cache_folder()
    return (
        None if cache is None else cache / "unfinished" / hashlib.sha256(os.fsencode(target.resolve())).hexdigest()[:32]
    )


class KeptSequences:
    """The results of the sequences of one evaluation, including those of an earlier run that was stopped.

    Parameters
    ----------
    folder : str or Path, optional
        Folder of the results, as kept_folder returns it. Nothing is kept if it is None.

    Attributes
    ----------
    reused : int
        Number of results that were taken over from the earlier run.
    """

    def __init__(self, folder: str | Path | None = None) -> None:
        self._folder = None if folder is None else Path(folder)
        self._decisive: list[Any] = []
        self._found: dict[str, Evaluation] = {}
        self._new: dict[str, Evaluation] = {}
        self._written, self.reused = time.monotonic(), 0

    def begin(
        self,
        groups: Mapping[str, Sequence[Method]],
        *,
        protocol: "ClosedLoopProtocol | None",
        predictions: PredictionSet | None,
        stacks: Path,
    ) -> Self:
        """Read the results of an earlier run, and define the evaluation that they must belong to.

        Parameters
        ----------
        groups : mapping of str to sequence of Method
            Methods by region.
        protocol : ClosedLoopProtocol or None
            Protocol of the closed loop.
        predictions : PredictionSet or None
            Answers that were made elsewhere.
        stacks : Path
            Folder of the focal stacks from which a closed loop is captured.

        Returns
        -------
        KeptSequences
            This object.
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
        if kind is not None:  # without an error, the evaluation is about to be written, and these results removed
            self.write()

    def reuse(self, task: SequenceTask, *, draw: Drawn) -> Evaluation | None:
        """Return the result of a sequence from an earlier run of the same methods on the same files, or None."""
        result = self._found.pop(self._key(task, draw), None)
        self.reused += result is not None
        return result

    def keep(self, task: SequenceTask, result: Evaluation, *, draw: Drawn) -> None:
        """Keep the result of a sequence; write all new results if WRITE_INTERVAL_S have passed since the last write.

        Raises BadInput if the file cannot be written.
        """
        if self._folder is not None:
            self._new[self._key(task, draw)] = result
            if time.monotonic() - self._written >= WRITE_INTERVAL_S:
                self.write()

    def count_left_over(self) -> Counter[str | None]:
        """Return the number of results of each split that were not taken over."""
        return Counter(result.records[0].what.split for result in self._found.values() if result.records)

    def write(self) -> None:
        """Write the results that are not on disk yet; raise BadInput if the file cannot be written."""
        if self._folder is not None and self._new:
            _write(self._folder, self._new)
        self._new, self._written = {}, time.monotonic()

    def remove(self) -> None:
        """Delete the kept results, because the evaluation has been written."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _key(self, task: SequenceTask, draw: Drawn) -> str:
        """Return a digest of everything that determines a sequence's result; size and time represent its file."""
        try:
            status = task.path.stat()
            file = [status.st_size, status.st_mtime_ns]
        except OSError:
            file = []
        decisive = [*self._decisive, {**asdict(task), "path": file}, draw]
        return hashlib.sha256(json.dumps(decisive).encode()).hexdigest()


def _write(folder: Path, results: Mapping[str, Evaluation]) -> None:
    arrays: dict[str, np.ndarray] = {}
    document = {"of": FORMAT, "results": {key: _to_plain(result, arrays) for key, result in results.items()}}
    arrays["document"] = np.frombuffer(json.dumps(document).encode(), np.uint8)
    content = BytesIO()
    np.savez(content, allow_pickle=False, **arrays)
    data = content.getvalue()
    with atomic_file(folder / f"{min(results)[:32]}.npz") as part:
        part.write_bytes(hashlib.sha256(data).digest() + data)


def _read(path: Path) -> dict[str, Evaluation]:
    """Return the results in a file by key; empty if it is damaged or of another format."""
    try:
        content = path.read_bytes()
    except OSError:
        return {}
    digest, data = content[:32], content[32:]
    if digest != hashlib.sha256(data).digest():
        return {}
    with np.load(BytesIO(data), allow_pickle=False) as arrays:
        document = json.loads(arrays["document"].tobytes())
        if document["of"] != FORMAT:
            return {}
        return {key: _from_plain(plain, arrays) for key, plain in document["results"].items()}


def _to_plain(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Return a value in JSON types; its arrays are added to ``arrays`` under consecutive numbers."""
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
