"""Pictures in the light of lamps, mixed from one stack, against pictures rendered at each wavelength."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from written_scenes import dispersion, load_setup, needs_llvm, render_stack_once, write_scene

from saf_gen.camera import get_sensor
from saf_gen.optics import AxialColour, FocalLengthDrive, ImageDistanceDrive
from saf_gen.optics.axial_colour import stack_margin
from saf_gen.optics.fitted_file import read_lens
from saf_gen.optics.lens_colour import lens_colour
from saf_gen.render import render_missing
from saf_gen.render.render_setup import SensorGrid
from saf_gen.stack.colour import Colour
from saf_gen.stack.focal_stack import StackSpec
from studies.laws.colour import electrons_per_nm
from studies.laws.pupils import find_peak

PITCH_M, POSITIONS, HALF_DEPTHS = 20e-6, 65, 5.5
GRID = SensorGrid(rows=32, columns=48, pitch_m=PITCH_M)
DISTANCE_M, FOCAL_M, RADIUS_M = 0.65, 0.05, 0.0125
ACHROMAT = AxialColour(achromat=2000)
REFERENCE_NM = 555.0
TEXTURED = (
    "{'glow': {'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).scale(0.01 * m), 'emitter': {'type': 'area',"
    " 'radiance': {'type': 'bitmap', 'raw': True, 'bitmap': mi.Bitmap(np.float32(0.2) +"
    " np.random.default_rng(3).random((128, 128, 1), dtype=np.float32).repeat(3, axis=2))}}}}"
)


def reference_drive(kind):
    """A lens of 50 mm at f/2, over 5.5 half depths of focus (a blur of one pixel) on either side of the target."""
    v = 1 / (1 / FOCAL_M - 1 / DISTANCE_M)
    half = PITCH_M / (2 * RADIUS_M * v)
    ends = tuple(1 / (1 / DISTANCE_M + sign * HALF_DEPTHS * half) for sign in (-1, 1))
    if kind == "focal_length":
        return FocalLengthDrive(v, v / (2 * RADIUS_M), ends)
    return ImageDistanceDrive(FOCAL_M, FOCAL_M / (2 * RADIUS_M), ends)


def glowing(folder, monkeypatch):
    """A textured lamp that fills the picture; the lens of the card is replaced by that of each test."""
    card = "{focal_length_mm: 50, f_number: 2, focus_range_m: [0.7, 0.6]}"
    picture = {"distance_m": DISTANCE_M, "shapes": TEXTURED, "light": "glow", "target": "glow", "unit_m": 0.001}
    return write_scene(folder, monkeypatch, lens=card, **picture)


def drive_in_light(drive, shift):
    """The same lens for light in which its power is larger by ``shift`` (1/m): as a lens of its own."""
    if isinstance(drive, FocalLengthDrive):
        return replace(drive, focus_range_m=tuple(1 / (1 / u + shift) for u in drive.focus_range_m))
    focal = 1 / (1 / FOCAL_M + shift)
    ends = tuple(1 / (1 / focal - 1 / float(v)) for v in drive.image_distance(np.array([0.0, 1.0])))
    return ImageDistanceDrive(focal, focal / (2 * RADIUS_M), ends)


@pytest.mark.slow
@needs_llvm
@pytest.mark.parametrize("kind", ["focal_length", "image_distance"])
def test_the_focus_under_tungsten_and_led_is_that_of_pictures_of_each_wavelength(tmp_path, monkeypatch, kind):
    """SD of mixed pictures peaks within 0.05 half depths of SD of an own sum, with and without an IR cut.

    The own sum is over stacks that are rendered at 24 wavelengths with a lens of the focal length that it has there.
    Positions are 0.17 half depths apart. 64 samples, fixed seeds; they differ by 0.02. The truth is on the same side.
    """
    drive = reference_drive(kind)
    scene = glowing(tmp_path, monkeypatch)
    margin = stack_margin(ACHROMAT, drive, positions=POSITIONS, reference_nm=REFERENCE_NM)
    spec = StackSpec("made", "0", ("glow",), drive, GRID.rows, GRID.columns, PITCH_M, POSITIONS, 64, 3, margin=margin)
    setup = load_setup(scene, ("glow",), grid=GRID, drive=drive)
    wide = render_stack_once(setup, positions=POSITIONS, samples=64, seed=1, window=spec.indices)
    edges = np.linspace(380, 1100, 25)
    middles = (edges[1:] + edges[:-1]) / 2
    shifts = ACHROMAT.relative_power(middles, reference_nm=REFERENCE_NM) / (2 * RADIUS_M * drive.f_number)
    single = [
        render_stack_once(replace(setup, drive=drive_in_light(drive, shift)), positions=POSITIONS, samples=64, seed=2)
        for shift in shifts
    ]
    step = 2 * HALF_DEPTHS / (POSITIONS - 1)
    for cut in (False, True):
        sensor = get_sensor("vidar_400x250", filter="ir_cut" if cut else "none")
        found = {}
        for lamp in ("tungsten", "led"):
            colour = Colour.find(
                {"": {"kind": "constant", "spectrum": lamp}}, ("glow",), sensor=sensor,
                axial_colour=ACHROMAT.model_dump(exclude_none=True),
            )  # fmt: skip
            rendered = range(-margin[0], POSITIONS + margin[1])
            mixed = colour.mix(wide[None], spec, drawn=range(POSITIONS), rendered=rendered)[0]
            nm = np.arange(380, 1100) + 0.5
            own = np.histogram(nm, edges, weights=electrons_per_nm(lamp, nm, cut=cut))[0]
            summed = np.tensordot(own / own.sum(), np.array(single), 1)
            peaks = [find_peak(dispersion(stack), around=6) * step for stack in (mixed, summed)]
            assert peaks[0] == pytest.approx(peaks[1], abs=0.05), (lamp, cut)
            found[lamp] = peaks[0]
            flat = np.full((1, 1), DISTANCE_M)
            blend = colour.blends(spec, gain=np.ones((1, 1)), charge=np.ones(1)).blends[0]
            truth = replace(spec.in_focus, blend=blend).true_focus(flat, flat > 0) * (POSITIONS - 1) * step
            assert truth == pytest.approx(peaks[0], abs=0.4)  # the texture is finer than that of the truth
        apart = abs(found["tungsten"] - found["led"])
        assert apart == pytest.approx(0.1, abs=0.1) if cut else apart > 0.6


@pytest.mark.slow
@needs_llvm
def test_the_focus_of_a_lens_file_in_lamplight_is_that_of_its_rays_of_each_wavelength(tmp_path, monkeypatch):
    """SD of mixed pictures of `c_mount` at f/1.4 peaks within 0.05 half depths of SD of an own sum, behind an IR cut.

    The own sum is of stacks rendered with the rays of 12 wavelengths, 0.17 half depths a step. 64 samples, fixed seeds.
    """
    v = 1 / (1 / 0.025 - 1 / DISTANCE_M)
    ends = [1 / (1 / DISTANCE_M + sign * 5.5 * PITCH_M * 1.4 / 0.025 / v) for sign in (-1, 1)]
    picture = {"distance_m": DISTANCE_M, "shapes": TEXTURED.replace("0.01 * m", "0.02 * m"), "light": "glow"}
    card = f"{{file: c_mount, f_number: 1.4, focus_range_m: {ends}}}"
    scene = write_scene(tmp_path, monkeypatch, lens=card, target="glow", unit_m=0.001, **picture)
    lens, drive = read_lens("c_mount"), scene.build_drive()
    found = lens_colour(lens, drive, drawn_nm=lens.primary_nm)
    margin = stack_margin(found, drive, positions=POSITIONS, reference_nm=REFERENCE_NM)
    spec = StackSpec("made", "0", ("glow",), drive, GRID.rows, GRID.columns, PITCH_M, POSITIONS, 64, 3, margin=margin)
    setup = load_setup(scene, ("glow",), grid=GRID, drive=drive)
    wide = render_stack_once(setup, positions=POSITIONS, samples=64, seed=1, window=spec.indices)
    edges = np.linspace(400, 700, 13)
    single = [
        render_stack_once(
            replace(setup, drive=replace(drive, wavefront=lens.rays_at(nm))), positions=POSITIONS, samples=64, seed=2
        )
        for nm in (edges[1:] + edges[:-1]) / 2
    ]
    sensor, step, seen = get_sensor("vidar_400x250", filter="ir_cut"), 11 / (POSITIONS - 1), []
    for lamp in ("tungsten", "led"):
        schedule = {"": {"kind": "constant", "spectrum": lamp}}
        colour = Colour.find(
            schedule, ("glow",), sensor=sensor, axial_colour=found.model_dump(mode="json", exclude_none=True)
        )
        rendered = range(-margin[0], POSITIONS + margin[1])
        mixed = colour.mix(wide[None], spec, drawn=range(POSITIONS), rendered=rendered)[0]
        nm = np.arange(400, 700) + 0.5
        own = np.histogram(nm, edges, weights=electrons_per_nm(lamp, nm, cut=True))[0]
        summed = np.tensordot(own / own.sum(), np.array(single), 1)
        peaks = [find_peak(dispersion(stack), around=6) * step for stack in (mixed, summed)]
        assert peaks[0] == pytest.approx(peaks[1], abs=0.05), lamp
        seen.append(peaks[0])
    assert abs(seen[0] - seen[1]) > 0.1


@pytest.mark.slow
@needs_llvm
def test_positions_of_the_travel_are_drawn_as_in_a_narrow_stack(tmp_path, monkeypatch):
    """The middle of a wide stack and a narrow one show the same picture, within the noise of their paths."""
    drive = reference_drive("image_distance")
    scene = glowing(tmp_path, monkeypatch)
    setup = load_setup(scene, ("glow",), grid=GRID, drive=drive)
    narrow = render_stack_once(setup, positions=9, samples=256, seed=1)
    wide = render_stack_once(setup, positions=9, samples=256, seed=2, window=(-3, 12))
    assert wide.shape[0] == 16
    assert wide[3:12].mean(axis=(1, 2)) == pytest.approx(narrow.mean(axis=(1, 2)), rel=5e-3)
    assert dispersion(wide[3:12]) == pytest.approx(dispersion(narrow), rel=0.1, abs=2e-4)


def test_scalar_refuses_positions_beyond_the_travel(tmp_path, monkeypatch):
    scene = glowing(tmp_path, monkeypatch)
    spec = StackSpec("made", "0", ("glow",), reference_drive("image_distance"), 8, 8, PITCH_M, 9, 1, 2, margin=(1, 1))
    error = refusal(render_missing, scene, [spec], root=tmp_path, backend_name="scalar")
    assert "axial colour" in str(error)
