"""Descriptions of streams: their content and their provenance in words, and both as numbers for programs."""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.plain_text import plural
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.stream.event_file import EventFile
from saf_gen.stream.frame_file import FrameFile
from saf_gen.stream.measure_input import inside_of
from saf_gen.stream.metadata import USUAL, Metadata, ReadableStream, in_words
from saf_gen.stream.recorded_grain import grain_of_stream

RATE_BLOCKS = 50
"""Largest number of parts into which a recording is divided to compare their mean rates."""


def describe_content(stream: ReadableStream | EventFile | FrameFile, *, with_rates: bool = True) -> dict[str, str]:
    """Return facts about a stream's content as texts by name: length, rates, light, lens and truth.

    All spikes are read if ``with_rates`` is true, and none otherwise.
    """
    frames, rows, columns = stream.shape
    length = stream.metadata.readout_of(frames - 1) + 1
    planned = _read_json(stream, "sequence")
    scene = [str(planned[key]) for key in ("scene", "scene_motion") if key in planned]
    facts = {"scene": ", ".join(scene)} if scene else {}
    facts |= {
        **({} if stream.counted == USUAL[stream.form] else {"kind": in_words(stream.counted)}),
        "pixels": f"{columns}×{rows}",
        "frames": f"{frames} at {stream.readout_hz:g} Hz ({length / stream.readout_hz:g} s)",
        **(_describe_rates(stream) if with_rates and not isinstance(stream, EventFile | FrameFile) else {}),
        **describe_flaws(stream.metadata),
    }
    if "light" in planned:
        facts["light"] = str(planned["light"])
    if stream.gain is not None:
        names = stream.light_names or [f"{n + 1}" for n in range(stream.gain.shape[1])]
        for name, gain in zip(names, stream.gain.T, strict=True):
            facts[f"light {name}"] = f"gain {gain.min():.3g} to {gain.max():.3g}"
    if isinstance(planned.get("motion"), dict):
        facts["lens motion"] = str(planned["motion"].get("kind", ""))
    if stream.truth.lens is not None and stream.focus_position is not None:
        facts["lens"] = _describe_lens(stream.truth.lens, stream.focus_position)
    facts["focus"] = _describe_range(stream.focus_position, "of the travel")
    facts["object in focus"] = _describe_range(stream.metadata.object_distance, "m")
    truth = stream.truth
    facts["true focus"] = "unknown"
    if truth.known:
        facts["true focus"] = f"{truth.position:.5f} of the travel, {_describe_crossings(stream)}"
        if truth.track is not None:
            facts["true focus"] += f"; it moves from {truth.track[0]:.5f} to {truth.track[-1]:.5f}"
    if truth.least_blur is not None:
        facts["least blur"] = f"{truth.least_blur:.5f} of the travel: the lens has aberrations or colour"
        if truth.least_blur_in_focus is not None:
            near, far = truth.least_blur_in_focus
            facts["least blur"] += f"; within a resolved width from {near:.5f} to {far:.5f}"
    if all(map(math.isfinite, truth.depth_of_focus)):
        near, far = truth.depth_of_focus
        facts["depth of focus"] = f"{near:.5f} to {far:.5f} of the travel{_describe_time_in_focus(stream)}"
        if truth.whole_target != (near, far):
            first, last = truth.whole_target
            facts["target in focus"] = f"{first:.5f} to {last:.5f} of the travel, something of its middle 80 %"
    if truth.target is not None:
        facts["target"] = f"{np.mean(truth.target):.1%} of the pixels"
        facts["inside it"] = "no rectangle that is large enough"
        if (inside := inside_of(truth)) is not None:
            (top, bottom), (left, right) = ((span.start, span.stop - 1) for span in inside)
            facts["inside it"] = f"rows {top} to {bottom}, columns {left} to {right}"
    facts["grain"] = _describe_grain(stream)
    return facts


def describe_events(events: EventFile) -> dict[str, str]:
    """Return facts about the content of an event file as texts by name: events, light, lens and truth."""
    facts = describe_content(events, with_rates=False)
    pixels, seconds = math.prod(events.shape[1:]), events.seconds
    facts |= {
        "frames": f"none: {events.count:,} events in {seconds:g} s, {events.count / pixels / seconds:.3g} Hz per pixel",
        "rises": f"{events.rises() / max(events.count, 1):.1%} of the events",
    }
    if events.count:
        counts = events.counts_of_ms()
        facts["busiest"] = (
            f"{int(counts.argmax())} ms after the beginning, {int(counts.max()):,} events in a millisecond"
        )
    if (full := events.bus_full_s) is not None:
        facts["bus"] = f"full for {1e3 * full:.4g} ms, {full / seconds:.2%} of the time" if full else "never full"
    return facts


