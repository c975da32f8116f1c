"""Workloads of checks: scenes, a sensor and a recipe in a folder, and the dataset that `generate` makes from them.

A check uses saf_gen as a user does: it writes files, calls the public functions behind the commands, and reads the
resulting streams.
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
from saf_gen.core.files import write_text
from saf_gen.errors import SafGenError
from saf_gen.generate.resolve import ResolvedRecipe, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics.actuators import Actuator
from saf_gen.scene.trusted_folders import SCENES_VARIABLE
from saf_gen.stream.manifest import SequenceEntry, read_manifest
from saf_gen.stream.stream_file import SpikeStream, open_stream


@dataclass(frozen=True)
class WrittenScene:
    """The content of the two files of a scene: the card as a mapping, and the body of ``build`` in ``scene.py``."""

    card: Mapping[str, Any]
    build: str

    @property
    def id(self) -> str:
        """Name of the scene."""
        return str(self.card["id"])


@dataclass(frozen=True)
class Workload:
    """Scenes, a sensor and a recipe, as a user would write them.

    Parameters
    ----------
    scenes : tuple of WrittenScene
        Scenes to write.
    sensor : Sensor
        Sensor of all recordings.
    frames : int
        Frames per recording.
    lights : mapping, optional
        Light schedules by name; by default, a single constant light.
    exposure, focus, render : mapping, optional
        Sections of the recipe; by default absolute exposure, a lens at rest at position 0, and 4 samples per pixel.
    split : mapping, optional
        Additional keys of the split ``test``, which holds all scenes.
    saturation : str, optional
        Law of saturation in the recipe; by default, the law of the sensor.
    seed : int, default 15
        Seed of the recipe.
    shipped : tuple of str, optional
        Names of further scenes, which come with saf_gen.
    actuator : Actuator, optional
        What moves the lens; by default it moves exactly as it is told.
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
    actuator: Actuator | None = None

    @cached_property
    def files(self) -> dict[str, str]:
        """Text of every file, by path."""
        camera = {"sensor": "sensor.yaml", "frames": self.frames, "exposure": self.exposure}
        recipe = {
            "name": "validation",
            "seed": self.seed,
            "camera": camera | ({"saturation": self.saturation} if self.saturation else {}),
            "focus": {**self.focus, **({"actuator": "actuator.yaml"} if self.actuator else {})},
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
        found = {"recipe.yaml": _to_yaml(recipe), "sensor.yaml": _to_yaml({"kind": "spikes", **asdict(self.sensor)})}
        if self.actuator is not None:
            numbers = {key: value for key, value in asdict(self.actuator).items() if value is not None}
            found["actuator.yaml"] = _to_yaml(numbers)
        for scene in self.scenes:
            found[f"scenes/{scene.id}/scene.yaml"] = _to_yaml(scene.card)
            head = f'"""{scene.card["title"]}."""\n\nimport mitsuba as mi\nimport numpy as np\n'
            found[f"scenes/{scene.id}/scene.py"] = f"{head}\n\ndef build(params):\n{scene.build}"
        return found

    @cached_property
    def key(self) -> str:
        """Digest of all files (16 hex digits); equal workloads share their streams."""
        return hashlib.sha256(json.dumps(self.files, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class MadeDataset:
    """A dataset that was generated from a workload."""

    folder: Path
    sequences: tuple[SequenceEntry, ...]

    def find(self, *, scene: str | None = None, light: str | None = None, repeat: int | None = None) -> SequenceEntry:
        """Return the only sequence with this scene, light and repeat; None matches anything."""
        wanted = {"scene": scene, "light": light, "repeat": repeat}
        wanted_values = {key: value for key, value in wanted.items() if value is not None}
        (found,) = (s for s in self.sequences if all(getattr(s, k) == v for k, v in wanted_values.items()))
        return found

    def open(self, **which: Any) -> SpikeStream:
        """Open the stream of a sequence; the arguments are those of :meth:`find`."""
        return open_stream(self.folder / self.find(**which).file)


@dataclass(frozen=True)
class DatasetMaker:
    """Writes workloads to a folder and generates their datasets, or reuses those that are complete there.

    Parameters
    ----------
    folder : Path
        Folder with a subfolder for each workload.
    report : callable, optional
        Called with the name of the current job.
    datasets : dict, optional
        Datasets of this maker, by the key of their workload; they are not read and checked again.
    """

    folder: Path
    report: Callable[[str], None] = lambda stage: None
    datasets: dict[str, MadeDataset] = field(default_factory=dict)

    def resolve(self, workload: Workload) -> ResolvedRecipe:
        """Write the files of a workload, and return its resolved recipe."""
        home = self._home(workload)
        for name, text in workload.files.items():
            if not (home / name).exists():
                write_text(home / name, text)
        with only_scenes(home / "scenes"):
            return resolve_recipe(home / "recipe.yaml")

    def make(self, workload: Workload) -> MadeDataset:
        """Write the files of a workload, generate its dataset and return it; raise SafGenError if a sequence fails."""
        if workload.key in self.datasets:
            return self.datasets[workload.key]
        resolved, home = self.resolve(workload), self._home(workload)
        with only_scenes(home / "scenes"):
            result = generate(resolved, home / "dataset", report=lambda name, done: self.report(name))
        for name, error in result.failed.items():
            raise SafGenError(f"{name}: {error}")
        self.datasets[workload.key] = MadeDataset(home / "dataset", read_manifest(home / "dataset").sequences)
        return self.datasets[workload.key]

    def _home(self, workload: Workload) -> Path:
        return self.folder / workload.key

    def clear(self) -> None:
        """Delete all datasets."""
        self.datasets.clear()
        shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def only_scenes(folder: Path) -> Iterator[None]:
    """Set SAF_GEN_SCENES to this folder alone inside a ``with`` block; worker processes inherit the setting."""
    before = os.environ.get(SCENES_VARIABLE)
    os.environ[SCENES_VARIABLE] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[SCENES_VARIABLE]
        else:
            os.environ[SCENES_VARIABLE] = before


def sensor_with_noise(*switched_on: str, name: str = "vidar_400x250", **changes: Any) -> Sensor:
    """Return a sensor of which only the named kinds of noise are switched on."""
    switches = {f.name: f.name in switched_on for f in fields(get_sensor(name).noise)}
    return get_sensor(name, **changes, noise=switches)


def _to_yaml(value: Any) -> str:
    """Return the value as JSON that is also YAML, which requires a decimal point in numbers such as 2.0e-05."""
    text = json.dumps(value, indent=1, ensure_ascii=False, default=dict)
    return re.sub(r"(?<=[\s\[])(-?\d+)(e[-+]?\d+)(?=[,\s\]}])", r"\1.0\2", text) + "\n"
