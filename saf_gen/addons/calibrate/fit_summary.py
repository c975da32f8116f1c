"""What a camera's owner wants to know first of a fitted sensor, in five lines."""

from math import sqrt

import numpy as np

from saf_gen.addons.calibrate.estimates import Estimate
from saf_gen.addons.calibrate.fit_sensor import SensorFit
from saf_gen.camera import Sensor
from saf_gen.core.plain_text import plural

NEVER_TOLD = ("pitch", "quantum efficiency", "fill factor", "wavelength")
"""What flat fields and dark recordings cannot show."""


def summarise_fit(fit: SensorFit, *, base: Sensor) -> list[str]:
    """Return five lines about a fitted sensor: noise, dark rate, non-uniformity, how it compares, what stays unknown.

    ``base`` is the sensor with which it is compared, and which supplied what could not be determined.
    """
    hz, noise, dark = fit.sensor.readout_hz, fit.estimates["interval_noise"], fit.estimates["dark_rate"]
    good = fit.response.response[~fit.bad]
    uneven = float(np.std(good) / np.mean(good))
    of_base = sqrt(1 / base.threshold_e + base.threshold_noise_rms**2)
    bad = int(fit.bad.sum())
    unknown = list(NEVER_TOLD)
    if "threshold_noise_rms" not in fit.estimates or not fit.estimates["threshold_noise_rms"].measured:
        unknown.append("threshold and threshold noise apart from each other")
    if "loss" not in fit.estimates or not fit.estimates["loss"].measured:
        unknown.append("the law of saturation")
    darker = dark.value * hz / (base.dark_rate * base.readout_hz)
    return [
        f"noise: the time between two spikes varies by {_share(noise)} rms, beyond what the readout rounds",
        f"dark rate: {dark.value * hz:.3g} spikes per second and pixel; "
        f"{fit.estimates['dark_hot_fraction'].value:.2%} of the pixels are hot",
        f"non-uniformity: {uneven:.1%} rms between pixels in even light, bad ones left out",
        f"against {base.name}: {noise.value / of_base:.2g} × its noise, {darker:.2g} × its dark rate; "
        f"{plural(bad, 'bad pixel')} of {fit.bad.size:,}",
        f"not told by these recordings, and taken from {base.name}: {', '.join(unknown)}",
    ]


def _share(estimate: Estimate) -> str:
    return f"{estimate.value:.2%} ({estimate.low:.2%} to {estimate.high:.2%})"
