"""The colour of the lenses of a recipe: what each does to light of other wavelengths, and whether pictures show it."""

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.core.spectrum import NM, describe
from saf_gen.errors import BadInput, located
from saf_gen.generate.recipe import Recipe
from saf_gen.optics import AxialColour, FittedLensDrive
from saf_gen.optics.axial_colour import stack_margin
from saf_gen.optics.fitted_file import FittedLens
from saf_gen.optics.lens_card import LensFile
from saf_gen.optics.lens_colour import lens_colour
from saf_gen.plugins.lights import states_spectrum
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.colour import Colour
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.picture_stack import PictureStack
from saf_gen.stack.time_resolved import TimeResolvedStack

MAX_BEYOND = 0.05
"""Largest part of a lamp's electrons whose wavelength a lens read from a file is not fitted for."""
MAX_EXTRAPOLATED = 0.01
"""Largest part by which the sensor may be beyond the distances for which such a lens is fitted."""


class Drawn(Protocol):
    """A sequence whose scene, stacks and sensor are known (:class:`saf_gen.generate.resolve.ResolvedSequence`)."""

    @property
    def planned(self) -> Any:
        """The numbers drawn for it."""

    @property
    def scene(self) -> Scene | PictureStack:
        """Its scene, or the stack that was photographed."""

    @property
    def time_stack(self) -> TimeResolvedStack:
        """Its stacks."""

    @property
    def sensor(self) -> Sensor:
        """Its sensor."""


def axial_colour(recipe: Recipe, scene: Scene) -> AxialColour | None:
    """Return the axial colour of a scene's lens: that of a lens read from a file if it is one, else that of the recipe
    if it states one, else that of the card.

    Raises
    ------
    BadInput
        If the scene is a thin section, or the recipe states another colour for a lens read from a file.
    """
    lens, mixed = scene.card.lens, any(map(states_spectrum, recipe.lights.values()))
    if scene.card.section is not None:
        if mixed or recipe.focus.axial_colour is not None:
            raise BadInput(
                f"scene {scene.id!r} is a thin section, and is drawn at one wavelength",
                allowed="lights without a spectrum, and no axial_colour",
                hint="or leave the scene out",
            )
        return None
    if not isinstance(lens, LensFile):
        return recipe.focus.axial_colour or lens.axial_colour
    for key in ("axial_colour", *(("aberrations",) if mixed else ())):  # those of a typical lens have no colour
        if getattr(recipe.focus, key) is not None:
            raise BadInput(
                f"focus.{key} is stated, and the lens of scene {scene.id!r} is read from a file",
                allowed=f"no {key}: a real lens brings its own",
                hint="or leave the scene out",
            )
    if not mixed:
        return None
    drive = scene.build_drive(recipe.camera.exposure.f_number)
    assert isinstance(drive, FittedLensDrive)  # that of a lens file
    return lens_colour(lens.lens, drive, drawn_nm=lens.wave_nm or lens.lens.primary_nm)


def find_margin(spec: StackSpec, recipe: Recipe, *, scene: Scene, sensor: Sensor) -> tuple[int, int]:
    """Return how many positions beyond the travel the stacks of a scene need.

    They are the same under every light of the recipe, with a spectrum or without, so that all share their stacks.
    """
    colour = axial_colour(recipe, scene)
    if colour is None or not any(map(states_spectrum, recipe.lights.values())):
        return (0, 0)
    margin = stack_margin(colour, spec.drive, positions=spec.positions, reference_nm=sensor.wavelength_m * 1e9)
    if isinstance(scene.card.lens, LensFile):
        f, nearest = spec.drive.focused_image_distance(np.array([0.0, 1 / scene.card.lens.lens.nearest_m]))  # type: ignore[attr-defined]
        ends = np.array([-margin[0], spec.positions - 1 + margin[1]]) / (spec.positions - 1)
        v = spec.drive.image_distance(ends)
        if not (v.min() >= f * (1 - MAX_EXTRAPOLATED) and v.max() <= nearest * (1 + MAX_EXTRAPOLATED)):
            raise BadInput(
                f"colour moves the focus to where {scene.card.lens.lens.name} is not fitted",
                allowed=f"sensor distances within {MAX_EXTRAPOLATED:.0%} of those in focus from infinity to "
                f"{scene.card.lens.lens.nearest_m:g} m",
                hint="a focus_range_m that ends farther away, or saf-gen lens fit --nearest-m",
            )
    return margin


def check_colours(sequences: Iterable[Drawn], recipe: Recipe) -> None:
    """Raise BadInput if a filter has nothing to filter, or pictures of one wavelength cannot show a lamp's light."""
    met, coloured = set[str](), False
    for s in sequences:
        spec, planned = s.time_stack.specs[0], s.planned
        colour = Colour.find(planned.schedule, spec.groups, sensor=s.sensor, axial_colour=planned.axial_colour)
        key = f"{spec.key} {[lamp.spectrum for lamp in colour.lamps] if colour else None}"
        if colour is None or key in met:
            continue
        met.add(key)
        coloured |= any(lamp.spectrum for lamp in colour.lamps)
        with located("", prefix=f"light {planned.light!r} on {planned.scene}: "):
            colour.check(spec)
            if isinstance(s.scene, Scene) and isinstance(s.scene.card.lens, LensFile):
                _check_fitted(s.scene.card.lens.lens, colour)
    if recipe.camera.filter not in (None, "none") and not coloured:
        raise BadInput(
            f"camera.filter is {recipe.camera.filter}, but no light has a spectrum",
            allowed="a filter if at least one light states its spectrum",
            hint="give a light a spectrum, such as {kind: constant, spectrum: led}, or remove the filter",
        )


def _check_fitted(lens: FittedLens, colour: Colour) -> None:
    """Raise BadInput if much of a lamp's light has wavelengths for which a lens read from a file is not fitted."""
    low, high = lens.waves_nm
    for lamp, weights in zip(colour.lamps, colour.weights, strict=True):
        beyond = float(weights[(low > NM) | (high < NM)].sum() / weights.sum())
        if lamp.spectrum and beyond > MAX_BEYOND:
            raise BadInput(
                f"{beyond:.0%} of the electrons of {describe(lamp.spectrum)!r} are of light for which {lens.name} is "
                "not fitted",
                allowed=f"at most {MAX_BEYOND:.0%} beyond {low:g} to {high:g} nm",
                hint="give the camera an IR cut with filter: ir_cut, or fit the lens with saf-gen lens fit --waves-nm",
            )