def describe_frames(frames: FrameFile) -> dict[str, str]:
    """Return facts about the content of a frame camera's file as texts by name: numbers, light, lens and truth."""
    facts = describe_content(frames, with_rates=False)
    means, darkest, brightest = [], 1 << 16, 0
    for number in range(frames.shape[0]):
        frame = frames.frames(number, number + 1)
        means.append(float(frame.mean()))
        darkest, brightest = min(darkest, int(frame.min())), max(brightest, int(frame.max()))
    facts["numbers"] = f"{darkest} to {brightest}; means of frames {min(means):.1f} to {max(means):.1f}"
    facts["black level"] = f"{frames.black_level_dn}, in all numbers; windows and measures take it off"
    return facts


def describe_provenance(stream: ReadableStream | EventFile | FrameFile) -> dict[str, str]:
    """Return facts about a stream's provenance as texts by name: size on the disk, versions, seeds and digests."""
    facts = {"size": f"{stream.path.stat().st_size * 8 / math.prod(stream.shape):.3f} bit per pixel and frame"}
    for name, text in stream.metadata.provenance.items():
        if name == "versions":
            facts["made with"] = ", ".join(f"{k} {v}" for k, v in _read_json(stream, name).items())
        elif "\n" not in text:
            facts[name] = text
    facts["content sha256"] = stream.content_sha256
    return facts


def describe_in_numbers(stream: ReadableStream | EventFile | FrameFile) -> dict[str, Any]:
    """Return what a stream holds and how it was made, as values of JSON; what is not known is null or missing.

    Ranges and ends are lists of two numbers; positions are fractions of the travel. ``mean_rate`` is in spikes per
    pixel and readout, of which all are read.
    """
    frames, rows, columns = stream.shape
    metadata, truth, grain = stream.metadata, stream.truth, grain_of_stream(stream.metadata.provenance)
    readouts = metadata.readout_of(frames - 1) + 1
    facts: dict[str, Any] = {
        "kind": stream.counted,
        "rows": rows,
        "columns": columns,
        "frames": frames,
        "readout_hz": stream.readout_hz,
        "seconds": readouts / stream.readout_hz,
        "lost_readouts": readouts - frames,
        "masked_pixels": 0 if metadata.mask is None else int(np.count_nonzero(metadata.mask)),
    }
    if isinstance(stream, EventFile):
        facts |= {"events": stream.count, "rises": stream.rises()}
    elif not isinstance(stream, FrameFile):
        facts["mean_rate"] = stream.counts(0, frames).mean() / frames
    if stream.gain is not None:
        names = stream.light_names or [f"{n + 1}" for n in range(stream.gain.shape[1])]
        facts["gain"] = {name: [gain.min(), gain.max()] for name, gain in zip(names, stream.gain.T, strict=True)}
    for name in ("focus_position", "image_distance", "object_distance"):
        if (values := getattr(metadata, name)) is not None:
            facts[name] = [values[0], values[-1]]
    facts["truth"] = {"position": truth.position, "frame": truth.frame, "depth_of_focus": truth.depth_of_focus}
    if truth.least_blur is not None:
        facts["truth"]["least_blur"] = truth.least_blur
    if truth.target is not None:
        facts["truth"]["target"] = np.mean(truth.target)
        inside = inside_of(truth)
        facts["truth"]["inside"] = inside and [end for span in inside for end in (span.start, span.stop)]
    if grain is not None:
        facts["grain"] = {"rms_in_focus": grain.rms_in_focus, "rms_range": grain.rms_range}
    making = {name: _read_json(stream, name) or text for name, text in metadata.provenance.items()}
    return _plain(
        facts | {"provenance": making, "bytes": stream.path.stat().st_size, "content_sha256": stream.content_sha256}
    )


