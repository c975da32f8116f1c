"""A focal stack: the scene at every focus position, each light group alone; and where it is stored.

On disk a stack is a folder of OpenEXR files named by its content (scene, lens, film, positions, samples),
so that every sequence that needs it finds it and nothing is rendered twice. Reading one needs no renderer.

A scene at rest is stored as float32. Time slices, of which a scene that moves has hundreds, are half floats:
a rounding of at most 0.05 %, far below their noise, for half of the disk.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from saf_gen.core.files import write_atomically
from saf_gen.errors import BadInput
from saf_gen.optics import Drive, drive_from_dict
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack import exr

__all__ = ["FocalStack", "StackSpec", "StackStore"]

FORMAT = "saf-gen focal stack 1"
UNIT = "W m^-2 sr^-1 at gain 1"
HALF_BITS = 15  # the largest half float is just below 2^16


class PixelGrid(Protocol):
    """The pixels of a sensor: how many, and their pitch in metres."""

    @property
    def rows(self) -> int: ...

    @property
    def columns(self) -> int: ...

    @property
    def pitch_m(self) -> float: ...


@dataclass(frozen=True)
class StackSpec:
    """Everything that decides what a stack looks like; its :attr:`key` is the folder's name.

    ``params`` is the member of the scene's family, as JSON; ``time_s`` the moment that is seen. ``positions``
    lie evenly over the whole travel. A time slice has a ``window``, the first and last of them to render.
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
        groups: Iterable[str] | None = None,
        f_number: float | None = None,
        window: tuple[int, int] | None = None,
    ) -> "StackSpec":
        """Return the spec of a member of a scene's family before a sensor; ``groups`` are all by default."""
        return cls(
            scene=scene.id,
            scene_digest=scene.digest,
            groups=tuple(scene.card.lights if groups is None else groups),
            drive=scene.build_drive(f_number),
            rows=grid.rows,
            columns=grid.columns,
            pitch_m=grid.pitch_m,
            positions=positions,
            samples=samples,
            max_depth=max_depth,
            params=json.dumps(dict(scene.params), sort_keys=True),
            time_s=time_s,
            window=window,
        )

    @property
    def key(self) -> str:
        """Scene name and digest of the content; neither seed nor variant enters: a stack is a stack."""
        text = json.dumps([FORMAT, self.as_dict(), *(["half"] if self.window else [])], sort_keys=True)
        return f"{self.scene}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain data, the drive with its kind."""
        return {**asdict(self), "drive": self.drive.as_dict()}

    @classmethod
    def read(cls, root: Path, key: str) -> "StackSpec":
        """The spec of the stack ``key`` that lies under ``root``.

        Raises BadInput where there is none, or its note is damaged.
        """
        path = root / key / "geometry.json"
        try:
            said = json.loads(path.read_text())["spec"]
            window = said.pop("window")
            said |= {"drive": drive_from_dict(said["drive"]), "groups": tuple(said["groups"])}
            spec = cls(**said, window=None if window is None else tuple(window))
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise BadInput(
                f"there is no focal stack {key} under {root}",
                hint="keep stacks/ beside the streams, or run saf-gen generate again",
            ) from error
        if spec.key != key:
            raise BadInput(f"{path} tells of another stack, {spec.key}", hint="run saf-gen generate again")
        return spec

    @property
    def focus(self) -> np.ndarray:
        """The rendered positions, float64 (focus,)."""
        return np.linspace(0, 1, self.positions)[self.first_index : self.first_index + self.rendered_count]

    @property
    def first_index(self) -> int:
        """Which of all positions the first rendered one is."""
        return self.window[0] if self.window else 0

    @property
    def rendered_count(self) -> int:
        """How many positions are rendered."""
        return self.window[1] - self.window[0] + 1 if self.window else self.positions


@dataclass(frozen=True)
class FocalStack:
    """radiance float32 (light, focus, row, col); depth float32 (row, col), m; target bool (row, col).

    ``focus`` runs over the rendered positions.
    """

    spec: StackSpec
    radiance: np.ndarray
    depth: np.ndarray
    target: np.ndarray
    backend: str
    digest: str = ""
    """Of the stored pieces; '' for a stack that was never stored."""


