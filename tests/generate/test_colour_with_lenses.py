"""Lamps of different colour through lenses that vignette, distort, veil, or are moved by real drives.

Recordings without noise are compared with an own sum over the wavelengths of the rendered stack.
"""

import shutil

import numpy as np
import pytest
import yaml
from refusals import assert_says, refusal
from small_dataset import SCENES, SMALL_RECIPE
from written_scenes import needs_llvm

import saf_gen
from saf_gen.camera import charge_of_images
from saf_gen.core.spectrum import NM, power_per_light
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack

QUIET = dict.fromkeys(("shot", "dark", "response", "threshold_spread", "threshold_noise", "dust", "dead"), False)
THIN = {"focal_length_mm": 25, "f_number": 2.0, "drive": "image_distance", "focus_range_m": [0.60, 0.42]}
FILE = {"file": "c_mount", "f_number": 2.0, "focus_range_m": [0.60, 0.42]}
COLOUR = {"axial_colour": {"achromat": 1000}}
RING, PULL = {"radius_mm": 7.0, "distance_mm": 30.0}, {"distortion": -6, "height_mm": 2.0}
PAIRS = {
    "vignetting, glare and an actuator": (
        {**THIN, "vignetting": RING, "veiling_glare": 0.2},
        {**COLOUR, "actuator": "piezo"},
    ),
    "aberrations, distortion, glare and an actuator": (
        {**THIN, "aberrations": {**PULL, "spherical": 2}, "veiling_glare": 0.2},
        {**COLOUR, "actuator": "piezo"},
    ),
    "vignetting": ({**THIN, "vignetting": RING}, COLOUR),
    "distortion": ({**THIN, "aberrations": PULL}, COLOUR),
    "glare": ({**THIN, "veiling_glare": 0.2}, COLOUR),
    "an actuator": (THIN, {**COLOUR, "actuator": "piezo"}),
    "a lens file with glare and an actuator": ({**FILE, "veiling_glare": 0.2}, {"actuator": "piezo"}),
    "a lens file": (FILE, {}),
}


def write(folder, monkeypatch, lens, focus):
    shutil.copytree(SCENES / "plane", folder / "scenes" / "plane")
    path = folder / "scenes" / "plane" / "scene.yaml"
    card = {**yaml.safe_load(path.read_text()), "lens": lens}
    path.write_text(yaml.safe_dump(card))
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder / "scenes"))
    recipe = yaml.safe_load(SMALL_RECIPE)
    recipe["focus"] = {"positions": 9, **focus}
    recipe["render"] |= {"samples": 8, "estimator": "plain"}
    recipe["camera"] |= {"exposure": {"mean_rate": 0.5}, "filter": "ir_cut", "noise": QUIET}
    recipe["lights"] = {"led": {"kind": "constant", "spectrum": "led"}}
    recipe["splits"] = {"test": {"scenes": ["plane"], "lights": ["led"]}}
    (folder / "small.yaml").write_text(yaml.safe_dump(recipe))
    return folder / "small.yaml"


def own_pictures(spec, sensor, colour, folder, *, mono):
    """Pictures under the LED at every position of the travel, by a sum over single wavelengths; up to a factor."""
    source = PlaneSource.from_folder(TimeResolvedStack((0,), (spec,)), folder)
    before, after = spec.margin
    planes = source.load_planes(0, 0, before + spec.positions + after).sum(axis=0).astype(np.float64)
    nm = np.arange(400, 701, 3.0)
    weights = np.interp(nm, NM, power_per_light("led") * sensor.spectral_response())
    table, change = np.array(colour["measured"]).T if "measured" in colour else (nm, None)
    reference = colour.get("reference_nm", sensor.wavelength_m * 1e9)
    drive, steps = spec.drive, spec.positions - 1
    if change is None:
        power = saf_gen.optics.AxialColour(**colour).relative_power(nm, reference_nm=reference)
    else:
        power = (1 + np.interp(reference, table, change)) / (1 + np.interp(nm, table, change)) - 1
    mixed = np.zeros((spec.positions, *planes.shape[1:]))
    for k in range(spec.positions):
        for share, delta in zip(weights / weights.sum(), power / drive.focal_length_m, strict=True):
            delta = 0.0 if mono else delta
            u = 1 / (1 / float(drive.object_distance(k / steps)) + delta)
            at = float(drive.best_position(u)) * steps + before
            low = min(max(int(at), 0), len(planes) - 2)
            mixed[k] += share * ((1 - at + low) * planes[low] + (at - low) * planes[low + 1])
    clear = {**drive.as_dict(), "veiling_glare": 0.0}
    clear = saf_gen.optics.drive_from_dict(clear)
    charge = charge_of_images(
        mixed[None].astype(np.float32), sensor, lens=clear, position=np.linspace(0, 1, spec.positions)
    )[0]
    veil = drive.veiling_glare
    return (1 - veil) * charge + veil * charge.mean(axis=(1, 2), keepdims=True)


