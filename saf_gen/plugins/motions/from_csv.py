"""A lens motion from a table of positions in a CSV file, for example a measured motion."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from saf_gen.core.csv_table import parse_csv
from saf_gen.errors import BadInput

SLACK_S = 1e-9  # times in a file and times computed from the readout rate may differ in their last digits


@dataclass(frozen=True)
class FromCsv:
    """The lens position is interpolated linearly between the points of a table.

    In a recipe, ``file`` is the path of a CSV file in the recipe's folder or below it. Its columns are ``time_s``
    (seconds from the beginning of the recording, increasing) and ``position`` (fraction of the travel, 0 to 1). The
    times must reach from the middle of the first readout to the middle of the last. The file is read together with the
    recipe, and passed to this class as ``{"path": ..., "text": ...}``.
    """

    file: Mapping[str, str] = field(repr=False)
    """Path of a CSV file with ``time_s``, ``position``: the position is interpolated linearly between these points,
    which must reach from the middle of the first readout to the middle of the last."""

    def __post_init__(self) -> None:
        times, positions = parse_csv(self.file, ("time_s", "position"))
        outside = np.flatnonzero((positions < 0) | (positions > 1))
        if outside.size:
            raise BadInput(
                f"position is {positions[outside[0]]:g} at {times[outside[0]]:g} s",
                where=self.file["path"],
                allowed="0 to 1, a fraction of the travel",
            )

    def positions(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the position at each time, a fraction of the travel.

        Raises BadInput if a time is outside the table.
        """
        times, positions = parse_csv(self.file, ("time_s", "position"))
        seconds = np.asarray(seconds, dtype=np.float64)
        outside = seconds[(seconds < times[0] - SLACK_S) | (seconds > times[-1] + SLACK_S)]
        if outside.size:
            raise BadInput(
                f"time_s goes from {times[0]:g} to {times[-1]:g}, but the recording of {duration_s:g} s needs "
                f"the position at {outside.flat[-1]:g} s",
                where=self.file["path"],
                allowed="a table that covers the recording",
                hint="add rows, or record fewer frames",
            )
        return np.interp(seconds, times, positions)
