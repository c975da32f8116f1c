"""Conversion of light to charge: irradiance behind a lens, photo-electrons per readout, and the exposure.

    E = transmission·π·R²/v²·cos⁴θ·L          Q = E·pitch²·FF·QE·λ/(h·c)/readout_hz

L is radiance, E irradiance, and Q charge. The mean rate of a sensor, in spikes per readout, is q/(threshold + loss·q)
at the mean charge q, and at most 1 (16/17 with ``dead_readout``). ``loss`` is the fraction of its charge that the
readout after a spike loses. A lens with veiling glare spreads a share of the light in the frame evenly over it.
"""

from math import frexp, ldexp, pi
from typing import Protocol

import numpy as np
from scipy.constants import c, h

from saf_gen.camera.sensor import Sensor
from saf_gen.errors import BadInput


class ExposingLens(Protocol):
    """The properties of a lens on which the exposure of a sensor depends."""

    @property
    def aperture_radius_m(self) -> float:
        """Radius of the aperture, in metres."""
        ...

    @property
    def transmission(self) -> float:
        """Fraction of the light that the lens transmits."""
        ...

    @property
    def veiling_glare(self) -> float:
        """Share of the light in the frame that is spread evenly over it."""
        ...

    def image_distance(self, position: np.ndarray) -> np.ndarray:
        """Return the distance from the lens to the sensor at each position, in metres."""
        ...


class Pixels(Protocol):
    """The numbers of a sensor's pixels on which its charge depends; see :class:`saf_gen.camera.Sensor`."""

    @property
    def pitch_m(self) -> float:
        """Pitch of the pixels, metres."""
        ...

    @property
    def fill_factor(self) -> float:
        """Light-sensitive fraction of the area of a pixel."""
        ...

    @property
    def readout_hz(self) -> float:
        """Readouts per second."""
        ...

    @property
    def quantum_efficiency(self) -> float:
        """Electrons, or detections, per photon that reaches the light-sensitive area."""
        ...

    @property
    def wavelength_m(self) -> float:
        """The single wavelength at which light is converted, metres."""
        ...

    def spectral_response(self) -> np.ndarray:
        """Return what is detected per joule and nanometre, as :meth:`saf_gen.camera.Sensor.spectral_response`."""
        ...


def irradiance_ratio(
    shape: tuple[int, int],
    image_distance: np.ndarray,
    *,
    pitch_m: float,
    aperture_radius_m: float,
    transmission: float = 1.0,
) -> np.ndarray:
    """Return the ratio of irradiance to radiance, transmission·π·R²/v²·cos⁴θ, in steradians.

    θ is the angle between the optical axis, which passes through the middle of the array, and the line from the middle
    of the lens to the middle of the pixel. The factor 1/v² includes the bellows factor.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns of the array, (H, W).
    image_distance : ndarray, shape (K,)
        Distances v from the lens to the sensor, metres.
    pitch_m : float
        Pitch of the pixels, metres.
    aperture_radius_m : float
        Radius R of the aperture, metres.
    transmission : float, default 1
        Fraction of the light that the lens transmits.

    Returns
    -------
    ndarray of float64, shape (K, H, W)
        E/L of each pixel at each image distance, steradians.
    """
    v2 = np.square(np.asarray(image_distance, np.float64))[:, None, None]
    rows = (np.arange(shape[0]) - (shape[0] - 1) / 2) * pitch_m
    columns = (np.arange(shape[1]) - (shape[1] - 1) / 2) * pitch_m
    r2 = np.square(rows)[:, None] + np.square(columns)
    cos2 = v2 / (v2 + r2)
    return transmission * pi * aperture_radius_m**2 / v2 * cos2 * cos2


def electrons_per_irradiance(sensor: Pixels) -> float:
    """Return the photo-electrons per readout and pixel for an irradiance of 1 W m⁻²."""
    energy = sensor.pitch_m**2 * sensor.fill_factor / sensor.readout_hz
    return energy * sensor.quantum_efficiency * sensor.wavelength_m / (h * c)


def charge_of_images(radiance: np.ndarray, sensor: Pixels, *, lens: ExposingLens, position: np.ndarray) -> np.ndarray:
    """Return the charge that each image of a focal stack gives on a sensor, in photo-electrons per readout.

    Parameters
    ----------
    radiance : ndarray, shape (light, focus, row, col)
        Radiance at gain 1, W m⁻² sr⁻¹.
    sensor : Sensor or SpadSensor
        The sensor.
    lens : ExposingLens
        The lens, such as any :class:`saf_gen.optics.Drive`.
    position : ndarray, shape (focus,)
        Position of the lens for each image, as a fraction of its travel.

    Returns
    -------
    ndarray of float32, shape (light, focus, row, col)
        Photo-electrons per readout at gain 1.

    Raises
    ------
    BadInput
        If the shapes do not match, an image distance or the aperture radius is not positive, the transmission is not
        above 0 and at most 1, or the veiling glare is not at least 0 and below 1.
    """
    radiance, image_distance = np.asarray(radiance), np.asarray(lens.image_distance(position), np.float64)
    aperture_radius_m, transmission = lens.aperture_radius_m, lens.transmission
    if radiance.ndim != 4 or image_distance.shape != radiance.shape[1:2]:
        raise BadInput(
            f"radiance has shape {radiance.shape}, image_distance {image_distance.shape}",
            allowed="(light, focus, row, col) and (focus,)",
        )
    if not (image_distance > 0).all():
        raise BadInput(f"the image distance is {image_distance.min():g} m", allowed="metres, above 0")
    if not aperture_radius_m > 0:
        raise BadInput(f"the aperture radius is {aperture_radius_m:g} m", allowed="metres, above 0")
    if not 0 < transmission <= 1:
        raise BadInput(f"the transmission of the lens is {transmission:g}", allowed="above 0, at most 1")
    if not 0 <= lens.veiling_glare < 1:
        raise BadInput(f"the veiling glare of the lens is {lens.veiling_glare:g}", allowed="at least 0, below 1")
    electrons = electrons_per_irradiance(sensor)
    out = np.empty(radiance.shape, np.float32)
    for k, distance in enumerate(image_distance):  # one position at a time: the stack may be large
        factor = irradiance_ratio(
            (radiance.shape[2], radiance.shape[3]),
            distance[None],
            pitch_m=sensor.pitch_m,
            aperture_radius_m=aperture_radius_m,
            transmission=transmission,
        )
        out[:, k] = radiance[:, k] * (factor[0] * electrons)
        if lens.veiling_glare:
            _veil(out[:, k], lens.veiling_glare)
    return out