SLOW = [pytest.param(pair, marks=pytest.mark.long) for pair in list(PAIRS)[2:]]


@pytest.mark.slow
@needs_llvm
@pytest.mark.parametrize("pair", [*list(PAIRS)[:2], *SLOW])
def test_spikes_are_those_of_an_own_sum_over_the_wavelengths(tmp_path, monkeypatch, pair):
    """Windows of 80 readouts, pixel by pixel: within 2 % rms of the own pictures where the lens was (the rounding of
    counts is 1 %), and farther from pictures of one wavelength. The truth is where the lens crosses its position.
    """
    lens, focus = PAIRS[pair]
    resolved = resolve_recipe(write(tmp_path, monkeypatch, lens, focus))
    assert generate(resolved, tmp_path / "out", variant="llvm").failed == {}
    (s,) = resolved.sequences
    spec = s.time_stack.specs[0]
    with saf_gen.open_stream(tmp_path / "out" / "test" / f"{s.planned.id}.h5") as stream:
        position, truth = np.float64(stream.metadata.lens_position), stream.truth
        counts = np.array([stream.counts(t, t + 80) for t in range(0, 400, 80)], np.float64)
    assert position[int(truth.frame)] == pytest.approx(truth.position, abs=5e-3)
    moved = truth.position - spec.in_focus.true_focus(np.full((1, 1), 0.5), np.ones((1, 1), bool))
    assert np.sign(moved) == (-1 if "file" in pair else 1)  # blue light beside 588 nm, all light beside green
    off, knot = {}, position * (spec.positions - 1)
    low = np.minimum(knot.astype(int), spec.positions - 2)
    for mono in (False, True):
        images = own_pictures(spec, s.sensor, s.planned.axial_colour, tmp_path / "out" / "stacks", mono=mono)
        every = images[low] + (knot - low)[:, None, None] * (images[low + 1] - images[low])
        expected = every.reshape(5, 80, *every.shape[1:]).sum(axis=1)
        off[mono] = np.sqrt(np.mean((counts * expected.mean() / counts.mean() - expected) ** 2)) / expected.mean()
    assert off[False] < 0.02
    assert off[False] < 0.7 * off[True]


REFUSED = {
    "vignetting and aberrations": (
        {**THIN, "vignetting": RING, "aberrations": {"spherical": 2}},
        COLOUR,
        "not built together",
    ),
    "a lens file with vignetting": ({**FILE, "vignetting": RING}, {}, "a real lens brings its own"),
    "a lens file with distortion": ({**FILE, "aberrations": PULL}, {}, "a real lens brings its own"),
    "a lens file with axial colour": ({**FILE, **COLOUR}, {}, "axial_colour"),
    "a lens file in a recipe of aberrations": (FILE, {"aberrations": "mild"}, "focus.aberrations | brings its own"),
    "a lens file in a recipe of axial colour": (FILE, COLOUR, "brings its own"),
    "a lens file of another drive": (FILE, {"drive": "focal_length"}, "image_distance"),
    "an actuator of unknown name": (FILE, {"actuator": "piezzo"}, "did you mean 'piezo'"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_not_drawn_together_is_refused_in_one_line(tmp_path, monkeypatch, what):
    lens, focus, said = REFUSED[what]
    assert_says(refusal(resolve_recipe, write(tmp_path, monkeypatch, lens, focus)), said)
