"""Pictures in the light of real lamps, mixed from a stack that was rendered in light of one wavelength.

A lens draws in the light λ at the position p what it draws in reference light, that of the sensor's ``wavelength_m``,
at p + Δp(λ) (:mod:`saf_gen.optics.axial_colour`). The picture that a lamp gives is therefore

    E(p) = Σ w(λ)·L(p + Δp(λ))        w(λ) = S(λ)·QE(λ)·T(λ)·λ, divided by QE·λ of reference light and by ∫ S·V dλ

with L interpolated linearly between the rendered positions, S the power of the lamp, QE the quantum efficiency of the
sensor, T its filter, and V what the eye sees. Gains are illuminances: at gain 1 a lamp of any spectrum gives the lux of
the scene's card, and the electrons that the sensor makes of them follow. So a new lamp or another sensor costs no
rendering; the stack depends on neither, only on how many positions beyond the travel the lens needs.

E is exact for ``focal_length``. A lens that moves, and a stage, draw the same picture at another scale, which is not
changed here; :meth:`Colour.check` refuses what would be more than a pixel. Lateral colour of lenses read from files is
left out. Surfaces are taken to reflect all wavelengths alike, and waves bend at the aperture as those of reference
light do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from saf_gen.camera.exposure import Pixels
from saf_gen.core.spectrum import NM, describe, power_per_light
from saf_gen.errors import BadInput
from saf_gen.optics import AxialColour, FocusCriterion
from saf_gen.optics.axial_colour import shifted_positions
from saf_gen.optics.texture_contrast import Blend, Light
from saf_gen.plugins.lights import Lamp, list_lamps
from saf_gen.stack.focal_stack import StackSpec

WEIGHT_GRID = 2.0**-22
"""Weights are rounded to multiples of this step, so that spikes are the same on machines whose exponentials differ in
the last digit."""
SHARES = 128
"""Lamps' shares of the light on the target are rounded to this part of 1, to find the true focus of each mix once."""
NM_PER_PART = 7  # of the light of which the true focus is found
MAX_SCALE_PX = 1.0
MAX_BEND_PX = 0.25


class Blends(NamedTuple):
    """The mixes of light on a target over a recording.

    Attributes
    ----------
    blends : tuple of tuple
        The mixes that occur.
    number : ndarray of int, shape (T,)
        Number of the mix in each readout.
    """

    blends: tuple[Blend, ...]
    number: np.ndarray


