"""Frozen benchmarks: recipes that come with saf_gen, and the digest that each had when it was published.

The digest covers everything that decides the spikes of a recipe. A recipe that has the name of a frozen benchmark but
another digest is refused, so that two results under one name belong to the same benchmark.
"""

from datetime import date
from functools import cache
from typing import Annotated

from pydantic import Field

from saf_gen.core.config.document import FrozenModel, validate_document
from saf_gen.core.config.json_document import read_json
from saf_gen.core.shipped import shipped_folder

FILE_NAME = "frozen.json"
"""Name of the file with the frozen benchmarks, in the folder of the recipes that come with saf_gen."""
BENCHMARK_KEY = "benchmark"
"""Key of a stream's provenance that holds its frozen benchmark: name, a space, digest."""


class FrozenBenchmark(FrozenModel):
    """A published benchmark, identified by a digest of everything that determines its spikes."""

    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """SHA-256 of everything that determines its spikes: recipe, scenes, sensor, and the model of lens and sensor."""
    since: date
    """Day on which it was frozen."""
    sequences: dict[str, Annotated[int, Field(ge=1)]]
    """Number of sequences in each split."""


class _FrozenFile(FrozenModel):
    benchmarks: dict[str, FrozenBenchmark]


@cache
def read_frozen_digests() -> dict[str, FrozenBenchmark]:
    """Return the frozen benchmarks by the names of their recipes.

    Raises BadInput, with the line, if the file that lists them is damaged.
    """
    return validate_document(_FrozenFile, read_json(shipped_folder("recipes") / FILE_NAME)).benchmarks
