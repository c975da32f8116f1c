"""Descriptions of streams, and checks of whole datasets."""

import json
import math
from pathlib import Path

import numpy as np

from saf_gen.core.focus_crossings import find_focus_crossings
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import read_manifest, verify_manifest_entry
from saf_gen.stream.recorded_grain import read_recorded_grain
from saf_gen.stream.stream_file import SpikeStream


def describe_stream_file(stream: SpikeStream) -> dict[str, str]:
    """Return facts about a stream as text, by name: size, light, lens, truth, and how it was made."""
    frames, rows, columns = stream.shape
    spikes = int(stream.counts(0, frames).sum(dtype=np.int64))
    readouts = frames * rows * columns
    facts = {
        "pixels": f"{columns}×{rows}",
        "frames": f"{frames} at {stream.readout_hz:g} Hz ({frames / stream.readout_hz:g} s)",
        "mean rate": f"{spikes / readouts:.4f} spikes per pixel and readout",
        "size": f"{Path(stream.path).stat().st_size * 8 / readouts:.3f} bit per pixel and frame",
        "focus": _describe_range(stream.focus_position, "of the travel"),
        "object in focus": _describe_range(stream.metadata.object_distance, "m"),
    }
    if stream.gain is not None:
        for name, gain in zip(stream.light_names, stream.gain.T, strict=True):
            facts[f"light {name}"] = f"gain {gain.min():.3g} to {gain.max():.3g}"
    truth = stream.truth
    if truth.known:
        near, far = truth.depth_of_focus
        facts["true focus"] = f"{truth.position:.5f} of the travel, {_describe_crossings(stream)}"
        facts["depth of focus"] = f"{near:.5f} to {far:.5f} of the travel"
    else:
        facts["true focus"] = "unknown"
    facts["grain"] = _describe_grain(stream)
    for name, text in stream.metadata.provenance.items():
        if name == "versions":
            facts["made with"] = ", ".join(f"{k} {v}" for k, v in json.loads(text).items())
        elif "\n" not in text:
            facts[name] = text
    facts["content sha256"] = stream.content_sha256
    return facts


def _describe_range(values: np.ndarray | None, unit: str) -> str:
    """Return the first and last value as text, and the extremes if the values turned back in between."""
    if values is None:
        return "not recorded"
    low, high, ends = values.min(), values.max(), (values[0], values[-1])
    if low == high:
        return f"{low:.4g} {unit} throughout"
    steps = np.diff(values)
    once = (steps >= 0).all() or (steps <= 0).all()
    text = f"{ends[0]:.4g} to {ends[1]:.4g} {unit}"
    return text if once else f"{text} with turns, within {low:.4g} to {high:.4g}"


def _describe_grain(stream: SpikeStream) -> str:
    """Return how much noise of the renderer is in the pictures behind a stream, as text."""
    grain = read_recorded_grain(stream.metadata.provenance)
    if grain is None or not math.isfinite(grain.rms_in_focus):
        return "unknown"
    low, high = grain.rms_range
    return f"{grain.rms_in_focus:.2%} of the mean in focus, {low:.2%} to {high:.2%} along the recording"


def _describe_crossings(stream: SpikeStream) -> str:
    first, lens, track = stream.truth.frame, stream.focus_position, stream.truth.track
    if not math.isfinite(first):
        return "never passed"
    truth = stream.truth.position if track is None else track
    times = 1 if lens is None else len(find_focus_crossings(lens.astype(np.float64) - truth, 0.0))
    return f"at frame {first:.1f}" + (f", the first of {times} times" if times > 1 else "")


def verify_dataset(folder: str | Path) -> tuple[int, dict[str, str]]:
    """Read every sequence of a dataset and compare it with the manifest.

    Returns the number of sequences, and the problem of each faulty one. Raises BadInput without a manifest.
    """
    manifest = read_manifest(folder)
    problems = {}
    for entry in manifest.sequences:
        try:
            verify_manifest_entry(folder, entry)
        except BadInput as error:
            problems[entry.id] = str(error)
    return len(manifest.sequences), problems
