"""Recipes whose lights have spectra, from the recipe to spikes and back, and what is refused in them."""

import json
import shutil

import numpy as np
import pytest
import yaml
from capture_dataset import RECIPE, make_dataset
from refusals import assert_says, refusal
from small_dataset import SCENES, SMALL_RECIPE
from written_scenes import needs_llvm

import saf_gen
from saf_gen.benchmark.view.captured import CapturedReadouts
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import recipe_fingerprint, resolve_recipe
from saf_gen.stack.capture import Capture

needs_plane = pytest.mark.usefixtures("test_scenes")
CROSSING = "[{kind: ramp, from: 1, to: 0, spectrum: tungsten}, {kind: ramp, from: 0, to: 1, spectrum: led}]"
LIGHTS = f"""\
lights:
  mono: {{kind: constant}}
  led: {{kind: constant, spectrum: led}}
  change: {CROSSING}
"""


def coloured(text=SMALL_RECIPE, *, lights=LIGHTS, use="mono, led, change", focus="axial_colour: {achromat: 1000}"):
    head, _, rest = text.partition("lights:\n")
    splits = rest[rest.index("splits:") :]
    for listed in ("constant, continuous, lamp_only", "constant, lamp_only"):
        splits = splits.replace(f"lights: [{listed}]", f"lights: [{use}]")
    return head.replace("positions: 9", f"positions: 17, {focus}") + lights + splits


def write(folder, text):
    path = folder / "lamps.yaml"
    path.write_text(text)
    return path


@pytest.mark.slow
@needs_llvm
def test_lamps_of_three_kinds_share_one_stack_and_have_their_own_truth(tmp_path, monkeypatch):
    """The plane at rest and moving, under one wavelength, an LED, and tungsten that changes to LED.

    A recording captured again from the file alone has the same spikes, so the file says all about its lamps.
    """
    text = RECIPE.replace("samples: 16", "samples: 4").replace("frames: 800", "frames: 400")
    folder = make_dataset(tmp_path, monkeypatch, coloured(text))
    assert len(list((folder / "stacks").glob("plane-*"))) < 30  # one at rest, the others are slices
    truths = {}
    for path in sorted(folder.glob("test/*.h5")):
        with saf_gen.open_stream(path) as stream:
            truths[path.stem] = stream.truth
            capture = Capture.from_stream(stream, folder / "stacks")
            whole = (slice(0, stream.shape[1]), slice(0, stream.shape[2]))
            frames = CapturedReadouts(capture, capture.open_light(), region=whole)
            frames.encode_until(400, np.asarray(stream.focus_position, np.float64))
            assert np.array_equal(frames.window(0, 400), stream.counts(0, 400))
            names, gain = stream.light_names, stream.gain
            if "change" in path.stem:
                assert names == ("lamp 1 (tungsten)", "lamp 2 (led)", "room 1 (tungsten)", "room 2 (led)")
                assert gain[:, 0] + gain[:, 1] == pytest.approx(1, abs=1e-5)
            else:
                assert names == ("lamp", "room")
    still = {name.split("-")[1]: truth for name, truth in truths.items() if "dynamic" not in name}
    assert (still["mono"].least_blur, still["mono"].in_focus, still["mono"].least_blur_in_focus) == (None,) * 3
    assert still["led"].in_focus[0] < still["led"].position < still["led"].in_focus[1]
    assert still["led"].least_blur_in_focus[0] < still["led"].least_blur < still["led"].least_blur_in_focus[1]
    assert still["change"].track[-1] == pytest.approx(still["led"].position, abs=0.01)
    assert abs(still["change"].track[0] - still["led"].position) > 0.05
    moving = {name.split("-")[2]: truth for name, truth in truths.items() if "dynamic" in name}
    extra = moving["change"].track - moving["led"].track
    assert extra[-1] == pytest.approx(0, abs=0.01)
    assert extra[0] == pytest.approx(still["change"].track[0] - still["led"].position, abs=0.02)


