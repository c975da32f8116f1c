"""The grain of a recording's pictures, as a stream file keeps it: ``/provenance/grain``, text in JSON.

Grain is what the renderer's finite number of light paths leaves. The recording's own noise, that of the sensor, is not
in it. A file without this text, as every file of other programs, is read all the same: its grain is unknown.
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
    """The grain of the picture that the sensor saw at a frame, all lights at their gains, in the target's box.

    position : of the rendered plane nearest to the lens, 0 to 1.
    rms : root mean square of the noise over the mean.
    noise, signal : energies over the squared mean, by name, those of :data:`saf_gen.stack.grain.ENERGIES`: what a focus
        measure of that name, divided by the squared brightness, gets from the noise and from the picture without it.
    """

    frame: int
    position: float
    rms: float
    noise: Mapping[str, float]
    signal: Mapping[str, float]


@dataclass(frozen=True)
class RecordedGrain:
    """The grain along a recording.

    moments : at rising frames.
    focus : index of the moment nearest to that at which the lens is at the truth.
    samples : samples per pixel of the pictures, and of the second render that they were compared with.
    """

    moments: tuple[GrainMoment, ...]
    focus: int
    samples: tuple[int, int]

    @property
    def rms_in_focus(self) -> float:
        """The rms of the noise over the mean at best focus, or as near to it as is known."""
        return self.moments[self.focus].rms

    @property
    def rms_range(self) -> tuple[float, float]:
        """The smallest and the largest rms along the recording; NaN where no picture has light."""
        known = [moment.rms for moment in self.moments if math.isfinite(moment.rms)]
        return (min(known), max(known)) if known else (math.nan, math.nan)

    def noise_over_curve(self, energy: str, *, curve_range: float | None = None) -> float:
        """Return the largest noise energy along the recording over the range of the focus curve of that energy.

        ``curve_range`` is in units of the squared mean; by default that of the signal along the recording. NaN where
        nothing is known of the energy, infinite where its curve is flat.
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
        """Return the text that a stream file keeps."""
        return json.dumps(_rounded(asdict(self)), indent=1)


def read_grain_of_stream(provenance: Mapping[str, str]) -> RecordedGrain | None:
    """Return the grain that a stream's provenance states; None where it states none, or none that can be read."""
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
    """Return plain data whose floats are rounded; JSON has no word for what is no number, so that becomes None."""
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value
