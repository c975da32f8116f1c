"""What single-photon arrays and frame cameras have in common: they are exposed once in each frame."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any, ClassVar, Self

import numpy as np

from saf_gen.camera.camera import Readouts
from saf_gen.camera.sensor import Sensor, SpectralCurve, spectral_response
from saf_gen.core.config.presets import change_fields
from saf_gen.errors import BadInput

OF_PLACE = (
    "rows", "columns", "pitch_m", "fill_factor", "quantum_efficiency", "wavelength_m", "spectral_qe", "filter"
)  # fmt: skip
"""Fields that a sensor has from where it stands and what it looks at, if it takes the place of a spike camera."""


class ExposedSensor:
    """A sensor that collects light from the beginning of each frame, for at most a frame.

    It has no fields of its own: each sensor lists all of them, in the order in which its files hold them.
    """

    kind: ClassVar[str]
    switched: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    name: str
    rows: int
    columns: int
    readout_hz: float
    exposure_s: float
    shortest_exposure_s: float
    quantum_efficiency: float
    wavelength_m: float
    spectral_qe: SpectralCurve
    filter: SpectralCurve

    def __post_init__(self) -> None:
        longest = 1 / self.readout_hz
        if not self.shortest_exposure_s <= self.exposure_s <= longest * (1 + 1e-9):
            raise BadInput(
                f"exposure_s is {self.exposure_s:g}",
                where=f"sensor {self.name}",
                allowed=f"{self.shortest_exposure_s:g} (shortest_exposure_s) to {longest:.6g} s (a frame)",
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        return asdict(self)  # type: ignore[call-overload]

    def spectral_response(self) -> np.ndarray:
        """Return what is detected per joule and nanometre of light, as :meth:`saf_gen.camera.Sensor.spectral_response`.

        Raises BadInput as that does.
        """
        return spectral_response(
            self.spectral_qe, self.filter, wavelength_m=self.wavelength_m, quantum_efficiency=self.quantum_efficiency
        )

    def with_noise(self, **switches: bool) -> Self:
        """Return a copy with some imperfections switched on or off, such as ``with_noise(dark=False)``.

        Raises BadInput if a switch is unknown.
        """
        return change_fields(self, {"noise": switches}, where=f"sensor {self.name}")

    def in_place_of(self, sensor: Sensor) -> Self:
        """Return a copy that stands on the grid of a spike camera, and collects as much light as that does.

        What differs is then what a pixel makes of it.
        """
        return replace(self, **{name: getattr(sensor, name) for name in OF_PLACE})  # type: ignore[type-var]

    def exposed_for(self, electrons_per_s: np.ndarray) -> Self:
        """Return a copy with the exposure that suits pixels in this light, (n,): by default that of the sensor."""
        return self

    def readouts(self, seconds: float) -> Readouts:
        """Return the whole frames of a recording; a frame is said to have been taken in the middle of its time.

        Raises BadInput if the recording is shorter than a frame.
        """
        hz = self.readout_hz
        frames = int(seconds * hz + 1e-9)
        if frames < 1:
            raise BadInput(f"the sequence lasts {seconds:g} s", allowed="at least a frame")
        return Readouts(frames, hz, min(self.exposure_s * hz, 1.0) / hz, np.zeros(1), 0.5 / hz)