@needs_plane
def test_a_recipe_without_spectra_keeps_its_text_and_its_stacks(tmp_path):
    path = write(tmp_path, SMALL_RECIPE)
    recipe = read_recipe(path)
    dumped = recipe.model_dump(mode="json")
    assert "filter" not in dumped["camera"]
    assert "axial_colour" not in dumped["focus"]
    plain = resolve_recipe(path)
    with_lens = resolve_recipe(write(tmp_path, SMALL_RECIPE.replace("positions: 9", COLOURED_LENS)))
    assert recipe_fingerprint(plain.recipe) != recipe_fingerprint(with_lens.recipe)
    for a, b in zip(plain.sequences, with_lens.sequences, strict=True):
        assert a.time_stack == b.time_stack
        assert a.planned == b.planned
        assert "axial_colour" not in a.planned.as_dict()
        assert a.time_stack.specs[0].margin == (0, 0)


COLOURED_LENS = "positions: 9, axial_colour: {achromat: 2000}"


@needs_plane
def test_lamp_sensor_and_filter_leave_the_stack_as_it_is(tmp_path):
    """Its key hangs on the lens's colour alone, and only through the positions beyond the travel."""
    one = resolve_recipe(write(tmp_path, coloured()))
    texts = [
        coloured().replace("led}", "{blackbody: 3000}}"),
        coloured().replace("exposure:", "filter: ir_cut, exposure:"),
        coloured(lights="lights:\n  mono: {kind: constant, spectrum: sodium}\n", use="mono"),
    ]
    keys = {spec.key for s in one.sequences for spec in s.time_stack.specs}
    assert len(keys) == 1
    for text in texts:
        other = resolve_recipe(write(tmp_path, text))
        assert {spec.key for s in other.sequences for spec in s.time_stack.specs} == keys
        assert {s.fingerprint("") for s in other.sequences}.isdisjoint(
            {s.fingerprint("") for s in one.sequences if s.planned.light != "mono"}
        )


@needs_plane
def test_a_range_of_lamps_is_drawn_for_each_sequence(tmp_path):
    lights = "lights:\n  any: {kind: constant, spectrum: {choice: [led, tungsten, {blackbody: 3200}]}}\n"
    text = coloured(lights=lights, use="any").replace("lights: [any]}", "lights: [any], repeats: 12}")
    found = {json.dumps(s.planned.schedule[""]["spectrum"]) for s in resolve_recipe(write(tmp_path, text)).sequences}
    assert found == {'"led"', '"tungsten"', '{"blackbody": 3200}'}


@needs_plane
def test_a_table_of_a_lamp_is_part_of_the_recipe(tmp_path):
    (tmp_path / "lamp.csv").write_text("wavelength_nm,power\n450,1\n650,2\n")
    text = coloured(lights="lights:\n  mine: {kind: constant, spectrum: {file: lamp.csv}}\n", use="mine")
    (sequence,) = resolve_recipe(write(tmp_path, text)).sequences
    assert sequence.planned.schedule[""]["spectrum"]["file"]["text"].endswith("650,2\n")
    assert "wavelength_nm" in yaml.safe_dump(read_recipe(tmp_path / "lamps.yaml").model_dump(mode="json"))


def light(text):
    return {"lights": f"lights:\n  one: {text}\n", "use": "one"}


@needs_plane
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (light("{kind: constant, spectrum: LED}"), "did you mean 'led'"),
        (light("{kind: constant, spectrum: {blackbody: 100}}"), "1,000 to 20,000 kelvins"),
        (light("{kind: constant, spectrum: {file: none.csv}}"), "'none.csv' does not exist"),
        (light("{kind: constant, spectrum: {file: ../lamp.csv}}"), "outside the folder"),
        (light("{kind: constant, spektrum: led}"), "did you mean 'spectrum'"),
        (light("{kind: constant, spectrum: daylight}"), "did you mean '{daylight: KELVINS}'"),
        (light("{kind: constant, spectrum: {from: tungsten, to: led}}"), "led, tungsten"),
        (light("[]"), "a list of schedules is []"),
        (light("[{kind: constant}, led]"), "a list of schedules is"),
        (light("[[{kind: constant}]]"), "a list of schedules is"),
        (light("constant"), "{kind: constant}"),
        (light("{lamp: []}"), "a list of schedules is []"),
        (light("{lamp: [{spectrum: led}]}"), "a list of schedules is"),
        (light("[{kind: constnat}]"), "did you mean 'constant'"),
        (light("[{kind: constant, spectrum: leds}]"), "did you mean 'led'"),
        ({"focus": "axial_colour: {achromat: 10}"}, "achromat"),
        ({"focus": "axial_colour: {singlet: bk7}"}, "did you mean 'n-bk7'"),
        ({"focus": "axial_colour: achromat"}, "axial_colour"),
        ({"focus": "axial_colour: {singlet: n-sf11}"}, "travels beyond the ends"),
    ],
)
def test_what_is_wrong_in_lamps_and_lenses_is_said_in_one_line(tmp_path, options, said):
    error = refusal(resolve_recipe, write(tmp_path, coloured(**options)))
    assert said in str(error)
    assert "lamps.yaml" in str(error)


