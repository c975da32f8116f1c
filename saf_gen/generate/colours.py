"""The colour of the lenses of a recipe: what each does to light of other wavelengths, and whether pictures show it."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from math import hypot
from typing import Any, NamedTuple, Protocol

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.core.spectrum import NM, describe
from saf_gen.errors import BadInput, located
from saf_gen.generate.recipe import Recipe
from saf_gen.optics import AxialColour, FittedLensDrive
from saf_gen.optics.axial_colour import BAND_NM, stack_margin
from saf_gen.optics.fitted_file import FittedLens
from saf_gen.optics.lens_card import LensFile
from saf_gen.optics.lens_colour import Neglected, band_waves, hats, lens_colour, neglected
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


def find_bands(recipe: Recipe, scene: Scene) -> tuple[float, ...]:
    """Return the wavelengths (nm) at which a scene is rendered for lights with spectra; none if it is one as ever."""
    lens = scene.card.lens
    if recipe.render.bands == 1 or not isinstance(lens, LensFile):
        return ()
    return band_waves(lens.lens, recipe.render.bands)


def in_bands(spec: StackSpec, scene: Scene, *, bands_nm: Sequence[float]) -> tuple[StackSpec, ...]:
    """Return a stack at each of these wavelengths (nm): its lens, and its waves unless they are left out.

    Without any of them it is the stack itself. Raises BadInput if the lens cannot be shown at one of them.
    """
    lens, found = scene.card.lens, list[StackSpec]()
    for nm in bands_nm:
        assert isinstance(lens, LensFile)  # others have no bands
        assert isinstance(spec.drive, FittedLensDrive)  # that of a lens file
        drive = replace(spec.drive, wavefront=lens.lens.rays_at(nm))
        found.append(replace(spec, drive=drive, wavelength_m=nm * 1e-9 if spec.wavelength_m else 0.0))
        found[-1].in_focus.check(rows=spec.rows, columns=spec.columns)
    return tuple(found) or (spec,)


def find_margin(
    spec: StackSpec, recipe: Recipe, *, scene: Scene, sensor: Sensor, bands_nm: Sequence[float]
) -> tuple[int, int]:
    """Return how many positions beyond the travel the stacks of a scene need.

    They are the same under every light of the recipe, with a spectrum or without, so that all share their stacks. In
    bands they are those that the colour between a band and the next needs, and none for lights without a spectrum.
    """
    colour, reference = axial_colour(recipe, scene), sensor.wavelength_m * 1e9
    if colour is None or not any(map(states_spectrum, recipe.lights.values())):
        return (0, 0)
    if find_bands(recipe, scene) and not bands_nm:
        return (0, 0)
    margin = (0, 0)
    for part, drawn in zip(hats(BAND_NM, bands_nm), bands_nm or (colour.reference_nm,), strict=True):
        of_band, seen = colour.relative_to(drawn), BAND_NM[part > 0]
        more = stack_margin(of_band, spec.drive, positions=spec.positions, reference_nm=reference, nm=seen)
        margin = max(margin[0], more[0]), max(margin[1], more[1])
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
    """Raise BadInput if a filter has nothing to filter, pictures of few wavelengths cannot show a lamp's light, or more
    of them show it no better.
    """
    coloured, banded, better = False, False, False
    for s, colour in _distinct(sequences):
        coloured |= any(lamp.spectrum for lamp in colour.lamps)
        with located("", prefix=f"light {s.planned.light!r} on {s.planned.scene}: "):
            colour.check([band[0] for band in s.time_stack.bands])
            banded |= bool(colour.bands_nm)
            better |= _check_lacks(s, colour)
    bands = recipe.render.bands
    if bands > 1 and not banded:
        raise BadInput(
            f"render.bands is {bands}, but no light with a spectrum falls through a lens that is read from a file",
            allowed="1",
            hint="give a light a spectrum, and a scene a lens such as {file: double_gauss, …}",
        )
    if bands > 1 and not better:
        raise BadInput(
            f"render.bands is {bands}, which shows no light of this recipe better than one wavelength does",
            allowed="1, or more of them",
        )
    if recipe.camera.filter not in (None, "none") and not coloured:
        raise BadInput(
            f"camera.filter is {recipe.camera.filter}, but no light has a spectrum",
            allowed="a filter if at least one light states its spectrum",
            hint="give a light a spectrum, such as {kind: constant, spectrum: led}, or remove the filter",
        )


def missing_colours(sequences: Iterable[Drawn]) -> list[str]:
    """Return a line for each lamp and lens read from a file: what mixed pictures do not show of them."""
    lacks = [lack for s, colour in _distinct(sequences) for lack in _find_lacks(s, colour)]
    return list(dict.fromkeys(lack.line for lack in lacks))


class _Lack(NamedTuple):
    """What pictures of a lamp lack: lateral colour and blur, in pixels, and in words."""

    lateral: float
    blur: float
    line: str


def _distinct(sequences: Iterable[Drawn]) -> Iterator[tuple[Drawn, Colour]]:
    """Return the first sequence for each stack and the spectra on it; light of one wavelength has no colour."""
    seen = set[str]()
    for s in sequences:
        spec, planned = s.time_stack.specs[0], s.planned
        colour = Colour.find(
            planned.schedule, spec.groups, sensor=s.sensor, axial_colour=planned.axial_colour, bands_nm=planned.bands_nm
        )
        if colour is None:
            continue
        key = json.dumps([spec.key, [lamp.spectrum for lamp in colour.lamps]], sort_keys=True)
        if key not in seen:
            seen.add(key)
            yield s, colour


@lru_cache(maxsize=256)
def _neglected(lens: FittedLens, drive: FittedLensDrive, *, electrons: bytes, **what: Any) -> Neglected:
    """Return what pictures lack, by the float64 electrons at NM; both the check and the remarks of a recipe ask."""
    return neglected(lens, drive, weights=np.frombuffer(electrons), nm=NM, **what)


def _find_lacks(s: Drawn, colour: Colour) -> list[_Lack]:
    """Return what the pictures of each lamp with a spectrum lack, if the lens is read from a file.

    Raises BadInput if the lens is not fitted for its light.
    """
    card, spec, found = s.scene.card.lens if isinstance(s.scene, Scene) else None, s.time_stack.specs[0], list[_Lack]()
    count = f"{len(colour.bands_nm)} wavelengths" if colour.bands_nm else "one wavelength"
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
        what = {"colour": colour.axial_colour, "height_m": height, "bands_nm": colour.bands_nm}
        off_m = _neglected(card.lens, spec.drive, electrons=weights.tobytes(), **what)
        lateral, blur = (off / spec.pitch_m for off in off_m)
        line = (
            f"{s.planned.scene} under {name!r}: pictures mixed from those of {count} leave out lateral "
            f"colour of up to {lateral:.2g} pixels rms and a blur of {blur:.2g}; {beyond:.1%} of the electrons are "
            f"beyond {low:g} to {high:g} nm and focus as at its ends"
        )
        found.append(_Lack(lateral, blur, line))
    return found


def _check_lacks(s: Drawn, colour: Colour) -> bool:
    """Return whether bands show a lamp's light better than one wavelength; raise BadInput if too much is lacking."""
    lacks = _find_lacks(s, colour)
    for lack in lacks:
        if max(lack.lateral, lack.blur) > MAX_SCALE_PX:
            raise BadInput(
                lack.line,
                allowed=f"at most {MAX_SCALE_PX:g} of either",
                hint=f"render: {{bands: {len(colour.bands_nm) + 4}}}, a higher f_number, a smaller picture, or an IR "
                "cut with filter: ir_cut",
            )
    if not colour.bands_nm:
        return False
    ones = _find_lacks(s, replace(colour, bands_nm=()))
    return any(hypot(*now[:2]) < hypot(*one[:2]) for now, one in zip(lacks, ones, strict=True))
