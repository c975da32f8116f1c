"""The metadata of a stream file (everything except the spikes) and the digest of its content.

``content_sha256`` identifies the content of a file, however it is stored. It is the SHA-256 of a text: the lines
``readout_hz`` and ``frames``, then one line per dataset, sorted by name, with name, dtype, shape and the SHA-256 of the
values (little-endian, C order; text as UTF-8, each string followed by a zero byte). The values of ``/spikes`` are
hashed as consecutive time blocks of 250 bytes along time, each in C order, so that both writing and verifying can
stream. The group ``/provenance`` records how the content was made and is left out; the attribute ``provenance_sha256``
is the SHA-256 of its lines. Because ``spikes_sha256`` holds the hash of the spikes alone, all other datasets can be
checked when a file is opened.
"""

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from html import escape
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from saf_gen.camera.kinds import kinds_of_cameras
from saf_gen.core.region import Region, decile_pixels
from saf_gen.errors import BadInput, unknown

FORMAT = "saf-gen stream"
LAYOUT = 1
USUAL = {"bits": "spikes", "events": "events", "frames": "frames"}
"""Kind of the camera of a file of each form, if the file does not state another."""
"""What a 1 in a recording stands for: a spike of a pixel that integrates light, or a detection of a single photon."""
MAX_PIXELS = 1 << 22
"""Largest number of pixels per frame; a time block of 2,000 frames of this size takes a gigabyte."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The true focus, as far as it is known; unknown numbers are NaN, unknown arrays None.

    Parameters
    ----------
    position : float, default NaN
        Optical best focus of the target, as a fraction of the travel.
    depth_of_focus : tuple of float, default (NaN, NaN)
        The two positions at which the blur of the target equals the resolution of the camera in focus.
    frame : float, default NaN
        Fractional frame, from 0, at which the lens first passes ``position``.
    depth : ndarray of float32, shape (H, W), optional
        Depth map, in metres.
    target : ndarray of bool, shape (H, W), optional
        The pixels that should be in focus.
    best_position : ndarray of float32, shape (H, W), optional
        Position that brings each pixel into focus, as a fraction of the travel.
    sharpness : ndarray of float64, shape (K,), optional
        Variance of the box around the target, divided by its squared mean, without noise, at K evenly spaced positions;
        in a moving scene, each at the time when the lens first reaches the position.
    inside : tuple of int, optional
        First row, stop row, first column and stop column of the largest rectangle inside the target
        (:func:`saf_gen.core.region.inside_box`); in a moving scene, inside the target at all times at which the lens is
        near the focus (:func:`saf_gen.stack.true_focus.find_inside`).
    sharpness_inside : ndarray of float64, shape (K,), optional
        ``sharpness`` in that rectangle instead of the box.
    track : ndarray of float32, shape (T,), optional
        ``position`` in each frame of a moving scene, or under lamps of several colours whose mix changes; the fields
        before ``sharpness`` then hold at ``frame``.
    least_blur : float, optional
        Position of the least mean squared blur, for a lens with aberrations or axial colour; ``position`` is then that
        of the largest contrast.
    in_focus, least_blur_in_focus : tuple of float, optional
        Near and far position between which something of the target stays in focus, by contrast and by blur, for such a
        lens; see :attr:`whole_target` for all others.
    lens : ndarray of float32, shape (T,), optional
        Position of the lens in the middle of each readout, if it is not where its drive was told to be, or its sensor
        read it: ``Metadata.focus_position`` is then that log.
    """

    position: float = math.nan
    depth_of_focus: tuple[float, float] = (math.nan, math.nan)
    frame: float = math.nan
    depth: np.ndarray | None = None
    target: np.ndarray | None = None
    best_position: np.ndarray | None = None
    sharpness: np.ndarray | None = None
    inside: tuple[int, int, int, int] | None = None
    sharpness_inside: np.ndarray | None = None
    track: np.ndarray | None = None
    least_blur: float | None = None
    in_focus: tuple[float, float] | None = None
    least_blur_in_focus: tuple[float, float] | None = None
    lens: np.ndarray | None = None

    @property
    def known(self) -> bool:
        """True if the position of best focus is known."""
        return math.isfinite(self.position)

    @property
    def whole_target(self) -> tuple[float, float]:
        """Near and far position between which something of the target's middle 80 % of pixels is in focus.

        It is ``in_focus`` if that is given. Otherwise it follows from ``best_position``, with the same depth of focus
        for each pixel; if that is not given either, or the target is flat, it is ``depth_of_focus``.
        """
        if self.in_focus is not None:
            return self.in_focus
        low, high = sorted(self.depth_of_focus)
        if self.best_position is None or self.target is None or not self.target.any():
            return low, high
        best = self.best_position[self.target].astype(np.float64)
        first, last = (float(best[n]) for n in decile_pixels(best))
        if first == last or not math.isfinite(high - low):
            return low, high
        half = (high - low) / 2
        return min(low, first - half), max(high, last + half)

    def __repr__(self) -> str:
        return f"Truth({', '.join(f'{name}={text}' for name, text in self._known_fields().items())})"

    def _repr_html_(self) -> str:
        """Return the known fields as an HTML table for a notebook."""
        rows = "".join(
            f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in self._known_fields().items()
        )
        return f"<table>{rows}</table>"

    def _known_fields(self) -> dict[str, str]:
        """Return the known fields as text: numbers by value, arrays by dtype and shape."""
        held = {field.name: getattr(self, field.name) for field in fields(self)}
        known = {n: v for n, v in held.items() if v is not None and not np.isnan(np.asarray(v, float)).all()}
        return {n: f"{v.dtype} {v.shape}" if isinstance(v, np.ndarray) else repr(v) for n, v in known.items()}


