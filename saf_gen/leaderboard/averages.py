"""Averages over sequences that give equal weight to every scene, and to every light within a scene."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from saf_gen.benchmark.records import Record

RecordValue = Callable[[Record], float | None]


def mean_by_scene_for_ranking(records: Sequence[Record], value: RecordValue) -> dict[str, float]:
    """Return the mean value of each scene.

    Known values are averaged over the sequences of each light, then over the lights of the scene. A scene without any
    known value is left out.
    """
    scenes: dict[str, dict[str | None, list[float]]] = {}
    for record in records:
        if (number := value(record)) is not None:
            scenes.setdefault(record.scene, {}).setdefault(record.light, []).append(float(number))
    return {
        scene: float(np.mean([np.mean(numbers) for numbers in lights.values()])) for scene, lights in scenes.items()
    }


def mean_over_scenes_for_ranking(records: Sequence[Record], value: RecordValue) -> float | None:
    """Return the mean of the scene means of mean_by_scene_for_ranking, or None if every value is unknown."""
    scenes = mean_by_scene_for_ranking(records, value)
    return float(np.mean(list(scenes.values()))) if scenes else None


def median_magnitude_for_ranking(numbers: Iterable[float | None]) -> float | None:
    """Return the median of the known absolute values, or None if all values are unknown."""
    known = [abs(number) for number in numbers if number is not None]
    return float(np.median(known)) if known else None
