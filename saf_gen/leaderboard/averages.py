"""Averages over sequences in which every scene weighs the same, and so does every light of a scene."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from saf_gen.benchmark.records import Record

RecordValue = Callable[[Record], float | None]


def mean_by_scene_for_ranking(records: Sequence[Record], value: RecordValue) -> dict[str, float]:
    """Return by scene the mean over its lights, each being the mean of its sequences' known values."""
    scenes: dict[str, dict[str | None, list[float]]] = {}
    for record in records:
        if (number := value(record)) is not None:
            scenes.setdefault(record.scene, {}).setdefault(record.light, []).append(float(number))
    return {
        scene: float(np.mean([np.mean(numbers) for numbers in lights.values()])) for scene, lights in scenes.items()
    }


def mean_over_scenes_for_ranking(records: Sequence[Record], value: RecordValue) -> float | None:
    """Return the mean of mean_by_scene_for_ranking; None where every value is unknown."""
    scenes = mean_by_scene_for_ranking(records, value)
    return float(np.mean(list(scenes.values()))) if scenes else None


def median_magnitude_for_ranking(numbers: Iterable[float | None]) -> float | None:
    """Return the median of the absolute values that are known; None if all are unknown."""
    known = [abs(number) for number in numbers if number is not None]
    return float(np.median(known)) if known else None