class StackStore:
    """The folder of one stack: tells what is there, takes what is rendered, gives the whole.

    A piece (a light group, or 'geometry') is ``<name>.exr`` with ``<name>.json`` beside it, which holds its
    digest and says how it was made; a piece without a digest that fits is no piece.
    """

    def __init__(self, root: Path, spec: StackSpec) -> None:
        self.folder, self.spec = root / spec.key, spec
        self.pieces = ("geometry", *spec.groups)

    def missing_pieces(self) -> list[str]:
        """Names of the pieces still to be rendered. A damaged one counts as missing."""
        return [name for name in self.pieces if not self._is_whole(name)]

    def has_all_notes(self) -> bool:
        """Whether all pieces have their notes; the pieces themselves are looked at when they are read."""
        return all(self._note(name) for name in self.pieces)

    def digest(self) -> str:
        """SHA-256 over the pieces' own: what sequences made from this very stack are made from."""
        digests = json.dumps([self._note(name).get("sha256") for name in self.pieces])
        return hashlib.sha256(digests.encode()).hexdigest()

    def backends(self) -> set[str]:
        """The variants that rendered what is there."""
        return {str(note["variant"]) for note in map(self._note, self.pieces) if "variant" in note}

    def write_group(self, group: str, radiance: np.ndarray, *, backend: str, clipped: int = 0) -> None:
        """Store one light group, float32 (focus, row, col), with the number of paths clipped as fireflies."""
        facts = {"unit": UNIT, "light_group": group, "clipped_paths": str(clipped), "variant": backend}
        if self.spec.window:
            radiance, exponent = _halved(radiance)
            facts |= {"unit": f"2^{exponent} {UNIT}", "exponent": str(exponent)}
        planes = {f"focus.{self.spec.first_index + k:04d}": plane for k, plane in enumerate(radiance)}
        self._put(group, planes, facts)

    def write_geometry(self, depth: np.ndarray, target: np.ndarray, *, backend: str) -> None:
        """Store depth (m) and target mask."""
        planes = {"depth": depth, "target": target.astype(np.float32)}
        self._put("geometry", planes, {"unit": "m", "variant": backend})

    def load(self) -> FocalStack:
        """The whole stack.

        Raises BadInput where a piece is missing or damaged.
        """
        radiance = self.load_planes(0, self.spec.rendered_count)
        variant = ", ".join(sorted(self.backends()))
        return FocalStack(self.spec, radiance, *self.load_geometry(), variant, self.digest())

    def load_planes(self, first: int, stop: int) -> np.ndarray:
        """Radiance float32 (light, focus, row, col) of positions first <= k < stop, counted as rendered.

        Raises BadInput where a piece is missing or damaged.
        """
        missing = self.missing_pieces()
        if missing:
            raise BadInput(f"{self.folder} lacks {', '.join(missing)}", hint="run saf-gen generate again")
        names = [f"focus.{self.spec.first_index + k:04d}" for k in range(first, stop)]
        radiance = np.empty(
            (len(self.spec.groups), len(names), self.spec.rows, self.spec.columns), np.float32
        )
        for g, group in enumerate(self.spec.groups):
            planes, facts = exr.read_planes(self.folder / f"{group}.exr", names)
            for k, name in enumerate(names):
                radiance[g, k] = planes[name]
            if exponent := int(facts.get("exponent", 0)):
                radiance[g] *= np.float32(2.0**exponent)
        return radiance

    def load_geometry(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth (m), float32, and target mask, bool, both (row, col).

        Raises BadInput where they are missing or damaged.
        """
        if not self._is_whole("geometry"):
            raise BadInput(f"{self.folder} lacks geometry", hint="run saf-gen generate again")
        planes, _ = exr.read_planes(self.folder / "geometry.exr")
        return planes["depth"], planes["target"] > 0.5

    def _note(self, name: str) -> dict[str, object]:
        try:
            note = json.loads((self.folder / f"{name}.json").read_text())
        except (OSError, ValueError):
            return {}  # no note, or half of one: then the piece is not known to be whole
        return note if isinstance(note, dict) else {}

    def _is_whole(self, name: str) -> bool:
        note, path = self._note(name), self.folder / f"{name}.exr"
        if not note or not path.is_file():
            return False
        there = path.stat()
        return _sha256(path, there.st_size, there.st_mtime_ns) == note.get("sha256")

    def _put(self, name: str, planes: dict[str, np.ndarray], facts: dict[str, str]) -> None:
        with write_atomically(self.folder / f"{name}.exr") as part:
            drive = json.dumps(self.spec.drive.as_dict())
            attributes = {"format": FORMAT, "stack": self.spec.key, "drive": drive, **facts}
            exr.write_planes(part, planes, attributes=attributes)
            sha256 = hashlib.sha256(part.read_bytes()).hexdigest()
        note = {"format": FORMAT, **facts, "sha256": sha256, "spec": self.spec.as_dict()}
        with write_atomically(self.folder / f"{name}.json") as part:
            part.write_text(json.dumps(note, indent=1))


def _halved(radiance: np.ndarray) -> tuple[np.ndarray, int]:
    """As half floats in units of a power of two, which is exact, and its exponent.

    The brightest lies below 2^15. What is 4·10^-9 of it or more keeps all 11 bits.
    """
    exponent = int(np.frexp(radiance.max(initial=0.0))[1]) - HALF_BITS
    return np.ldexp(radiance, -exponent).astype(np.float16), exponent


@lru_cache(maxsize=1 << 14)
def _sha256(path: Path, size: int, changed_ns: int) -> str:
    """Digest of a file; asked for again it is not read again unless its size or time changed.

    So many are kept because a scene that moves has hundreds of stacks, and each method asks for all of them.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()
