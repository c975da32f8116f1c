"""The sequences to evaluate."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from saf_gen.core.files import check_on_disk, name_as_text
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.stream.manifest import ALL_SPLITS, TEST_SPLIT, Manifest, check_content, read_manifest
from saf_gen.stream.recordings import Recording
from saf_gen.stream.sample_dataset import SAMPLE


@dataclass(frozen=True)
class SequenceTask:
    """One sequence to evaluate; fields that only a manifest states are None for a single stream file."""

    id: str
    split: str | None
    scene: str
    light: str | None
    path: Path
    content_sha256: str | None
    variant: int | None = None
    scene_motion: str | None = None
    lens_motion: str | None = None
    frames: int | None = None
    file_sha256: str | None = None


@dataclass(frozen=True)
class SequenceSelection:
    """The sequences to evaluate, at least one, and the split of each sequence of the splits that are left out.

    ``unmade`` sequences of their splits are planned, but not made yet.
    """

    tasks: list[SequenceTask]
    left_out: Mapping[str, str] = field(default_factory=dict)
    unmade: int = 0


def select_sequences_to_evaluate(
    path: Path, *, split: str | None = None, scene_motion: str | None = None
) -> SequenceSelection:
    """Select the sequences to evaluate in a dataset folder, or the single stream of a file.

    Parameters
    ----------
    path : Path
        Dataset folder or stream file.
    split : str, optional
        Split of the sequences, or ``all``. The default is ``test``, or the only split of the dataset.
    scene_motion : str, optional
        Scene motion of the sequences; by default any.

    Returns
    -------
    SequenceSelection
        The sequences, and those of other splits.

    Raises
    ------
    BadInput
        If there is no dataset, stream or sequence, or no sequence of that split or scene motion; if no split is given
        for a dataset with several splits, none of them called ``test``; or if it is ``all`` and one of several splits
        has that name.
    """
    if not path.is_dir():
        return SequenceSelection([_make_stream_task(path, split=split, scene_motion=scene_motion)])
    manifest = read_manifest(path)
    if not manifest.sequences:
        raise BadInput(f"{path} holds no finished sequence", hint="run saf-gen generate with its recipe again")
    splits = _choose_splits(manifest, split, path=path)
    entries = tuple(entry for entry in manifest.sequences if entry.split in splits)
    left_out = {entry.id: entry.split for entry in manifest.sequences if entry.split not in splits}
    if scene_motion is not None:
        motions = {entry.scene_motion for entry in entries}
        if scene_motion not in motions:
            raise unknown("scene motion", scene_motion, allowed=motions, where=str(path))
        entries = tuple(entry for entry in entries if entry.scene_motion == scene_motion)
    file_digests = manifest.file_digests
    tasks = [
        SequenceTask(
            id=entry.id,
            split=entry.split,
            scene=entry.scene,
            light=entry.light,
            path=path / entry.file,
            content_sha256=entry.content_sha256,
            variant=entry.variant,
            scene_motion=entry.scene_motion,
            lens_motion=entry.lens_motion,
            frames=entry.frames,
            file_sha256=file_digests.get(entry.file),
        )
        for entry in entries
    ]
    return SequenceSelection(tasks, left_out, manifest.count_unmade(splits))


def _choose_splits(manifest: Manifest, split: str | None, *, path: Path) -> tuple[str, ...]:
    """Return the splits that ``split`` selects from a dataset; see select_sequences_to_evaluate."""
    if split is not None:
        return manifest.select_splits(split, where=str(path))
    if manifest.default_split is None:
        raise BadInput(
            f"the dataset has the splits {', '.join(manifest.splits)}, and none is called {TEST_SPLIT}",
            where=str(path),
            allowed=f"one of them, or {ALL_SPLITS} to rank them together",
            hint=f"run {manifest.next_command(path)}",
        )
    return (manifest.default_split,)


def _make_stream_task(path: Path, *, split: str | None, scene_motion: str | None) -> SequenceTask:
    check_on_disk(path)
    if not path.exists():
        raise BadInput(
            f"no dataset or stream at {str(path)!r}",
            allowed="a dataset folder or a stream file (.h5)",
            nearest=str(path.with_name(nearest)) if (nearest := closest(path.name, [SAMPLE, *_siblings(path)])) else "",
            hint="make one with `saf-gen generate quickstart --out datasets/quickstart`",
        )
    for what, value in (("split", None if split == ALL_SPLITS else split), ("scene motion", scene_motion)):
        if value is not None:
            raise BadInput(
                f"{what} {value!r} cannot be selected from the single stream {str(path)!r}",
                allowed=f"a dataset, or a stream and no {what}",
            )
    name = name_as_text(path.stem)
    return SequenceTask(name, None, name, None, path, None)


def _siblings(path: Path) -> list[str]:
    return [other.name for other in path.parent.iterdir()] if path.parent.is_dir() else []


def check_stream(task: SequenceTask, stream: Recording) -> None:
    """Read all bytes of a stream; raise BadInput unless it is the one that the manifest names and holds its content.

    Records name this content, of which methods see only a part.
    """
    if task.content_sha256 is not None and stream.content_sha256 != task.content_sha256:
        raise BadInput(
            f"{task.path} is not the stream that the manifest names",
            hint="make the dataset again with `saf-gen generate`",
        )
    check_content(stream, task.file_sha256)