def _veil(charge: np.ndarray, share: float) -> None:
    """Spread a share of the light of each picture evenly over it, in place: (light, row, col)."""
    for picture in charge:
        mean = _round_to_20_bits(float(picture.mean(dtype=np.float64)))
        picture *= np.float32(1 - share)
        picture += np.float32(share * mean)


def firing_rate(charge: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Return the spikes per readout at a constant mean charge.

    The rate is charge/(threshold + loss·charge), up to the highest rate of the sensor, which is 1 or, with
    ``dead_readout``, less. It is exact for ``reset: subtract``; a hard reset loses the charge above the threshold and
    gives a lower rate.

    Parameters
    ----------
    charge : ndarray, any shape
        Mean charge including the dark charge, electrons per readout.
    sensor : Sensor
        The sensor.
    """
    charge = np.asarray(charge, np.float64)
    return np.minimum(charge / (sensor.threshold_e + sensor.post_spike_loss * charge), _highest_rate(sensor))


def exposure_scale(charge_at_best: np.ndarray, target: np.ndarray, *, sensor: Sensor, mean_rate: float) -> float:
    """Return the factor by which to scale the light so that the target fires at a mean rate, including dark current.

    The mean of :func:`firing_rate` is taken over the pixels of the target. The factor is rounded to 20 bits, so
    that the order in which a processor sums cannot change a spike.

    Parameters
    ----------
    charge_at_best : ndarray, shape (H, W)
        Charge of all light groups together at the best focus of the target and gain 1, electrons per readout.
    target : ndarray of bool, shape (H, W)
        Pixels of the target.
    sensor : Sensor
        The sensor.
    mean_rate : float
        Mean rate of the target, spikes per readout.

    Raises
    ------
    BadInput
        If the target is empty, or if the rate is not above the dark rate, not below the highest rate, or out of reach
        because part of the target gives no light.
    """
    light = np.asarray(charge_at_best, np.float64)[np.asarray(target, bool)]
    if light.size == 0:
        raise BadInput("the target has no pixel", hint="check the target's shape ids and the focus travel")
    dark = sensor.mean_dark_e
    floor = float(firing_rate(np.array(dark), sensor))
    lit = float(np.mean(light > 0))
    highest = _highest_rate(sensor)
    ceiling = lit * highest + (1 - lit) * floor
    if not floor < mean_rate < highest:
        raise BadInput(
            f"mean_rate is {mean_rate:g}",
            allowed=f"above the dark rate {floor:.3g} and below {highest:.3g} spikes per readout",
        )
    if not mean_rate < ceiling:
        raise BadInput(
            f"mean_rate is {mean_rate:g}, but only {lit:.1%} of the target gives light",
            allowed=f"below {ceiling:.3g}",
            hint="light the target, or lower mean_rate",
        )
    charge = mean_rate * sensor.threshold_e / (1 - sensor.post_spike_loss * mean_rate)  # the inverse law
    low, high = 0.0, charge / light.max()
    while np.mean(firing_rate(high * light + dark, sensor)) < mean_rate:
        high *= 2
    for _ in range(64):  # the mean rate increases with the factor, so bisection converges to double precision
        middle = (low + high) / 2
        if np.mean(firing_rate(middle * light + dark, sensor)) < mean_rate:
            low = middle
        else:
            high = middle
    return _round_to_20_bits(high)


def _round_to_20_bits(value: float) -> float:
    """Return a number in which the order of a sum, which depends on the processor, does not show."""
    mantissa, exponent = frexp(value)
    return ldexp(round(ldexp(mantissa, 20)), exponent - 20)


def _highest_rate(sensor: Sensor) -> float:
    """Return the rate under unlimited light: 1, or less if dead readouts interrupt the firing.

    With ``dead_readout``, a lit readout fires and keeps n thresholds of charge, which fire in the next n readouts. They
    are dead, as is one more readout, which does not fire. The rate is therefore (n + 1)/(n + 2).
    """
    kept = sensor.max_excess_thresholds
    return (kept + 1) / (kept + 2) if sensor.saturation == "dead_readout" else 1.0