@dataclass(frozen=True, eq=False)
class Metadata:
    """Everything that a stream file holds except the spikes; every field is optional.

    Parameters
    ----------
    focus_position : ndarray of float32, shape (T,), optional
        Log of the lens: its position in the middle of each readout, as a fraction of the travel, as the drive was told
        or its sensor read it.
    image_distance, object_distance : ndarray of float32, shape (T,), optional
        Distance from the lens to the sensor, and to the plane that is in focus, in metres, by that log.
    gain : ndarray of float32, shape (T, G), optional
        Gain of each light group in each readout; 1 is the nominal light.
    light_names : tuple of str, default ()
        Names of the G light groups.
    mask : ndarray of bool, shape (H, W), optional
        The bad pixels, which are filled in counts and pictures (:mod:`saf_gen.stream.pixel_mask`); not all.
    readout : ndarray of int64, shape (T,), optional
        Number of the camera's readout that each frame is: it begins with 0 and rises by more than 1 where readouts were
        lost. By default, frame t is readout t.
    kind : str, default ''
        Kind of the camera; by default the usual one of the file's form: ``spikes``, ``events`` or ``frames``. The
        shared spike of two windows, for which some measures correct, is in counts of spikes alone. A file holds the
        kind in ``/provenance/kind`` if it is another than these.
    truth : Truth, optional
        The true focus.
    provenance : mapping of str to str, optional
        How the stream was made, as texts by name.
    """

    focus_position: np.ndarray | None = None
    image_distance: np.ndarray | None = None
    object_distance: np.ndarray | None = None
    gain: np.ndarray | None = None
    light_names: tuple[str, ...] = ()
    mask: np.ndarray | None = None
    readout: np.ndarray | None = None
    kind: str = ""
    truth: Truth = field(default_factory=Truth)
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def lens_position(self) -> np.ndarray | None:
        """Where the lens was, float32 (T,): ``truth.lens``, or its log where nothing else is known; else None."""
        return self.focus_position if self.truth.lens is None else self.truth.lens

    def readout_of(self, frame: int) -> int:
        """Return the number of the camera's readout that a frame is, both counted from 0."""
        return int(frame) if self.readout is None else int(self.readout[frame])


