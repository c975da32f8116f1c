"""Strata of recordings by the geometry of the region where methods are judged, and by nothing that a method sees.

A region in which everything has one depth asks one question; one that has relief, or shows a background, asks several,
and what answers best depends on the measure. Strata follow from ``/truth/best_position`` and ``/truth/target`` alone,
never from pictures, measures or answers, so that no method has a part in choosing where it is judged.
"""

import numpy as np

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.records import STRATA, Stratum
from saf_gen.core.region import Region
from saf_gen.stream.measure_input import choose_region, has_region
from saf_gen.stream.metadata import ReadableStream, Truth

MIN_AT_DEPTH = 0.95
"""Share of the pixels of a region inside the target that makes it one depth."""
MIN_SHARES = (0.8, 0.6)
"""Smallest shares of the target in its box, of the first two strata of the box."""


def stratum_in(stream: ReadableStream, region: str) -> Stratum | None:
    """Return the stratum of a recording in one of the regions by name, None if it lacks the region; see stratum_of."""
    if not has_region(stream, region):
        return None
    box, name = choose_region(stream, region)
    return stratum_of(name, box, truth=stream.truth)


def stratum_of(region: str, box: Region | None, *, truth: Truth) -> Stratum | None:
    """Return the stratum of a recording in the region where methods are judged.

    Inside the target, it is ``one depth`` if at least 95 % of the pixels are brought into focus by a position within
    half a depth of focus of the truth, and ``relief`` otherwise. In the target's box, it follows from the share of the
    pixels that belong to the target: 0.8 and more, 0.6 to 0.8, or below. In a moving scene, it is that of the moment
    at which the truth is stated.

    Parameters
    ----------
    region : str
        Name of the region: ``inside`` and ``target`` have strata.
    box : Region or None
        Rows and columns of the region, not empty; None for the whole frame.
    truth : Truth
        Truth of the recording, with ``target``, ``best_position``, ``position`` and ``depth_of_focus``.

    Returns
    -------
    str or None
        One of ``STRATA``; None for other regions, or if the truth lacks what the stratum follows from.
    """
    if box is None or region not in ("inside", "target"):
        return None
    if region == "target":
        if truth.target is None:
            return None
        share = np.count_nonzero(truth.target[box]) / truth.target[box].size
        return STRATA[2 + sum(share < least for least in MIN_SHARES)]
    dof = judged_dof(truth.depth_of_focus)
    if truth.best_position is None or dof is None or not truth.known:
        return None
    off = np.abs(truth.best_position[box].astype(np.float64) - truth.position)
    at_depth = np.count_nonzero(off <= dof / 2) / off.size  # what is never in focus is NaN, and not at the depth
    return STRATA[0 if at_depth >= MIN_AT_DEPTH else 1]