@needs_plane
def test_a_filter_without_any_spectrum_is_refused(tmp_path):
    text = SMALL_RECIPE.replace("exposure:", "filter: ir_cut, exposure:")
    assert "no light has a spectrum" in str(refusal(resolve_recipe, write(tmp_path, text)))
    assert "ir_cut" in str(refusal(resolve_recipe, write(tmp_path, text.replace("ir_cut", "ir-cut"))))


def test_what_is_drawn_at_one_wavelength_refuses_spectra(tmp_path):
    text = coloured(SMALL_RECIPE.replace("[plane]", "[cheek_cells]")).replace("drive: image_distance, ", "")
    said = "lamps.yaml: scene 'cheek_cells' is a thin section, and is drawn at one wavelength"
    assert said in str(refusal(resolve_recipe, write(tmp_path, text)))
    assert said in str(refusal(resolve_recipe, write(tmp_path, text.replace(", axial_colour: {achromat: 1000}", ""))))


LENS = "{{file: {}, f_number: {}, focus_range_m: [0.60, 0.42]}}"


def plane_behind(folder, monkeypatch, lens="c_mount", f_number=2.0):
    """The chequered plane behind a lens read from a file."""
    shutil.copytree(SCENES / "plane", folder / "scenes" / "plane")
    card = folder / "scenes" / "plane" / "scene.yaml"
    lines = card.read_text().splitlines()
    card.write_text(
        "\n".join(f"lens: {LENS.format(lens, f_number)}" if "lens:" in one else one for one in lines) + "\n"
    )
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder / "scenes"))


FILTERED = SMALL_RECIPE.replace("exposure:", "filter: ir_cut, exposure:")


def test_a_lens_file_brings_its_colour(tmp_path, monkeypatch):
    plane_behind(tmp_path, monkeypatch)
    path = write(tmp_path, coloured(FILTERED, focus="motion: {kind: sweep}"))
    found = resolve_recipe(path)
    by_light = {s.planned.light: s.planned.axial_colour for s in found.sequences}
    assert by_light["mono"] is None
    assert by_light["led"] == by_light["change"]
    assert by_light["led"]["reference_nm"] == 587.5618
    assert found.sequences[0].time_stack.specs[0].margin > (0, 0)
    plain = resolve_recipe(write(tmp_path, SMALL_RECIPE))
    assert {spec.margin for s in plain.sequences for spec in s.time_stack.specs} == {(0, 0)}


REAL = {
    "a colour beside that of the file": (FILTERED, "axial_colour: {achromat: 1000}", {}, "brings its own"),
    "light beyond the fit": (SMALL_RECIPE, "motion: {kind: sweep}", {}, "filter: ir_cut | C-mount | 400 to 700 nm"),
    "a colour that is stated for no lamp": (SMALL_RECIPE, "axial_colour: {achromat: 1000}", {}, "brings its own"),
}


@pytest.mark.parametrize("what", REAL)
def test_colour_that_a_lens_file_cannot_show_is_refused_in_one_line(tmp_path, monkeypatch, what):
    plane_behind(tmp_path, monkeypatch)
    text, focus, light, said = REAL[what]
    assert_says(refusal(resolve_recipe, write(tmp_path, coloured(text, focus=focus, **light))), f"lamps.yaml | {said}")
