"""The grain of the pictures from which a stream was recorded, stored as JSON text in ``/provenance/grain``.

Grain is the noise that the renderer's finite number of light paths leaves; it does not include the noise of the sensor.
A file without this text, such as a file from another program, can still be read; its grain is unknown.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from saf_gen.core.config.json_document import load_plain_json

PROVENANCE_KEY = "grain"
DIGITS = 6


@dataclass(frozen=True)
class GrainMoment:
    """The grain of the picture that the sensor saw in one frame, in the box around the target.

    All lights are at their gains in that frame.

    Attributes
    ----------
    frame : int
        The frame, from 0.
    position : float
        Position, 0 to 1, of the rendered focus plane nearest to the lens.
    rms : float
        Root mean square of the noise, divided by the mean.
    noise, signal : mapping of str to float
        Energies of the noise and of the picture without noise, divided by the squared mean, by the names in
        :data:`saf_gen.stack.grain.ENERGIES`. Focus measures of these names, divided by the squared brightness, return
        the same numbers.
    """

    frame: int
    position: float
    rms: float
    noise: Mapping[str, float]
    signal: Mapping[str, float]


@dataclass(frozen=True)
class RecordedGrain:
    """The grain along a recording.

    Attributes
    ----------
    moments : tuple of GrainMoment
        Grain at some frames, in ascending order.
    focus : int
        Index of the moment at which the lens is nearest to the truth.
    samples : tuple of int
        Samples per pixel of the pictures, and of the second render with which they were compared.
    """

    moments: tuple[GrainMoment, ...]
    focus: int
    samples: tuple[int, int]

    @property
    def rms_in_focus(self) -> float:
        """The rms of the noise, divided by the mean, at the moment at which the lens is nearest to the truth."""
        return self.moments[self.focus].rms

    @property
    def rms_range(self) -> tuple[float, float]:
        """The smallest and the largest rms along the recording; NaN if no picture has light."""
        known = [moment.rms for moment in self.moments if math.isfinite(moment.rms)]
        return (min(known), max(known)) if known else (math.nan, math.nan)

    def noise_over_curve(self, energy: str, *, curve_range: float | None = None) -> float:
        """Return the largest noise energy along the recording, divided by the range of the focus curve of that energy.

        ``curve_range`` is in units of the squared mean; by default it is the range of the signal along the recording.
        The result is NaN if the energy is unknown; if its curve is flat, it is infinite with noise and NaN without.
        """
        noise = [m.noise[energy] for m in self.moments if math.isfinite(m.noise.get(energy, math.nan))]
        signal = [m.signal[energy] for m in self.moments if math.isfinite(m.signal.get(energy, math.nan))]
        if not noise or not signal:
            return math.nan
        reach = max(signal) - min(signal) if curve_range is None else curve_range
        if not reach > 0:
            return math.inf if max(noise) > 0 else math.nan
        return max(noise) / reach

    def to_text(self) -> str:
        """Return the grain as the JSON text that a stream file stores."""
        return json.dumps(_rounded(asdict(self)), indent=1)


def grain_of_stream(provenance: Mapping[str, str]) -> RecordedGrain | None:
    """Return the grain that the provenance of a stream states; None if it is missing or cannot be read."""
    try:
        data = load_plain_json(provenance[PROVENANCE_KEY])
        moments = tuple(
            GrainMoment(
                int(one["frame"]),
                _number(one["position"]),
                _number(one["rms"]),
                {name: _number(value) for name, value in one["noise"].items()},
                {name: _number(value) for name, value in one["signal"].items()},
            )
            for one in data["moments"]
        )
        first, second = data["samples"]
        grain = RecordedGrain(moments, int(data["focus"]), (int(first), int(second)))
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError):
        return None
    return grain if 0 <= grain.focus < len(moments) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _rounded(value: Any) -> Any:
    """Return plain data with rounded floats; NaN and infinity, which JSON cannot express, become None."""
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value
