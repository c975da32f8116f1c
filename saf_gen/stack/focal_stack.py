"""Focal stacks, which hold the radiance of a scene at every focus position under each light group, and their storage.

On disk a stack is a folder of OpenEXR files. Its name is derived from its content (scene, lens, sensor grid, positions,
samples), so every sequence that needs it finds it, and nothing is rendered twice. Reading a stack needs no renderer.

The stack of a static scene is stored as float32. Time slices, of which a moving scene has hundreds, and a stack whose
recipe says ``half_floats`` are stored as float16, compressed without loss in blocks of neighbouring positions. Rounding
changes values by at most 0.05 %, far less than their noise, and halves the disk space; compression leaves a half to
three quarters of that.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from saf_gen.core import exr
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.files import atomic_file
from saf_gen.errors import BadInput
from saf_gen.optics import Drive, FocusCriterion, drive_from_dict
from saf_gen.optics.partial_coherence import check_lens
from saf_gen.optics.typical_aberrations import with_typical_aberrations
from saf_gen.scene.scene_folder import Scene

FORMAT = "saf-gen focal stack 2"
UNIT = "W m^-2 sr^-1 at gain 1"
MAX_SIDE = 1 << 13
"""Largest number of rows, columns or positions that an untrusted note may state."""
LAYERED_POSITIONS = 16
"""Largest number of rendered positions whose paths the filtered estimator sums in layers."""
LAYERS_VERSION = 2
"""Version of these sums, raised whenever the same paths would give another picture. 1 moved the outlines before blurred
surfaces."""
WAVES = "waves"
"""The estimator of thin sections."""
PICTURES = "pictures"
"""In place of an estimator: the stack was not rendered but photographed."""
HALF_BITS = 15  # the largest half float is just below 2^16


class PixelGrid(Protocol):
    """The pixels of a sensor: numbers of rows and columns, and the pitch in metres."""

    @property
    def rows(self) -> int: ...

    @property
    def columns(self) -> int: ...

    @property
    def pitch_m(self) -> float: ...


@dataclass(frozen=True)
class StackSpec:
    """Everything that determines a stack; its :attr:`key` is the name of the folder.

    Attributes
    ----------
    scene, scene_digest : str
        Name of the scene, and digest of its files.
    groups : tuple of str
        Names of the light groups.
    drive : Drive
        Focus drive of the lens.
    rows, columns : int
        Size of the sensor, in pixels.
    pitch_m : float
        Pixel pitch, in metres.
    positions : int
        Number of focus positions, evenly spaced over the full travel.
    samples : int
        Smallest number of light paths per pixel and position.
    max_depth : int
        Longest light path, in segments.
    params : str, default '{}'
        Parameters of the member of the scene's family, as JSON.
    time_s : float, default 0.0
        Moment of the scene, in seconds.
    window : tuple of int, optional
        Index of the first and the last position to render; a time slice needs only some.
    wavelength_m : float, default 0.0
        Wavelength (m) of the light, which is diffracted at the aperture; 0 for geometric optics.
    estimator : str, default 'filtered'
        'filtered' or 'plain', the way in which llvm and cuda find radiance from light paths; scalar is always plain.
        'waves' for a thin section, whose pictures are computed without light paths; samples and max_depth are 1.
        'pictures' for a stack that was photographed; its unit is arbitrary, and its depth is NaN.
    moments_s : tuple of float, default ()
        Moments (s) whose light paths the filtered estimator uses to find the shading of surfaces; the last is the
        moment of the stack. If empty, only paths of this moment are used.
    layers : int, default LAYERS_VERSION
        Version of the sums in layers; it counts only if there are any: for at most LAYERED_POSITIONS, the filtered
        estimator, and a lens without aberrations and vignetting.
    margin : tuple of int, default (0, 0)
        Positions beyond either end of the travel, evenly spaced like the others, from which a lens with axial colour
        draws in light of other wavelengths (:mod:`saf_gen.stack.colour`).
    """

    scene: str
    scene_digest: str
    groups: tuple[str, ...]
    drive: Drive
    rows: int
    columns: int
    pitch_m: float
    positions: int
    samples: int
    max_depth: int
    params: str = "{}"
    time_s: float = 0.0
    window: tuple[int, int] | None = None
    wavelength_m: float = 0.0
    estimator: str = "filtered"
    moments_s: tuple[float, ...] = ()
    layers: int = LAYERS_VERSION
    margin: tuple[int, int] = (0, 0)

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        grid: PixelGrid,
        *,
        positions: int,
        samples: int,
        max_depth: int,
        time_s: float,
        wavelength_m: float,
        estimator: str = "filtered",
        groups: Iterable[str] | None = None,
        f_number: float | None = None,
        aberrations: str | None = None,
        window: tuple[int, int] | None = None,
    ) -> "StackSpec":
        """Return the spec of a member of a scene's family in front of a sensor.

        A thin section has its own wavelength, samples, depth of paths and estimator.

        Parameters
        ----------
        scene : Scene
            Member of the family.
        grid : PixelGrid
            Pixels of the sensor.
        groups : iterable of str, optional
            Light groups; by default all.
        f_number : float, optional
            F-number; by default the card's.
        aberrations : {'none', 'mild', 'strong'}, optional
            Typical aberrations in place of the card's (:mod:`saf_gen.optics.typical_aberrations`).
        positions, samples, max_depth, time_s, wavelength_m, estimator, window
            See :class:`StackSpec`.

        Raises
        ------
        BadInput
            If the travel is impossible, diffraction keeps all of it in focus, or the aberrations cannot be shown.
        """
        drive, section = scene.build_drive(f_number), scene.card.section
        if section is not None:
            wavelength_m, estimator, samples, max_depth = section.wavelength_nm * 1e-9, WAVES, 1, 1
        drive.check_wave_depth(wavelength_m)
        size = {"rows": grid.rows, "columns": grid.columns}
        if aberrations is not None:
            drive = with_typical_aberrations(FocusCriterion(drive, grid.pitch_m, wavelength_m), aberrations, **size)
        if section is not None:
            check_lens(drive)
        else:
            FocusCriterion(drive, grid.pitch_m, wavelength_m).check(**size)
        return cls(
            scene=scene.id,
            scene_digest=scene.digest,
            groups=tuple(scene.card.lights if groups is None else groups),
            drive=drive,
            rows=grid.rows,
            columns=grid.columns,
            pitch_m=grid.pitch_m,
            positions=positions,
            samples=samples,
            max_depth=max_depth,
            params=json.dumps(dict(scene.params), sort_keys=True),
            time_s=time_s,
            window=window,
            wavelength_m=wavelength_m,
            estimator=estimator,
        )

    def without_diffraction(self) -> "StackSpec":
        """Return this spec with light paths that are not bent; one of a thin section as it is."""
        return self if self.estimator == WAVES else replace(self, wavelength_m=0.0)

    @cached_property
    def key(self) -> str:
        """Name of the scene and digest of this spec, which depends on neither seed nor backend."""
        text = json.dumps([FORMAT, self.as_dict(), *(["half"] if self.window else [])], sort_keys=True)
        return f"{self.scene}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"

    def as_dict(self) -> dict[str, Any]:
        """Return the spec as plain data, including the kind of the drive.

        ``layers`` is there if it counts and is not 1, and ``margin`` if there is one.
        """
        values = {**{field.name: getattr(self, field.name) for field in fields(self)}, "drive": self.drive.as_dict()}
        few = self.rendered_count <= LAYERED_POSITIONS
        perfect = self.drive.fills_its_aperture_perfectly
        if self.layers == 1 or not few or self.estimator != "filtered" or not perfect:
            del values["layers"]
        if self.margin == (0, 0):
            del values["margin"]
        return values

    @classmethod
    def read(cls, root: Path, key: str) -> "StackSpec":
        """Return the spec of the stack ``key`` under ``root``. Raises BadInput if it is missing or damaged."""
        path = root / key / "geometry.json"
        try:
            if Path(key).name != key:  # an untrusted stream names its stack, which must not be a path to elsewhere
                raise ValueError(key)
            fields = load_plain_json(path)["spec"]
            window = fields.pop("window")
            fields |= {"drive": drive_from_dict(fields["drive"]), "groups": tuple(fields["groups"])}
            fields |= {name: tuple(fields[name]) for name in ("moments_s", "margin") if name in fields}
            spec = cls(**fields, window=None if window is None else tuple(window))
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            raise BadInput(
                f"there is no focal stack {key} under {root}",
                hint="keep stacks/ next to the streams, or run saf-gen generate again",
            ) from error
        sizes = (spec.rows, spec.columns, spec.positions)
        wide = spec.rendered_count - spec.positions
        if not all(type(size) is int and 0 < size <= MAX_SIDE for size in sizes) or not wide <= MAX_SIDE:
            raise BadInput(f"{path} states {sizes}", allowed=f"rows, columns and positions from 1 to {MAX_SIDE}")
        if "layers" not in fields and spec.key != key:
            spec = replace(spec, layers=1)
        if spec.key != key:
            raise BadInput(f"{path} describes another stack, {spec.key}", hint="run saf-gen generate again")
        return spec

    @property
    def in_focus(self) -> FocusCriterion:
        """What counts as in focus."""
        return FocusCriterion(self.drive, self.pitch_m, self.wavelength_m)

    @property
    def focus(self) -> np.ndarray:
        """Rendered positions, as fractions of the travel, float64 (focus,)."""
        return focus_positions(self.positions, self.first_index, count=self.rendered_count)

    @property
    def indices(self) -> tuple[int, int] | None:
        """Index of the first and the last rendered position; None if they are those of the travel."""
        if self.window is None and self.margin == (0, 0):
            return None
        return self.first_index, self.first_index + self.rendered_count - 1

    @property
    def drawn(self) -> range:
        """Indices of the positions at which the lens can draw in light of any wavelength: all but the margin."""
        before, after = self.margin
        return range(self.first_index + before, self.first_index + self.rendered_count - after)

    @property
    def first_index(self) -> int:
        """Index of the first rendered position among all positions."""
        return self.window[0] if self.window else -self.margin[0]

    @property
    def rendered_count(self) -> int:
        """Number of rendered positions."""
        return self.window[1] - self.window[0] + 1 if self.window else self.positions + sum(self.margin)

    def over_travel(self) -> "StackSpec":
        """Return the spec of a time slice over the full travel and its margin."""
        before, after = self.margin
        return replace(self, window=(-before, self.positions - 1 + after))


def focus_positions(positions: int, first: int, *, count: int) -> np.ndarray:
    """Return ``count`` focus positions from the index ``first`` on, as fractions of the travel, float64 (focus,).

    They are evenly spaced: ``positions`` over the travel, and more beyond its ends.
    """
    inside = np.linspace(0, 1, positions)
    index = np.arange(first, first + count)
    return np.where(
        (index < 0) | (index >= positions), index / (positions - 1), inside[np.clip(index, 0, positions - 1)]
    )


@dataclass(frozen=True)
class FocalStack:
    """The images of a stack, at the rendered positions.

    Attributes
    ----------
    spec : StackSpec
        Everything that determined the stack when it was rendered.
    radiance : ndarray of float32, shape (light, focus, row, col)
        Radiance in W m⁻² sr⁻¹ at gain 1.
    depth : ndarray of float32, shape (row, col)
        Depth map, in metres.
    target : ndarray of bool, shape (row, col)
        Pixels of the target.
    backend : str
        Backend that rendered the stack.
    digest : str, default ''
        SHA-256 of the stored pieces; '' for a stack that was never stored.
    """

    spec: StackSpec
    radiance: np.ndarray
    depth: np.ndarray
    target: np.ndarray
    backend: str
    digest: str = ""

    def without_margin(self) -> "FocalStack":
        """Return the stack without the positions beyond the travel, for pictures of it."""
        spec = self.spec
        if spec.margin == (0, 0):
            return self
        first = spec.drawn.start - spec.first_index
        window = None if spec.window is None else (spec.drawn.start, spec.drawn.stop - 1)
        return replace(
            self,
            spec=replace(spec, margin=(0, 0), window=window),
            radiance=self.radiance[:, first : first + len(spec.drawn)],
        )


class StackStore:
    """The folder of one stack, written piece by piece.

    A piece (a light group, or 'geometry') is ``<name>.exr`` with a note ``<name>.json``, which holds its digest and
    states how it was made. A piece whose digest does not match counts as missing.
    """

    def __init__(self, root: Path, spec: StackSpec) -> None:
        self.folder, self.spec = root / spec.key, spec
        self.pieces = ("geometry", *spec.groups)

    def missing_pieces(self) -> list[str]:
        """Return the names of the pieces that are missing or damaged."""
        return [name for name in self.pieces if not self._is_complete(name)]

    def has_all_notes(self) -> bool:
        """Return whether all pieces have a note, even if their pictures have been deleted."""
        return all(self._note(name) for name in self.pieces)

    def has_all_pictures(self) -> bool:
        """Return whether all pieces exist with their notes; their contents are checked when they are read."""
        return self.has_all_notes() and all((self.folder / f"{name}.exr").is_file() for name in self.pieces)

    def delete_pictures(self) -> int:
        """Delete all pictures, keep the notes that describe them, and return the number of bytes that this frees.

        The digest stays the same, so a recording still shows that it was made from this stack.
        """
        return sum(_delete(self.folder / f"{name}.exr") for name in self.pieces)

    def delete(self) -> int:
        """Delete the stack, including its notes, and return the number of bytes that this frees."""
        freed = self.delete_pictures() + sum(_delete(self.folder / f"{name}.json") for name in self.pieces)
        with suppress(OSError):  # not empty: it holds something else
            self.folder.rmdir()
        return freed

    def digest(self) -> str:
        """Return a SHA-256 over the digests of the pieces, as their notes state them."""
        digests = json.dumps([self.piece_digest(name) for name in self.pieces])
        return hashlib.sha256(digests.encode()).hexdigest()

    def piece_digest(self, name: str) -> object:
        """Return the SHA-256 of a piece, as its note states it; None if it has none."""
        return self._note(name).get("sha256")

    def backends(self) -> set[str]:
        """Return the backends that rendered the stored pieces."""
        return {str(note["variant"]) for note in map(self._note, self.pieces) if "variant" in note}

    def scene_sums(self) -> list[tuple[float, ...]]:
        """Return the sums in the notes of the pieces, by which :mod:`saf_gen.stack.same_scene` compares scenes."""
        notes = [note["sums"] for note in map(self._note, self.pieces) if "sums" in note]
        return [tuple(map(float, sums)) for sums in notes if isinstance(sums, list)]

    def write_group(
        self, group: str, radiance: np.ndarray, *, backend: str, clipped: int = 0, sums: Sequence[float] = ()
    ) -> None:
        """Store the radiance of a light group, (focus, row, col).

        The note holds the number of paths clipped as fireflies, and the sums of what the scene's script returned.
        """
        facts = {"unit": UNIT, "light_group": group, "clipped_paths": str(clipped), "variant": backend}
        if self.spec.window:
            radiance, exponent = _to_half_floats(radiance)
            facts |= {"unit": f"2^{exponent} {UNIT}", "exponent": str(exponent)}
        planes = {f"focus.{self.spec.first_index + k:04d}": plane for k, plane in enumerate(radiance)}
        self._put(group, planes, facts=facts, sums=sums)

    def write_geometry(
        self, depth: np.ndarray, target: np.ndarray, *, backend: str, sums: Sequence[float] = ()
    ) -> None:
        """Store the depth (m) and the target mask, both (row, col), and in the note the sums of the script's result."""
        planes = {"depth": depth, "target": target.astype(np.float32)}
        self._put("geometry", planes, facts={"unit": "m", "variant": backend}, sums=sums)

    def load(self) -> FocalStack:
        """Return the complete stack. Raises BadInput if a piece is missing or damaged."""
        radiance = self.load_planes(0, self.spec.rendered_count)
        backend = ", ".join(sorted(self.backends()))
        return FocalStack(self.spec, radiance, *self.load_geometry(), backend, self.digest())

    def load_planes(self, first: int, stop: int) -> np.ndarray:
        """Return the radiance of rendered positions first <= k < stop, float32 (light, focus, row, col).

        Raises BadInput if a piece is missing or damaged.
        """
        if missing := self.missing_pieces():
            raise BadInput(f"{self.folder} lacks {', '.join(missing)}", hint="run saf-gen generate again")
        names = [f"focus.{self.spec.first_index + k:04d}" for k in range(first, stop)]
        radiance = np.empty((len(self.spec.groups), len(names), self.spec.rows, self.spec.columns), np.float32)
        for g, group in enumerate(self.spec.groups):
            planes, facts = exr.read_planes(self.folder / f"{group}.exr", names)
            for k, name in enumerate(names):
                radiance[g, k] = planes[name]
            if exponent := int(facts.get("exponent", 0)):
                radiance[g] *= np.float32(2.0**exponent)
        return radiance

    def load_geometry(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the depth (m, float32) and the target mask (bool), both (row, col).

        Raises BadInput if they are missing or damaged.
        """
        if not self._is_complete("geometry"):
            raise BadInput(f"{self.folder} lacks geometry", hint="run saf-gen generate again")
        planes, _ = exr.read_planes(self.folder / "geometry.exr")
        return planes["depth"], planes["target"] > 0.5

    def _note(self, name: str) -> dict[str, object]:
        try:
            note = load_plain_json(self.folder / f"{name}.json")
        except ValueError:
            return {}  # no note, or a truncated one: the piece counts as missing
        return note if isinstance(note, dict) else {}

    def _is_complete(self, name: str) -> bool:
        note, path = self._note(name), self.folder / f"{name}.exr"
        if not note or not path.is_file():
            return False
        status = path.stat()
        return _sha256(path, size=status.st_size, changed_ns=status.st_mtime_ns) == note.get("sha256")

    def _put(self, name: str, planes: dict[str, np.ndarray], *, facts: dict[str, str], sums: Sequence[float]) -> None:
        with atomic_file(self.folder / f"{name}.exr") as part:
            drive = json.dumps(self.spec.drive.as_dict())
            attributes = {"format": FORMAT, "stack": self.spec.key, "drive": drive, **facts}
            if self.spec.window:
                block_size = 1 if name == "geometry" else exr.BLOCK
                exr.write_plane_blocks(part, planes, attributes=attributes, block_size=block_size)
            else:
                exr.write_planes(part, planes, attributes=attributes)
            sha256 = hashlib.sha256(part.read_bytes()).hexdigest()
        note: dict[str, object] = {"format": FORMAT, **facts, "sha256": sha256, "spec": self.spec.as_dict()}
        if sums:
            note["sums"] = list(sums)
        with atomic_file(self.folder / f"{name}.json") as part:
            part.write_text(json.dumps(note, indent=1))


def _delete(path: Path) -> int:
    """Delete a file and return its size, or 0 if it does not exist."""
    try:
        size = path.stat().st_size
        path.unlink()
    except FileNotFoundError:
        return 0
    return size


def _to_half_floats(radiance: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the radiance as float16 in units of 2^exponent, and the exponent.

    The largest value is below 2^15. Values of at least 4·10^-9 times the largest keep all 11 bits.
    """
    exponent = int(np.frexp(radiance.max(initial=0.0))[1]) - HALF_BITS
    return np.ldexp(radiance, -exponent).astype(np.float16), exponent


@lru_cache(maxsize=1 << 14)
def _sha256(path: Path, *, size: int, changed_ns: int) -> str:
    """Return the digest of a file; it is read again only if its size or modification time differs.

    The cache is large because a moving scene has hundreds of stacks, and each method needs all of them.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()
