"""How numbers of many sequences become one: scenes weigh the same, and so do the lights of a scene."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from saf_gen.benchmark.records import Record

__all__ = ["mean_by_scene", "mean_over_scenes", "median_magnitude"]

Value = Callable[[Record], float | None]


def mean_by_scene(records: Sequence[Record], value: Value) -> dict[str, float]:
    """For each scene the mean over its lights of the mean over sequences; unknown values are left out."""
    scenes: dict[str, dict[str | None, list[float]]] = {}
    for record in records:
        if (number := value(record)) is not None:
            scenes.setdefault(record.scene, {}).setdefault(record.light, []).append(float(number))
    return {
        scene: float(np.mean([np.mean(some) for some in lights.values()])) for scene, lights in scenes.items()
    }


def mean_over_scenes(records: Sequence[Record], value: Value) -> float | None:
    """The mean of mean_by_scene; None where nothing is known."""
    scenes = mean_by_scene(records, value)
    return float(np.mean(list(scenes.values()))) if scenes else None


def median_magnitude(numbers: Iterable[float | None]) -> float | None:
    """Median of the magnitudes of what is known; None where nothing is."""
    known = [abs(number) for number in numbers if number is not None]
    return float(np.median(known)) if known else None