def _plain(value: Any) -> Any:
    """Return a value of JSON: numbers of numpy as those of Python, and those that are not finite as None."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    number = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(number, float) and not math.isfinite(number) else number


def _read_json(stream: ReadableStream | EventFile | FrameFile, name: str) -> dict[str, Any]:
    """Return a JSON object from the provenance; an empty one if the text is missing or holds anything else."""
    try:
        found = load_plain_json(stream.metadata.provenance.get(name, "{}"))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def describe_flaws(metadata: Metadata) -> dict[str, str]:
    """Return as texts by name how many bad pixels are masked and how many readouts are lost, if any are."""
    flaws = {}
    if (mask := metadata.mask) is not None:
        bad = plural(int(np.count_nonzero(mask)), "bad pixel")
        flaws["mask"] = f"{bad} ({np.mean(mask):.2%}), filled in counts and pictures"
    if (readout := metadata.readout) is not None:
        gaps = np.count_nonzero(np.diff(readout) > 1)
        flaws["lost readouts"] = f"{readout[-1] + 1 - readout.size} in {gaps} {'gap' if gaps == 1 else 'gaps'}"
    return flaws


def _describe_rates(stream: ReadableStream) -> dict[str, str]:
    frames = stream.shape[0]
    edges = np.unique(np.linspace(0, frames, min(RATE_BLOCKS, frames) + 1).astype(int)).tolist()
    total, rates = np.zeros(stream.shape[1:], np.int64), []
    for first, stop in pairwise(edges):
        counts = stream.counts(first, stop)
        rates.append(counts.mean() / (stop - first))
        total += counts
    low, high = np.quantile(total / frames, [0.01, 0.99])
    silent = int((total == 0).sum())
    return {
        "mean rate": f"{total.mean() / frames:.4f} {in_words(stream.counted)} per pixel and readout",
        "rate over time": f"{min(rates):.3g} to {max(rates):.3g}, in {len(rates)} parts of the recording",
        "rate of pixels": f"{low:.3g} to {high:.3g} for 98 % of them"
        + (f", {silent} of {total.size} never fire" if silent else ""),
    }


def _describe_time_in_focus(stream: ReadableStream | EventFile | FrameFile) -> str:
    """Return as text the fraction of frames in which the lens is within the depth of focus; '' if it is unknown."""
    lens, truth = stream.metadata.lens_position, stream.truth
    if lens is None or not truth.known:
        return ""
    offset = lens.astype(np.float64) - (truth.position if truth.track is None else truth.track)
    near, far = sorted(truth.depth_of_focus)
    within = (offset >= near - truth.position) & (offset <= far - truth.position)
    return f", where the lens is in {np.mean(within):.1%} of the frames"


def _describe_range(values: np.ndarray | None, unit: str) -> str:
    """Return the first and last value as text, with the extremes if the values are not monotonic."""
    if values is None:
        return "not recorded"
    low, high, ends = values.min(), values.max(), (values[0], values[-1])
    if low == high:
        return f"{low:.4g} {unit} throughout"
    steps = np.diff(values)
    once = (steps >= 0).all() or (steps <= 0).all()
    text = f"{ends[0]:.4g} to {ends[1]:.4g} {unit}"
    return text if once else f"{text}, reversing within {low:.4g} to {high:.4g}"


def _describe_lens(lens: np.ndarray, log: np.ndarray) -> str:
    """Return as text where the lens was, and how far that is from its log."""
    off = np.abs(lens.astype(np.float64) - log)
    return f"{_describe_range(lens, 'of the travel')}, {off.mean():.4f} off its log, at most {off.max():.4f}"


def _describe_grain(stream: ReadableStream | EventFile | FrameFile) -> str:
    """Return as text the grain of the pictures from which a stream was recorded."""
    grain = grain_of_stream(stream.metadata.provenance)
    if grain is None or not math.isfinite(grain.rms_in_focus):
        return "unknown"
    low, high = grain.rms_range
    return f"{grain.rms_in_focus:.2%} of the mean in focus, {low:.2%} to {high:.2%} along the recording"


def _describe_crossings(stream: ReadableStream | EventFile | FrameFile) -> str:
    first, lens, track = stream.truth.frame, stream.metadata.lens_position, stream.truth.track
    if not math.isfinite(first):
        return "never passed"
    truth = stream.truth.position if track is None else track
    times = 1 if lens is None else len(focus_crossings(lens.astype(np.float64) - truth, 0.0))
    return f"at frame {first:.1f}" + (f", the first of {times} times" if times > 1 else "")