# Field of Metadata or Truth -> dataset, dtype, axes (T, H, W, G lights, K positions).
ARRAY_DATASETS = {
    "focus_position": ("/focus/position", "float32", "T"),
    "image_distance": ("/focus/image_distance", "float32", "T"),
    "object_distance": ("/focus/object_distance", "float32", "T"),
    "gain": ("/light/gain", "float32", "TG"),
    "mask": ("/pixels/mask", "bool", "HW"),
    "readout": ("/time/readout", "int64", "T"),
    "position": ("/truth/position", "float64", ""),
    "depth_of_focus": ("/truth/depth_of_focus", "float64", "2"),
    "frame": ("/truth/frame", "float64", ""),
    "depth": ("/truth/depth", "float32", "HW"),
    "target": ("/truth/target", "bool", "HW"),
    "best_position": ("/truth/best_position", "float32", "HW"),
    "sharpness": ("/truth/sharpness", "float64", "K"),
    "inside": ("/truth/inside", "int64", "4"),
    "sharpness_inside": ("/truth/sharpness_inside", "float64", "K"),
    "track": ("/truth/track", "float32", "T"),
    "least_blur": ("/truth/least_blur", "float64", ""),
    "in_focus": ("/truth/in_focus", "float64", "2"),
    "least_blur_in_focus": ("/truth/least_blur_in_focus", "float64", "2"),
    "lens": ("/truth/lens", "float32", "T"),
}
_SCALARS = ("position", "depth_of_focus", "frame")
_IN_EVERY_FRAME = ("focus_position", "track", "lens")
"""Fields that must be finite in every readout if they are given, because all answers are judged by them."""


