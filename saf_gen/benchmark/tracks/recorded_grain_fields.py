"""Fields of a record that describe grain, the noise that the renderer left in the pictures of a sequence.

A focus measure mistakes grain for texture. For each measure whose energy is stored in the recording, its energy in the
grain is compared with the range of its focus curve.
"""

import math
from collections.abc import Mapping

import numpy as np

from saf_gen.benchmark.records import MAX_SECONDS_OR_TRAVELS
from saf_gen.plugins.measures import INTERVAL_SUFFIX, NORMALISED_SUFFIX
from saf_gen.stack.grain import ENERGIES
from saf_gen.stream.recorded_grain import grain_of_stream
from saf_gen.stream.stream_file import SpikeStream

ENERGY_OF_MEASURE: Mapping[str, str] = {
    **dict.fromkeys(("sd", "sd_code", "sd_debiased", "sd_calibrated", "variance", "normalised_variance"), "contrast"),
    **{name: name for name in ENERGIES if name != "contrast"},
}


def grain_fields(stream: SpikeStream, method: str = "", *, region: str = "") -> dict[str, float | None]:
    """Return the fields of a record that describe the grain of a recording; None if unknown.

    The focus curve is the noise-free sharpness in the file for ``contrast``, and the signal along the recording for the
    other energies. Grain is known only in the box around the target, and hence not for a method that looks at the
    frame.
    """
    grain = grain_of_stream(stream.metadata.provenance)
    if grain is None:
        return {"grain_rms": None, "grain_of_curve": None}
    measure = method.split("+")[0].split(":")[0]
    measure = measure.removesuffix(INTERVAL_SUFFIX).removesuffix(NORMALISED_SUFFIX)
    energy, of_curve = ENERGY_OF_MEASURE.get(measure), math.nan
    if energy is not None and region == "target":
        sharpness = stream.truth.sharpness
        known = np.empty(0) if sharpness is None or energy != "contrast" else sharpness[np.isfinite(sharpness)]
        of_curve = grain.noise_over_curve(energy, curve_range=float(np.ptp(known)) if known.size else None)
    return {"grain_rms": _limit_for_record(grain.rms_in_focus), "grain_of_curve": _limit_for_record(of_curve)}


def _limit_for_record(value: float) -> float | None:
    """Return a number as stored in a record: limited to MAX_SECONDS_OR_TRAVELS, and None instead of NaN."""
    return None if math.isnan(value) else min(value, MAX_SECONDS_OR_TRAVELS)
