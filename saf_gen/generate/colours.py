"""The colour of the lenses of a recipe: what each does to light of other wavelengths, and whether pictures show it."""

import json
from collections.abc import Iterable, Iterator
from typing import Any, Protocol

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.core.spectrum import NM, describe
from saf_gen.errors import BadInput, located
from saf_gen.generate.recipe import Recipe
from saf_gen.optics import AxialColour, FittedLensDrive
from saf_gen.optics.axial_colour import stack_margin
from saf_gen.optics.lens_card import LensFile
from saf_gen.optics.lens_colour import lens_colour, neglected
from saf_gen.plugins.lights import states_spectrum
from saf_gen.scene.scene_folder import Scene
from saf_gen.stack.colour import MAX_SCALE_PX, Colour
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
    coloured = False
    for s, colour in _distinct(sequences):
        coloured |= any(lamp.spectrum for lamp in colour.lamps)
        with located("", prefix=f"light {s.planned.light!r} on {s.planned.scene}: "):
            colour.check(s.time_stack.specs[0])
            _lacks(s, colour)
    if recipe.camera.filter not in (None, "none") and not coloured:
        raise BadInput(
            f"camera.filter is {recipe.camera.filter}, but no light has a spectrum",
            allowed="a filter if at least one light states its spectrum",
            hint="give a light a spectrum, such as {kind: constant, spectrum: led}, or remove the filter",
        )


def missing_colours(sequences: Iterable[Drawn]) -> list[str]:
    """Return a line for each lamp and lens read from a file: what mixed pictures do not show of them."""
    return list(dict.fromkeys(line for s, colour in _distinct(sequences) for line in _lacks(s, colour)))


def _distinct(sequences: Iterable[Drawn]) -> Iterator[tuple[Drawn, Colour]]:
    """Return the first sequence for each stack and the spectra on it; light of one wavelength has no colour."""
    seen = set[str]()
    for s in sequences:
        spec, planned = s.time_stack.specs[0], s.planned
        colour = Colour.find(planned.schedule, spec.groups, sensor=s.sensor, axial_colour=planned.axial_colour)
        if colour is None:
            continue
        key = json.dumps([spec.key, [lamp.spectrum for lamp in colour.lamps]], sort_keys=True)
        if key not in seen:
            seen.add(key)
            yield s, colour


def _lacks(s: Drawn, colour: Colour) -> list[str]:
    """Return a line for each lamp, what its pictures lack; raise BadInput if it is too much to be shown."""
    card, spec, found = s.scene.card.lens if isinstance(s.scene, Scene) else None, s.time_stack.specs[0], list[str]()
    if not isinstance(card, LensFile) or colour.axial_colour is None:
        return found
    assert isinstance(spec.drive, FittedLensDrive)  # that of a lens file
    low, high = card.lens.waves_nm
    height = float(np.hypot(spec.rows, spec.columns)) / 2 * spec.pitch_m
    for lamp, weights in zip(colour.lamps, colour.weights, strict=True):
        if not lamp.spectrum:
            continue
        name = describe(lamp.spectrum)
        beyond = float(weights[(low > NM) | (high < NM)].sum() / weights.sum())
        if beyond > MAX_BEYOND:
            raise BadInput(
                f"{beyond:.0%} of the electrons of {name!r} are of light for which {card.lens.name} is not fitted",
                allowed=f"at most {MAX_BEYOND:.0%} beyond {low:g} to {high:g} nm",
                hint="give the camera an IR cut with filter: ir_cut, or fit the lens with saf-gen lens fit --waves-nm",
            )
        lack = neglected(card.lens, spec.drive, colour=colour.axial_colour, weights=weights, nm=NM, height_m=height)
        lateral, blur = lack.lateral_m / spec.pitch_m, lack.blur_m / spec.pitch_m
        if max(lateral, blur) > MAX_SCALE_PX:
            raise BadInput(
                f"pictures of one wavelength show {name!r} through {card.lens.name} {lateral:.2g} pixels beside its "
                f"place, and leave out a blur of {blur:.2g}",
                allowed=f"at most {MAX_SCALE_PX:g} of either",
                hint="a higher f_number, a smaller picture, or an IR cut with filter: ir_cut",
            )
        found.append(
            f"{s.planned.scene} under {name!r}: pictures mixed from those of one wavelength leave out lateral "
            f"colour of up to {lateral:.2g} pixels rms and a blur of {blur:.2g}; {beyond:.1%} of the electrons are "
            f"beyond {low:g} to {high:g} nm and focus as at its ends"
        )
    return found
