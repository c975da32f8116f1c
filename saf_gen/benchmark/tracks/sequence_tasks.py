"""What is evaluated: the sequences of a dataset, or one stream; where methods look; what all records say."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from saf_gen.benchmark.judgement import light_ratio
from saf_gen.benchmark.tracks.focus_place import (
    locate_focus_in_recording,
    locate_focus_in_travel,
    truncate_truth,
)
from saf_gen.benchmark.versions import evaluator_version
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.core.cores import describe_machine
from saf_gen.core.region import Region, target_bounding_box
from saf_gen.errors import BadInput, unknown
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_file import SpikeStream

__all__ = [
    "SequenceTask",
    "check_stream_digest",
    "choose_region",
    "describe_sequence",
    "list_sequence_tasks",
    "measure_mean_rate",
]

CURVE_BLOCKS = 200


@dataclass(frozen=True)
class SequenceTask:
    """One sequence. None where the stream stands alone, and nobody says."""

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


def list_sequence_tasks(
    path: Path, split: str | None = None, scene_motion: str | None = None
) -> list[SequenceTask]:
    """The sequences of a dataset folder, of this split and scene motion alone; or the one stream of a file.

    Raises BadInput where there is nothing, or nothing of that kind.
    """
    if not path.is_dir():
        if not path.exists():
            raise BadInput(
                f"no dataset or stream at {str(path)!r}",
                allowed="a dataset folder or a stream file (.h5)",
                hint="make one with `saf-gen generate recipes/quickstart.yaml --out datasets/quickstart`",
            )
        if split is not None:
            raise BadInput(f"split {split!r} of the single stream {str(path)!r}", allowed="no split")
        if scene_motion is not None:
            raise BadInput(
                f"scene motion {scene_motion!r} of the single stream {str(path)!r}",
                allowed="a dataset for that",
            )
        return [SequenceTask(path.stem, None, path.stem, None, path, None)]
    entries = read_manifest(path).sequences
    if not entries:
        raise BadInput(
            f"{path} holds no finished sequence", hint="run saf-gen generate with its recipe again"
        )
    if split is not None and split not in {entry.split for entry in entries}:
        raise unknown("split", split, {entry.split for entry in entries}, where=str(path))
    there = {entry.scene_motion for entry in entries if split in (None, entry.split)}
    if scene_motion is not None and scene_motion not in there:
        raise unknown("scene motion", scene_motion, there, where=str(path))
    return [
        SequenceTask(
            entry.id,
            entry.split,
            entry.scene,
            entry.light,
            path / entry.file,
            entry.content_sha256,
            entry.variant,
            entry.scene_motion,
            entry.lens_motion,
            entry.frames,
        )
        for entry in entries
        if split in (None, entry.split) and scene_motion in (None, entry.scene_motion)
    ]


def choose_region(stream: SpikeStream, region: str) -> tuple[Region | None, str]:
    target = stream.truth.target
    if region == "target" and target is not None and np.any(target):
        return target_bounding_box(target), "target"
    return None, "frame"


def check_stream_digest(task: SequenceTask, stream: SpikeStream) -> None:
    if task.content_sha256 is not None and stream.content_sha256 != task.content_sha256:
        raise BadInput(
            f"{task.path} is not the stream that the manifest names",
            hint="make the dataset again with `saf-gen generate`",
        )


def _mean(counts: np.ndarray) -> float:
    return float(np.mean(counts))


def measure_mean_rate(counts: WindowCounts) -> tuple[np.ndarray, np.ndarray]:
    """Centres of blocks, frames, and the mean counts in each, spikes a pixel and readout."""
    view = RecordingView(counts, _mean)
    window = max(1, view.frames // CURVE_BLOCKS)
    first = np.arange(0, view.frames - window + 1, window)
    rate = np.array([view.score(int(a), int(a) + window) / window for a in first])
    return first + (window - 1) / 2, rate


def describe_sequence(
    task: SequenceTask,
    stream: SpikeStream,
    light: tuple[np.ndarray, np.ndarray],
    track: Literal["recorded", "closed_loop"],
    *,
    frames: int | None = None,
) -> dict[str, Any]:
    """What a record says of the sequence, the rig and the machine, whatever the method.

    ``light``: see :func:`measure_mean_rate`. ``frames``: of the recording from its beginning; None is all.
    """
    truth, gain = truncate_truth(stream.truth, frames or stream.shape[0]), stream.metadata.gain
    centres, rate = light
    if frames is not None:
        gain, rate = None if gain is None else gain[:frames], rate[: max(1, int((centres < frames).sum()))]
    place, off = (
        locate_focus_in_recording(truth, stream.focus_position)
        if track == "recorded"
        else locate_focus_in_travel(truth)
    )
    return {
        "track": track,
        "variant": task.variant,
        "scene_motion": task.scene_motion,
        "lens_motion": task.lens_motion,
        "truth_first": truth.position if truth.known else None,
        "focus_place": place,
        "focus_off_dof": off,
        "mean_rate": float(rate.mean()),
        "light_ratio": light_ratio(gain),
        "machine": describe_machine(),
        "rig": evaluator_version(track),
    }
