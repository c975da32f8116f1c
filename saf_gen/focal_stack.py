"""A focal stack: the scene at every focus position, each light group alone; and where it is stored.

On disk a stack is a folder of OpenEXR files named by its content (scene, lens, film, positions, samples),
so that every sequence that needs it finds it and nothing is rendered twice. ``stack.json`` lists the files
that are whole. Reading one needs no renderer.
"""

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from saf_gen import exr
from saf_gen.errors import BadInput
from saf_gen.optics import ImageDistance

__all__ = ["FocalStack", "StackSpec", "StackStore"]

FORMAT = "saf-gen focal stack 1"


@dataclass(frozen=True)
class StackSpec:
    """Everything that decides what a stack looks like; its :attr:`key` is the folder's name."""

    scene: str
    scene_digest: str
    groups: tuple[str, ...]
    drive: ImageDistance
    rows: int
    columns: int
    pitch_m: float
    positions: int
    samples: int
    max_depth: int

    @property
    def key(self) -> str:
        """Scene name and digest of the content; neither seed nor variant enters: a stack is a stack."""
        text = json.dumps([FORMAT, asdict(self)], sort_keys=True)
        return f"{self.scene}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"

    @property
    def focus(self) -> np.ndarray:
        """The rendered positions, float64 (focus,)."""
        return np.linspace(0, 1, self.positions)


@dataclass(frozen=True)
class FocalStack:
    """radiance float32 (light, focus, row, col); depth float32 (row, col), m; target bool (row, col)."""

    spec: StackSpec
    radiance: np.ndarray
    depth: np.ndarray
    target: np.ndarray
    variant: str


class StackStore:
    """The folder of one stack: tells what is there, takes what is rendered, gives the whole."""

    def __init__(self, root: Path, spec: StackSpec) -> None:
        self.folder, self.spec = root / spec.key, spec
        self._index = self.folder / "stack.json"

    def missing(self) -> list[str]:
        """Names still to be rendered: light groups, and 'geometry'. A damaged file counts as missing."""
        whole = self._files()
        return [name for name in ("geometry", *self.spec.groups) if not self._is_whole(name, whole)]

    def variants(self) -> set[str]:
        """The variants that rendered what is there."""
        return {str(entry["variant"]) for entry in self._files().values() if "variant" in entry}

    def put_group(self, group: str, radiance: np.ndarray, variant: str) -> None:
        """Store one light group, float32 (focus, row, col)."""
        planes = {f"focus.{k:04d}": plane for k, plane in enumerate(radiance)}
        self._put(group, planes, {"unit": "W m^-2 sr^-1", "light_group": group, "variant": variant})

    def put_geometry(self, depth: np.ndarray, target: np.ndarray, variant: str) -> None:
        """Store depth (m) and target mask."""
        planes = {"depth": depth, "target": target.astype(np.float32)}
        self._put("geometry", planes, {"unit": "m", "variant": variant})

    def load(self) -> FocalStack:
        """The whole stack.

        Raises BadInput where a file is missing or damaged.
        """
        missing = self.missing()
        if missing:
            raise BadInput(f"{self.folder} lacks {', '.join(missing)}", hint="run saf-gen generate again")
        shape = (len(self.spec.groups), self.spec.positions, self.spec.rows, self.spec.columns)
        radiance = np.empty(shape, dtype=np.float32)
        for g, group in enumerate(self.spec.groups):
            planes, _ = exr.read_planes(self._path(group))
            for k in range(self.spec.positions):
                radiance[g, k] = planes[f"focus.{k:04d}"]
        planes, attributes = exr.read_planes(self._path("geometry"))
        return FocalStack(self.spec, radiance, planes["depth"], planes["target"] > 0.5, attributes["variant"])

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.exr"

    def _files(self) -> dict[str, dict[str, object]]:
        try:
            return json.loads(self._index.read_text())["files"]
        except (OSError, ValueError, KeyError, TypeError):
            return {}  # no index, or half of one: then nothing is known to be whole

    def _is_whole(self, name: str, files: dict[str, dict[str, object]]) -> bool:
        entry, path = files.get(name), self._path(name)
        if entry is None or not path.is_file() or path.stat().st_size != entry.get("bytes"):
            return False
        return hashlib.sha256(path.read_bytes()).hexdigest() == entry.get("sha256")

    def _put(self, name: str, planes: dict[str, np.ndarray], attributes: dict[str, str]) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        part = self.folder / f".{name}.{os.getpid()}.part"
        try:
            exr.write_planes(part, planes, {"format": FORMAT, "stack": self.spec.key, **attributes})
            content = part.read_bytes()
            part.replace(self._path(name))
        finally:
            part.unlink(missing_ok=True)
        entry = {
            "bytes": len(content),
            "sha256": hashlib.sha256(content).hexdigest(),
            "variant": attributes["variant"],
        }
        index = {
            "format": FORMAT,
            "spec": asdict(self.spec),
            "focus_position": self.spec.focus.tolist(),
            "files": {**self._files(), name: entry},
        }
        part = self.folder / f".stack.{os.getpid()}.part"
        part.write_text(json.dumps(index, indent=1))
        part.replace(self._index)