@dataclass(frozen=True, eq=False)
class Colour:
    """The lamps of a recording, the sensor that collects their light, and the axial colour of the lens.

    Attributes
    ----------
    lamps : tuple of Lamp
        The lamps, in the order of their gains.
    sensor : Sensor, SpadSensor or FrameSensor
        Sensor of the camera.
    axial_colour : AxialColour or None
        Axial colour of the lens; None for a lens without.
    """

    lamps: tuple[Lamp, ...]
    sensor: Pixels
    axial_colour: AxialColour | None

    @classmethod
    def find(
        cls,
        schedule: Mapping[str, Any],
        groups: Sequence[str],
        *,
        sensor: Pixels,
        axial_colour: Mapping[str, Any] | None,
    ) -> "Colour | None":
        """Return the colour of a recording; None if each light group is one lamp in light of one wavelength.

        Parameters
        ----------
        schedule : mapping
            Light schedules by group, with all numbers drawn.
        groups : sequence of str
            Light groups of the scene.
        sensor : Sensor, SpadSensor or FrameSensor
            Sensor of the camera.
        axial_colour : mapping or None
            Keys of :class:`saf_gen.optics.AxialColour`.
        """
        lamps = tuple(list_lamps(schedule, groups))
        if len(lamps) == len(groups) and not any(lamp.spectrum for lamp in lamps):
            return None
        colour = AxialColour.model_validate(axial_colour) if axial_colour else None
        return cls(lamps, sensor, colour)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lamps."""
        return tuple(lamp.name for lamp in self.lamps)

    @property
    def reference_nm(self) -> float:
        """Wavelength of reference light, nm."""
        return self.sensor.wavelength_m * 1e9

    @property
    def drawn_nm(self) -> float:
        """Wavelength at which the lens draws light without a spectrum, nm."""
        stated = self.axial_colour.reference_nm if self.axial_colour else None
        return stated or self.reference_nm

    @property
    def shares(self) -> np.ndarray:
        """Part of the nominal light of a scene that each lamp gives, float32 (lamp,): of n lamps in a group, 1/n."""
        groups = [lamp.group for lamp in self.lamps]
        return np.array([1 / groups.count(group) for group in groups], np.float32)

    @cached_property
    def weights(self) -> tuple[np.ndarray, ...]:
        """Electrons per light and nanometre of each lamp, relative to reference light; float64 (wavelength,) each.

        Light without a spectrum is reference light, one weight at the nanometre nearest to that at which the lens draws
        it; no filter dims it, in mixes as alone.
        """
        single = (np.arange(NM.size) == np.abs(NM - self.drawn_nm).argmin()).astype(np.float64)
        return tuple(
            power_per_light(lamp.spectrum) * self.sensor.spectral_response() if lamp.spectrum else single
            for lamp in self.lamps
        )

    def power_shifts(self, lamp: int, spec: StackSpec) -> np.ndarray:
        """Return by how much stronger the lens is for each wavelength than for that of a stack, 1/m (wavelength,)."""
        if self.axial_colour is None or not self.lamps[lamp].spectrum:
            return np.zeros_like(NM)
        return self.axial_colour.shifts(spec.drive, NM, reference_nm=self.reference_nm)

    def mixing(self, lamp: int, spec: StackSpec, *, drawn: range, rendered: range) -> np.ndarray:
        """Return the weight of each rendered position of a stack in what a lamp draws at each position.

        Parameters
        ----------
        lamp : int
            Number of the lamp.
        spec : StackSpec
            The stack.
        drawn, rendered : range
            Indices of the positions of the pictures, and of those to mix them from.

        Returns
        -------
        ndarray of float32, shape (drawn, rendered)
            Weights, 0 or more; rows add up to the electrons that the lamp gives, relative to reference light.
        """
        weights = self.weights[lamp]
        seen = weights > 0
        steps = spec.positions - 1
        shift = self.power_shifts(lamp, spec)[seen]
        position = shifted_positions(spec.drive, (np.arange(drawn.start, drawn.stop) / steps)[:, None], shift=shift)
        knot = np.clip(position * steps - rendered.start, 0, len(rendered) - 1)
        near = np.rint(knot)
        knot = np.where(np.abs(knot - near) < 1e-9, near, knot)  # reference light is that of one picture
        before = np.minimum(knot.astype(np.int64), max(len(rendered) - 2, 0))
        after = knot - before
        found = np.zeros((len(drawn), len(rendered)))
        row = np.broadcast_to(np.arange(len(drawn))[:, None], before.shape)
        np.add.at(found, (row, before), weights[seen] * (1 - after))
        np.add.at(found, (row, np.minimum(before + 1, len(rendered) - 1)), weights[seen] * after)
        return (np.round(found / WEIGHT_GRID) * WEIGHT_GRID).astype(np.float32)

    def mix(self, radiance: np.ndarray, spec: StackSpec, *, drawn: range, rendered: range) -> np.ndarray:
        """Return what each lamp draws, as radiance of reference light that gives the same electrons.

        Sums are made plane by plane in one order, so that they are the same bit for bit on every machine.

        Parameters
        ----------
        radiance : ndarray of float32, shape (light, rendered, row, col)
            Radiance of the light groups at the rendered positions.
        spec, drawn, rendered
            See :meth:`mixing`.

        Returns
        -------
        ndarray of float32, shape (lamp, drawn, row, col)
            Radiance at gain 1.
        """
        out = np.zeros((len(self.lamps), len(drawn), *radiance.shape[2:]), np.float32)
        for n, lamp in enumerate(self.lamps):
            planes = radiance[spec.groups.index(lamp.group)]
            weights = self.mixing(n, spec, drawn=drawn, rendered=rendered)
            for k, row in enumerate(weights):
                for j in np.flatnonzero(row):
                    out[n, k] += row[j] * planes[j]
        return out

    def group_gains(self, gain: np.ndarray) -> np.ndarray:
        """Return gains of the light groups that give as many electrons as those of the lamps, float32 (T, light)."""
        electrons = gain * np.array([weights.sum() for weights in self.weights])
        groups = list(dict.fromkeys(lamp.group for lamp in self.lamps))
        of_group = np.array([[lamp.group == group for group in groups] for lamp in self.lamps], dtype=np.float64)
        return (electrons @ of_group).astype(np.float32)

    def blends(self, spec: StackSpec, *, gain: np.ndarray, charge: np.ndarray) -> Blends:
        """Return the mixes of light on a target.

        Parameters
        ----------
        spec : StackSpec
            The stack.
        gain : ndarray, shape (T, lamp)
            Gain of each lamp in each readout.
        charge : ndarray, shape (lamp,)
            Electrons that each lamp gives on the target at gain 1.
        """
        lights = [self._light(n, spec) for n in range(len(self.lamps))]
        distinct = list(dict.fromkeys(lights))
        electrons = np.zeros((len(gain), len(distinct)))
        for n, light in enumerate(lights):
            electrons[:, distinct.index(light)] += gain[:, n].astype(np.float64) * charge[n]
        total = electrons.sum(axis=1, keepdims=True)
        lit = total[:, 0] > 0
        usual = electrons[lit].sum(axis=0) if lit.any() else np.ones(len(distinct))
        shares = np.where(lit[:, None], electrons / np.where(total > 0, total, 1), usual / usual.sum())
        parts = np.diff(np.rint(np.cumsum(shares, axis=1) * SHARES), axis=1, prepend=0)  # which add up to SHARES
        found, index = np.unique(parts, axis=0, return_inverse=True)
        blends = tuple(
            tuple((float(part / SHARES), light) for part, light in zip(row, distinct, strict=True)) for row in found
        )
        return Blends(blends, index.ravel())

    def _light(self, lamp: int, spec: StackSpec) -> Light:
        """Return the light of a lamp, in parts of some nanometres."""
        weights, shifts = self.weights[lamp], self.power_shifts(lamp, spec)
        if not shifts.any():
            return Light((0.0,), (1.0,))
        part = np.arange(NM.size) // NM_PER_PART
        total = np.bincount(part, weights)
        mean = np.bincount(part, weights * shifts)[total > 0] / total[total > 0]
        return Light(tuple(mean.tolist()), tuple((total[total > 0] / total.sum()).tolist()))

    def check(self, spec: StackSpec) -> None:
        """Raise BadInput if pictures of one wavelength cannot show this light.

        They cannot if the scale would be wrong by more than a pixel at the edge of the picture, or the bending of waves
        by more than a quarter of a pixel, both rms over the light of a lamp.
        """
        bend = FocusCriterion(spec.drive, spec.pitch_m, spec.wavelength_m).spread_by_waves_m / spec.pitch_m
        edge = float(np.hypot(spec.rows, spec.columns)) / 2
        middle = 0.5
        for n, lamp in enumerate(self.lamps):
            if not lamp.spectrum:
                continue
            weights = self.weights[n] / self.weights[n].sum()
            position = shifted_positions(spec.drive, middle, shift=self.power_shifts(n, spec))
            distance = float(spec.drive.object_distance(middle))
            moved = spec.drive.shift(position) - spec.drive.shift(middle)
            scale = spec.drive.image_distance(position) / spec.drive.image_distance(middle) * distance
            off = float(np.sqrt((weights * (scale / (distance - moved) - 1) ** 2).sum())) * edge
            if off > MAX_SCALE_PX:
                raise BadInput(
                    f"in the light of {describe(lamp.spectrum)!r}, the scale of pictures of one wavelength would be "
                    f"wrong by {off:.2g} pixels at the edge",
                    allowed=f"at most {MAX_SCALE_PX:g}; the drive focal_length keeps the scale",
                    hint="give the lens less axial_colour, or the camera an IR cut with filter: ir_cut",
                )
            wider = bend * float(np.sqrt((weights * (NM / self.reference_nm - 1) ** 2).sum()))
            if spec.wavelength_m and wider > MAX_BEND_PX:
                raise BadInput(
                    f"waves of {describe(lamp.spectrum)!r} would spread a point over {wider:.2g} pixels more or less "
                    f"than those of {self.reference_nm:.0f} nm, with which they are rendered",
                    allowed=f"at most {MAX_BEND_PX:g} pixels",
                    hint="give the camera an IR cut with filter: ir_cut, or leave waves out with "
                    "render: {diffraction: false}",
                )
