"""What checks run: scenes, a sensor and a recipe written to a folder, and the dataset that `generate` makes of them.

A check sees of the product what a user sees: files that are written, the public functions behind the commands, and
the streams that come out.
"""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from saf_gen.camera import Sensor, get_sensor
from saf_gen.core.files import write_text_atomically
from saf_gen.errors import SafGenError
from saf_gen.generate.resolve import ResolvedRecipe, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.scene.trusted_folders import SCENES_VARIABLE
from saf_gen.stream.manifest import SequenceEntry, read_manifest
from saf_gen.stream.stream_file import SpikeStream, open_stream


@dataclass(frozen=True)
class WrittenScene:
    """A scene as its two files hold it: the card as a mapping, and the body of ``build`` in ``scene.py``."""

    card: Mapping[str, Any]
    build: str

    @property
    def id(self) -> str:
        """Its name."""
        return str(self.card["id"])


@dataclass(frozen=True)
class Workload:
    """Scenes, a sensor and a recipe: what a user would write.

    ``lights`` are schedules by name; ``exposure``, ``focus`` and ``render`` are those keys of the recipe, ``split`` has
    more keys of its split ``test``, which holds all scenes. ``shipped`` names scenes that come with saf_gen.
    """

    scenes: tuple[WrittenScene, ...]
    sensor: Sensor
    frames: int
    lights: Mapping[str, Any] = field(default_factory=lambda: {"constant": {"kind": "constant"}})
    exposure: Mapping[str, Any] = field(default_factory=lambda: {"absolute": True})
    focus: Mapping[str, Any] = field(
        default_factory=lambda: {"positions": 2, "motion": {"kind": "hold", "position": 0.0}}
    )
    render: Mapping[str, Any] = field(default_factory=lambda: {"samples": 4, "max_depth": 2})
    split: Mapping[str, Any] = field(default_factory=dict)
    saturation: str | None = None
    seed: int = 15
    shipped: tuple[str, ...] = ()

    @cached_property
    def files(self) -> dict[str, str]:
        """The text of every file by its path."""
        camera = {"sensor": "sensor.yaml", "frames": self.frames, "exposure": self.exposure}
        recipe = {
            "name": "validation",
            "seed": self.seed,
            "camera": camera | ({"saturation": self.saturation} if self.saturation else {}),
            "focus": self.focus,
            "render": self.render,
            "lights": self.lights,
            "splits": {
                "test": {
                    "scenes": [*(s.id for s in self.scenes), *self.shipped],
                    "lights": list(self.lights),
                    **self.split,
                }
            },
        }
        found = {"recipe.yaml": _to_yaml(recipe), "sensor.yaml": _to_yaml(asdict(self.sensor))}
        for scene in self.scenes:
            found[f"scenes/{scene.id}/scene.yaml"] = _to_yaml(scene.card)
            head = f'"""{scene.card["title"]}."""\n\nimport mitsuba as mi\nimport numpy as np\n'
            found[f"scenes/{scene.id}/scene.py"] = f"{head}\n\ndef build(params):\n{scene.build}"
        return found

    @cached_property
    def key(self) -> str:
        """Digest of all files: equal workloads share their streams."""
        return hashlib.sha256(json.dumps(self.files, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Made:
    """The dataset of a workload."""

    folder: Path
    sequences: tuple[SequenceEntry, ...]

    def find(self, *, scene: str | None = None, light: str | None = None, repeat: int | None = None) -> SequenceEntry:
        """Return the one sequence of a scene, light and repeat; what is left out may be anything."""
        wanted = {"scene": scene, "light": light, "repeat": repeat}
        given = {key: value for key, value in wanted.items() if value is not None}
        (found,) = (s for s in self.sequences if all(getattr(s, k) == v for k, v in given.items()))
        return found

    def open(self, **which: Any) -> SpikeStream:
        """Open a sequence's stream; the arguments are those of :meth:`find`."""
        return open_stream(self.folder / self.find(**which).file)


@dataclass(frozen=True)
class DatasetMaker:
    """Where workloads are written and generated. A dataset that is there and whole is used again.

    What this maker has ``made``, by the key of its workload, is used without being read back and checked once more.
    """

    folder: Path
    report: Callable[[str], None] = lambda stage: None
    made: dict[str, Made] = field(default_factory=dict)

    def resolve(self, workload: Workload) -> ResolvedRecipe:
        """Write a workload's files, and return its recipe resolved."""
        home = self._home(workload)
        for name, text in workload.files.items():
            if not (home / name).exists():
                write_text_atomically(home / name, text)
        with use_workload_scenes(home / "scenes"):
            return resolve_recipe(home / "recipe.yaml")

    def make(self, workload: Workload) -> Made:
        """Write a workload's files, generate its dataset, and return it; SafGenError where a sequence fails."""
        if workload.key in self.made:
            return self.made[workload.key]
        resolved, home = self.resolve(workload), self._home(workload)
        with use_workload_scenes(home / "scenes"):
            result = generate(resolved, home / "dataset", report=lambda name, done: self.report(name))
        for name, error in result.failed.items():
            raise SafGenError(f"{name}: {error}")
        self.made[workload.key] = Made(home / "dataset", read_manifest(home / "dataset").sequences)
        return self.made[workload.key]

    def _home(self, workload: Workload) -> Path:
        return self.folder / workload.key

    def clear(self) -> None:
        """Delete all datasets."""
        self.made.clear()
        shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def use_workload_scenes(folder: Path) -> Iterator[None]:
    """Let scenes be found in a folder alone, as SAF_GEN_SCENES does; worker processes inherit it."""
    before = os.environ.get(SCENES_VARIABLE)
    os.environ[SCENES_VARIABLE] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[SCENES_VARIABLE]
        else:
            os.environ[SCENES_VARIABLE] = before


def workload_sensor_with_noise(*switched_on: str, name: str = "vidar_400x250", **changes: Any) -> Sensor:
    """Return a sensor whose noise is off, but for the switches named."""
    switches = {f.name: f.name in switched_on for f in fields(get_sensor(name).noise)}
    return get_sensor(name, **changes, noise=switches)


def _to_yaml(value: Any) -> str:
    """Return JSON, which is YAML but for numbers such as 2e-05: YAML wants a point in them."""
    text = json.dumps(value, indent=1, ensure_ascii=False, default=dict)
    return re.sub(r"(?<=[\s\[])(-?\d+)(e[-+]?\d+)(?=[,\s\]}])", r"\1.0\2", text) + "\n"