def _checked_array(name: str, value: Any, *, shape: tuple[int, int, int]) -> np.ndarray:
    _, dtype, axes = ARRAY_DATASETS[name]
    source = np.asarray(value)
    if source.dtype.kind not in "buif":
        raise BadInput(f"{name} has dtype {source.dtype}", allowed=f"numbers ({dtype})")
    known = dict(zip("THW", shape, strict=True)) | {"2": 2, "4": 4}
    wanted = tuple(known.get(axis, -1) for axis in axes)
    if source.ndim != len(axes) or any(w not in (-1, g) for w, g in zip(wanted, source.shape, strict=True)):
        text = ", ".join(str(w) if w >= 0 else f"any {axis}" for w, axis in zip(wanted, axes, strict=True))
        raise BadInput(f"{name} has shape {source.shape}", allowed=f"({text}) for T, H, W = {shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        converted = np.ascontiguousarray(source, dtype=dtype).reshape(source.shape)
    if source.dtype.kind == "f" and (beyond := np.isinf(converted) & np.isfinite(source)).any():
        raise BadInput(f"{name} holds {source[beyond].flat[0]:g}", allowed=f"numbers that {dtype} can hold")
    if name == "mask" and converted.all():
        raise BadInput("mask marks every pixel", allowed="at least one pixel that is not masked")
    if name == "readout":
        _check_readouts(source, converted)
    if name == "inside":
        _check_inside(source, converted, shape=shape)
    return converted


def _check_inside(source: np.ndarray, inside: np.ndarray, *, shape: tuple[int, int, int]) -> None:
    """Raise BadInput unless a rectangle has whole numbers of rows and columns, and lies in the frame."""
    top, bottom, left, right = inside.tolist()
    if (source != inside).any() or not (0 <= top < bottom <= shape[1] and 0 <= left < right <= shape[2]):
        raise BadInput(
            f"inside is {source.tolist()}",
            allowed=f"first and stop of rows, then of columns, whole numbers, in {shape[1]} rows, {shape[2]} columns",
        )


def _check_readouts(source: np.ndarray, readout: np.ndarray) -> None:
    """Raise BadInput unless the numbers of readouts are whole, begin with 0 and rise."""
    wrong = np.flatnonzero((readout != source) | (np.diff(readout, prepend=-1) < 1))
    if readout[0] != 0 or wrong.size:
        at = int(wrong[0]) if wrong.size else 0
        raise BadInput(f"readout is {source[at]} in frame {at}", allowed="whole numbers that rise, from 0")


def _check_finite(name: str, array: np.ndarray) -> None:
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise BadInput(
            f"{name} is not finite in {bad.size} of {len(array)} frames, first in frame {bad[0]}",
            allowed="a finite position in every frame",
            hint="fill the gaps, or leave the field out",
        )


def metadata_to_datasets(
    metadata: Metadata, shape: tuple[int, int, int]
) -> dict[str, np.ndarray | tuple[str, ...] | str]:
    """Check all datasets except ``/spikes`` and return them by name.

    Raises BadInput, naming the field, if a dtype, shape or text is not allowed, if a number is too large for its dtype,
    or if a position is not finite.
    """
    truth = metadata.truth
    held = {f: getattr(truth if hasattr(truth, f) else metadata, f) for f in ARRAY_DATASETS}
    if all(np.isnan(np.asarray(held[f], float)).all() for f in _SCALARS):
        held |= dict.fromkeys(_SCALARS)
    out: dict[str, Any] = {
        ARRAY_DATASETS[f][0]: _checked_array(f, v, shape=shape) for f, v in held.items() if v is not None
    }
    for f in _IN_EVERY_FRAME:
        if ARRAY_DATASETS[f][0] in out:
            _check_finite(f, out[ARRAY_DATASETS[f][0]])
    lights = tuple(_checked_text("light_names", name) for name in metadata.light_names)
    if lights:
        out["/light/names"] = lights
    _check_lights(out.get("/light/gain"), lights)
    if _checked_kind(metadata.kind) not in ("", *USUAL.values()):
        out["/provenance/kind"] = metadata.kind
    for name, text in metadata.provenance.items():
        if name == "kind":
            raise BadInput("provenance has the name 'kind'", allowed="any other name", hint="use the field kind")
        if not name or "/" in name or name.startswith("."):
            raise BadInput(f"provenance has the name {name!r}", allowed="names without '/', not starting with '.'")
        out[f"/provenance/{name}"] = _checked_text(f"provenance/{name}", text)
    return out


def _check_lights(gain: np.ndarray | None, lights: tuple[str, ...]) -> None:
    if gain is not None and lights and gain.shape[1] != len(lights):
        raise BadInput(f"gain has {gain.shape[1]} lights, light_names has {len(lights)}", allowed="the same number")


def in_words(kind: str) -> str:
    """Return what a recording of a camera of this kind holds."""
    return "single photons" if kind == "photons" else kind


def _checked_kind(kind: str) -> str:
    """Return a kind of camera, or ''; raise BadInput if there is no such kind."""
    if kind and kind not in kinds_of_cameras():
        raise unknown("kind of recording", kind, allowed=kinds_of_cameras())
    return kind


def _is_unicode(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:  # a lone surrogate, such as a byte of a file name that is not UTF-8
        return False
    return True


def _checked_text(name: str, text: object) -> str:
    if not isinstance(text, str) or "\0" in text or not _is_unicode(text):
        raise BadInput(f"{name} holds {text!r:.40}", allowed="Unicode text without zero bytes")
    return text


def _stream_digest_line(name: str, value: Any) -> str:
    """Return the line for a small dataset in the text that is hashed."""
    array = np.asarray(value)
    if array.dtype.kind in "OSU":
        strings = [s if isinstance(s, bytes) else str(s).encode() for s in array.ravel()]
        dtype, data = "text", b"".join(s + b"\0" for s in strings)
    else:
        dtype, data = array.dtype.name, array.astype(array.dtype.newbyteorder("<"), order="C").tobytes()
    return _format_digest_line(name, dtype, shape=array.shape, sha256=hashlib.sha256(data).hexdigest())


def stream_digest_lines(datasets: Iterable[tuple[str, Any]]) -> list[str]:
    """Return the lines of small datasets in the text that is hashed."""
    return [_stream_digest_line(name, value) for name, value in datasets]


def _format_digest_line(name: str, dtype: str, *, shape: tuple[int, ...], sha256: str) -> str:
    return f"{name} {dtype} {'x'.join(map(str, shape)) or 'scalar'} {sha256}"


def _stream_content_digest(lines: list[str], *, readout_hz: float, frames: int) -> str:
    """Return ``content_sha256`` from the lines of all datasets."""
    text = "\n".join([f"readout_hz {float(readout_hz)!r}", f"frames {frames}", *sorted(lines)])
    return hashlib.sha256(text.encode()).hexdigest()


def _stream_provenance_digest(lines: Iterable[str]) -> str:
    """Return ``provenance_sha256`` from the lines of all datasets in ``/provenance``."""
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


def stream_digests(
    datasets: Iterable[tuple[str, Any]], shape: tuple[int, int, int], *, spikes: str, readout_hz: float, frames: int
) -> tuple[str, str]:
    """Return ``content_sha256`` and ``provenance_sha256``.

    ``datasets`` are the names and values of all datasets except ``/spikes``; ``shape`` and ``spikes`` are the shape and
    the SHA-256 of ``/spikes``.
    """
    spikes_line = _format_digest_line("/spikes", "uint8", shape=shape, sha256=spikes)
    lines = stream_digest_lines(datasets)
    of_provenance = [line for line in lines if line.startswith("/provenance/")]
    content = [line for line in lines if not line.startswith("/provenance/")]
    return (
        _stream_content_digest([*content, spikes_line], readout_hz=readout_hz, frames=frames),
        _stream_provenance_digest(of_provenance),
    )


def metadata_from_options(options: Mapping[str, Any]) -> Metadata:
    """Return metadata from keyword arguments; ``truth`` may be a mapping. Raises BadInput if a name is unknown."""
    _check_names("optional field", options, known=Metadata)
    truth = options.get("truth")
    if isinstance(truth, Mapping):
        _check_names("field of truth", truth, known=Truth)
        options = {**options, "truth": Truth(**truth)}
    return Metadata(**{name: value for name, value in options.items() if value is not None})


def _check_names(what: str, names: Iterable[str], *, known: type) -> None:
    allowed = [f.name for f in fields(known)]
    for name in names:
        if name not in allowed:
            raise unknown(what, name, allowed=allowed)


def metadata_from_datasets(values: Mapping[str, Any], shape: tuple[int, int, int], *, form: str) -> Metadata:
    """Return metadata from the small datasets of a file of this form: the inverse of :func:`metadata_to_datasets`.

    Raises BadInput, naming the field, if a dtype, shape or value is not allowed.
    """
    stored = {f: values[name] for f, (name, _, _) in ARRAY_DATASETS.items() if name in values}
    found: dict[str, Any] = {f: _checked_array(f, value, shape=shape) for f, value in stored.items()}
    truth = {f: found.pop(f) for f in tuple(found) if f in Truth.__dataclass_fields__}
    for name in ("position", "frame", "least_blur"):
        if name in truth:
            truth[name] = float(truth[name])
    for name in ("depth_of_focus", "in_focus", "least_blur_in_focus"):
        if name in truth:
            near, far = truth[name]
            truth[name] = (float(near), float(far))
    if "inside" in truth:
        truth["inside"] = tuple(truth["inside"].tolist())
    provenance = {n.removeprefix("/provenance/"): str(v) for n, v in values.items() if n.startswith("/provenance/")}
    kind = _checked_kind(provenance.pop("kind", "")) or USUAL[form]
    lights = tuple(str(name) for name in values.get("/light/names", ()))
    _check_lights(found.get("gain"), lights)
    return Metadata(**found, light_names=lights, kind=kind, truth=Truth(**truth), provenance=provenance)


class ReadableStream(Protocol):
    """An open recording and its metadata, such as a :class:`saf_gen.stream.stream_file.SpikeStream`.

    ``form`` is that of its file: ``bits``, ``events`` or ``frames``; ``counted`` is the kind of its camera, which says
    what a count is of: ``spikes``, ``photons``, ``events``, ``frames``, or another.
    """

    @property
    def form(self) -> str: ...

    @property
    def counted(self) -> str: ...

    path: Path
    shape: tuple[int, int, int]
    readout_hz: float
    content_sha256: str
    metadata: Metadata
    truth: Truth
    focus_position: np.ndarray | None
    gain: np.ndarray | None
    light_names: tuple[str, ...]

    def frames(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray: ...

    def counts(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray: ...

    def packed(self, first_byte: int, stop_byte: int, *, region: Region | None = None) -> np.ndarray: ...

    def texture(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray: ...
