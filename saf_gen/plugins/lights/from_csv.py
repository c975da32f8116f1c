"""A light schedule from a table of gains in a CSV file, for example measured light."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from saf_gen.core.csv_table import parse_csv
from saf_gen.errors import BadInput
from saf_gen.plugins.lights._piecewise_linear import integrate_gain


@dataclass(frozen=True)
class FromCsv:
    """The gain is interpolated linearly between the points of a table, and is constant before and after them.

    In a recipe, ``file`` is the path of a CSV file in the recipe's folder or below it. Its columns are ``time_s``
    (seconds from the beginning of the recording, increasing) and ``gain`` (0 or more). The file is read together with
    the recipe, and passed to this class as ``{"path": ..., "text": ...}``.
    """

    endless = True

    file: Mapping[str, str] = field(repr=False)
    """Path of a CSV file with ``time_s``, ``gain``: the gain is interpolated linearly between these points."""

    def __post_init__(self) -> None:
        times, gains = parse_csv(self.file, ("time_s", "gain"))
        if gains.min() < 0:
            worst = int(gains.argmin())
            raise BadInput(
                f"gain is {gains[worst]:g} at {times[worst]:g} s",
                where=self.file["path"],
                allowed="0 or more: light is not negative",
            )

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        times, gains = parse_csv(self.file, ("time_s", "gain"))
        return integrate_gain(seconds, times=times, gains=gains)

    def gain(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the gain at each time."""
        times, gains = parse_csv(self.file, ("time_s", "gain"))
        return np.interp(seconds, times, gains)

    def breaks(self, duration_s: float) -> np.ndarray:
        """Return the times of the table, in seconds."""
        times, _ = parse_csv(self.file, ("time_s", "gain"))
        return times
