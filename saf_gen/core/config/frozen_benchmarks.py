"""Benchmarks that are frozen: recipes that come with saf_gen, and the digest that each had when it was published.

The digest is of all that decides the spikes of a recipe. A recipe of a frozen name that has another digest is refused,
so that two results under one name are of the same benchmark.
"""

from datetime import date
from functools import cache
from typing import Annotated

from pydantic import Field

from saf_gen.core.config.document import FrozenModel, validate_document
from saf_gen.core.config.json_document import read_json
from saf_gen.core.shipped import shipped_folder

FILE_NAME = "frozen.json"
"""Stands beside the recipes that come with saf_gen."""
BENCHMARK_KEY = "benchmark"
"""The key of a stream's provenance under which its frozen benchmark stands: name, a space, digest."""


class FrozenBenchmark(FrozenModel):
    """A published benchmark."""

    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """SHA-256 of all that decides its spikes: recipe, scenes, sensor, and the model of lens and sensor."""
    since: date
    """The day on which it was frozen."""
    sequences: dict[str, Annotated[int, Field(ge=1)]]
    """How many sequences each split has."""


class _FrozenFile(FrozenModel):
    benchmarks: dict[str, FrozenBenchmark]


@cache
def read_frozen_benchmarks() -> dict[str, FrozenBenchmark]:
    """Return the frozen benchmarks by the names of their recipes.

    Raises BadInput, with the line, for a list that has been damaged.
    """
    return validate_document(_FrozenFile, read_json(shipped_folder("recipes") / FILE_NAME)).benchmarks
