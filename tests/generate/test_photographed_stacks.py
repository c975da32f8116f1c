"""Recipes of stacks that were photographed: what is recorded from them, their truth, and what is refused."""

import json
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image
from refusals import assert_says, refusal
from scipy.ndimage import gaussian_filter, zoom
from small_dataset import HERE

import saf_gen
from saf_gen.camera import get_sensor
from saf_gen.generate.plan import make_plan
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import coarse_sampling, recipe_fingerprint, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.picture_stack import magnification

PICTURES, PEAK, STEP_UM = 9, 3.4, 0.5
RECIPE = """\
name: real
seed: 3
camera: {sensor: SENSOR, frames: 320, exposure: {mean_rate: 0.2}}
stacks:
  dots: {folder: pictures, values: linear, step_um: 0.5, box: [32, 20, 64, 40], licence: CC0-1.0}
lights:
  constant: {kind: constant}
splits:
  test: {scenes: [dots], lights: [constant]}
"""


def texture(peak=PEAK):
    """Return pictures (focus, 80, 128) from 0 to 1 whose Gaussian blur grows with the square of the distance to a peak.

    The variance of the blur is a parabola, so a curve that falls with it is symmetric about the peak.
    """
    flat = gaussian_filter(np.random.default_rng(7).random((80, 128)), 1.5)
    flat = (flat - flat.min()) / np.ptp(flat)
    return np.stack([gaussian_filter(flat, np.hypot(0.5, 0.4 * (k - peak))) for k in range(PICTURES)])


@pytest.fixture
def made(tmp_path):
    """A recipe beside 16-bit pictures of known focus; returns a function that writes it with changes."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k, picture in enumerate(texture()):
        Image.fromarray((picture * 50_000).astype(np.uint16)).save(folder / f"z_{k}.tif")

    def write(*changes):
        text = RECIPE.replace("SENSOR", str(HERE / "small_sensor.yaml"))
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "real.yaml"
        path.write_text(text)
        return path

    return write


def test_a_photographed_stack_is_recorded_with_its_focus(made, tmp_path):
    resolved = resolve_recipe(made())
    found = generate(resolved, tmp_path / "out")
    assert (found.exit_code, found.rendered, len(found.recorded)) == (0, ["dots · geometry", "dots · light"], 1)
    with saf_gen.open_stream(tmp_path / "out" / found.manifest.sequences[0].file) as stream:
        truth, provenance = stream.truth, stream.metadata.provenance
        counts = stream.counts(0, stream.shape[0])
        assert stream.metadata.image_distance is stream.metadata.object_distance is None
    facts, optima = json.loads(provenance["photographed"]), json.loads(provenance["optima"])
    assert truth.position * (PICTURES - 1) == pytest.approx(PEAK, abs=0.1)
    assert truth.in_focus[0] <= truth.position <= truth.in_focus[1]
    assert sum(optima.values()) == pytest.approx(0, abs=1e-5)
    assert truth.position + max(optima.values()) == pytest.approx(truth.in_focus[1], abs=1e-5)
    assert np.isnan(truth.depth_of_focus).all()
    assert truth.depth is None or np.isnan(truth.depth).all()
    assert (facts["pictures"], facts["step_um"]) == (PICTURES, STEP_UM)
    assert facts["peaks_apart_um"] == pytest.approx(facts["peaks_apart_pictures"] * STEP_UM, abs=1e-3)
    assert truth.target.sum() == 32 * 20  # the sensor's pixels are two wide
    halved = texture().reshape(PICTURES, 40, 2, 64, 2).mean(axis=(2, 4)).mean(axis=0)
    assert np.corrcoef(counts.ravel(), halved.ravel())[0, 1] > 0.9
    assert generate(resolved, tmp_path / "out").kept == found.recorded
    page = (tmp_path / "out" / "README.md").read_text()
    assert "photographed" in page
    assert "Mitsuba" not in page


def test_the_digest_follows_the_pictures_and_nothing_is_taken_in_after_they_changed(made, tmp_path):
    resolved = resolve_recipe(made())
    key = resolved.sequences[0].time_stack.specs[0].key
    Image.fromarray((texture(4)[4] * 50_000).astype(np.uint16)).save(tmp_path / "pictures" / "z_4.tif")
    assert resolve_recipe(made()).sequences[0].time_stack.specs[0].key != key
    found = generate(resolved, tmp_path / "out")
    assert found.exit_code == 2
    assert_says(next(iter(found.failed.values())), "the pictures have changed | run saf-gen generate again")


def test_the_light_of_a_stack_is_its_key(made):
    light = "{key: {kind: flicker, depth: 0.3}, ambient: {kind: constant}}"
    resolved = resolve_recipe(made(("constant: {kind: constant}", f"constant: {light}")))
    assert set(resolved.sequences[0].planned.schedule) == {"light"}
    assert "dots has no light with the role ambient" in coarse_sampling(resolved)[-1]


def test_a_recipe_of_stacks_needs_no_renderer(made, tmp_path):
    code = (
        "import sys; sys.modules['mitsuba'] = sys.modules['drjit'] = None\n"
        "from saf_gen.__main__ import main\n"
        f"sys.argv = ['saf-gen', 'generate', {str(made())!r}, '--out', {str(tmp_path / 'out')!r}, *sys.argv[1:]]\n"
        "main()"
    )
    for option, said in ((["--dry-run"], "dots"), ([], "1 sequence recorded")):
        ran = subprocess.run([sys.executable, "-c", code, *option], capture_output=True, text=True, check=True)
        assert said in ran.stdout
        assert "9 pictures, 0.5 µm apart" in ran.stderr


def test_steps_that_are_not_known_and_breathing_are_said_in_a_line_each(made, tmp_path):
    for k, picture in enumerate(texture()):
        larger = zoom(picture, 1 + 0.01 * k, order=1)
        top, left = ((have - size) // 2 for have, size in zip(larger.shape, picture.shape, strict=True))
        Image.fromarray((larger[top : top + 80, left : left + 128] * 250).astype(np.uint8)).save(
            tmp_path / "pictures" / f"z_{k}.tif"
        )
    steps, breathing = coarse_sampling(resolve_recipe(made((", step_um: 0.5", ""))))
    assert "9 pictures, whose steps are not known; no depth of focus" in steps
    assert "grow by" in breathing


@pytest.mark.parametrize("per_picture", [0.0, 0.004, -0.006])
def test_the_magnification_of_pictures_is_measured(per_picture):
    rows, columns = np.mgrid[:100, :160].astype(float)
    wave = [
        sum(
            np.cos(f * ((columns - 79.5) / m) + g * ((rows - 49.5) / m))
            for f, g in ((0.3, 0.1), (0.1, 0.4), (0.5, 0.2))
        )
        for m in (1 + per_picture * np.arange(6))
    ]
    blurred = np.stack([gaussian_filter(3.0 + w, 0.5 + abs(k - 2)) for k, w in enumerate(wave)])
    assert magnification(blurred) - 1 == pytest.approx(5 * per_picture, abs=0.003)


def test_the_fingerprint_covers_stacks_and_the_text_leaves_out_what_they_do_not_have(made):
    first = read_recipe(made())
    second = read_recipe(made(("step_um: 0.5", "step_um: 0.25")))
    assert recipe_fingerprint(first) != recipe_fingerprint(second)
    text = first.model_dump(mode="json")
    assert "render" not in text
    assert "positions" not in text["focus"]


def test_shards_share_stacks_and_their_cost_is_known(made, tmp_path):
    path = made(
        ("licence: CC0-1.0}", "licence: CC0-1.0}\n  again: {folder: pictures, values: linear, licence: MIT}"),
        ("scenes: [dots]", "scenes: [dots, again]"),
    )
    parts = [make_plan(resolve_recipe(path, part=(n, 2)), tmp_path / "out") for n in (1, 2)]
    assert sorted(label for plan in parts for label in plan.labels) == ["again", "dots"]
    assert all(plan.estimate().render_s > 0 and not plan.renders for plan in parts)


WRONG = {
    "misspelt": ([("stacks:", "stack:")], "unknown key 'stack' | stacks"),
    "values_not_stated": ([("values: linear, ", "")], "does not say how its values stand for light | values: linear"),
    "no_such_values": ([("values: linear", "values: gamma")], "stacks.dots.values | gamma | linear, srgb"),
    "unknown_key": ([("step_um: 0.5", "step_mm: 0.5")], "step_mm | step_um"),
    "no_licence": ([(", licence: CC0-1.0", "")], "stacks.dots.licence | missing"),
    "no_folder": ([("folder: pictures", "folder: pixels")], "pixels | no such file or folder"),
    "step_below_0": ([("step_um: 0.5", "step_um: -1")], "step_um is -1"),
    "box_off_the_pictures": (
        [("[32, 20, 64, 40]", "[100, 20, 64, 40]")],
        "box is [100, 20, 64, 40] | columns 0 to 128",
    ),
    "box_too_small": ([("[32, 20, 64, 40]", "[32, 20, 8, 40]")], "box is | at least 16 × 16"),
    "box_of_three": ([("[32, 20, 64, 40]", "[32, 20, 64]")], "stacks.dots.box"),
    "focus_positions": ([("lights:\n", "focus: {positions: 9}\nlights:\n")], "no positions in a recipe of stacks"),
    "focus_drive": ([("lights:\n", "focus: {drive: stage}\nlights:\n")], "no drive in a recipe of stacks"),
    "render": ([("lights:\n", "render: {samples: 4}\nlights:\n")], "no render in a recipe of stacks"),
    "absolute": ([("mean_rate: 0.2", "absolute: true")], "mean_rate"),
    "f_number": ([("mean_rate: 0.2", "mean_rate: 0.2, f_number: 2")], "mean_rate"),
    "spectrum": ([("{kind: constant}", "{kind: constant, spectrum: led}")], "light 'constant' has a spectrum"),
    "lux": ([("{kind: constant}", "{kind: constant, unit: lux, gain: 5}")], "lux"),
    "moving": ([("lights: [constant]", "lights: [constant], scene_motion: [dynamic]")], "nothing moves in dots"),
    "unknown_stack": ([("scenes: [dots]", "scenes: [dot]")], "dot | dots"),
    "shipped_scene": ([("scenes: [dots]", "scenes: [dots, camel]")], "stack 'camel' | dots"),
    "unused_stack": (
        [("lights:\n", "  more: {folder: pictures, values: linear, licence: MIT}\nlights:\n")],
        "stack 'more' is in no split",
    ),
    "name_of_a_stack": ([("  dots:", "  Dots:"), ("[dots]", "[Dots]")], "Dots | lower-case letters"),
    "sensor_larger": ([(str(HERE / "small_sensor.yaml"), "vidar_400x250")], "128 × 80 pixels | 400 × 250"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_in_a_recipe_of_stacks_is_told_in_a_line(made, case):
    changes, said = WRONG[case]
    if case == "sensor_larger":
        path = made()
        path.write_text(path.read_text().replace(*changes[0]))
    else:
        path = made(*changes)
    assert_says(refusal(resolve_recipe, path), said)


@pytest.mark.parametrize(
    ("peak", "said"),
    [
        (-2, "is largest in the first picture"),
        (PICTURES + 1, "is largest in the last picture"),
        (None, "in all pictures"),
    ],
)
def test_a_focus_that_is_not_between_the_pictures_is_no_truth(made, tmp_path, peak, said):
    for k in range(PICTURES):
        picture = np.full((80, 128), 0.5) if peak is None else texture(peak)[k]
        Image.fromarray((picture * 50_000).astype(np.uint16)).save(tmp_path / "pictures" / f"z_{k}.tif")
    assert_says(refusal(resolve_recipe, made()), said)


def test_pictures_that_are_few_black_or_of_several_sizes_are_refused(made, tmp_path):
    folder, path = tmp_path / "pictures", made()
    Image.fromarray(np.zeros((80, 128), np.uint16)).save(folder / "z_2.tif")
    assert_says(refusal(resolve_recipe, path), "a picture is black")
    Image.fromarray(np.ones((60, 128), np.uint16)).save(folder / "z_2.tif")
    assert_says(refusal(resolve_recipe, path), "(60, 128) | (80, 128)")
    for k in range(2, PICTURES):
        (folder / f"z_{k}.tif").unlink()
    assert_says(refusal(resolve_recipe, path), "has 2 pictures | at least 3")


def srgb(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def save_pages(path, description=""):
    pages = [Image.fromarray((picture * 50_000).astype(np.uint16)) for picture in texture()]
    pages[0].save(path, save_all=True, append_images=pages[1:], description=description)


def save_ome(path, z):
    plane = {"PositionZ": list(z), "PositionZUnit": ["µm"] * PICTURES}
    pages = (texture() * 50_000).astype(np.uint16)
    tifffile.imwrite(path, pages, ome=True, metadata={"axes": "ZYX", "Plane": plane})


def write_png(folder):
    (folder / "png").mkdir()
    for k, picture in enumerate(texture()):
        Image.fromarray(np.rint(255 * srgb(picture)).astype(np.uint8)).save(folder / "png" / f"scan{k + 8}.png")


def write_exr(folder):
    (folder / "exr").mkdir()
    for k, picture in enumerate(texture()):
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"Y": picture.astype(np.float32)}).write(str(folder / "exr" / f"z{k}.exr"))


IMAGEJ = "ImageJ=1.54f\nimages=9\nslices=9\nspacing=0.5\nunit=um\n"
KINDS = {
    "png": (write_png, "png, values: srgb", None),
    "exr": (write_exr, "exr", None),
    "imagej": (lambda folder: save_pages(folder / "s.tif", IMAGEJ), "s.tif, values: linear", 0.5),
    "ome_downwards": (lambda folder: save_ome(folder / "s.tif", 9 - np.arange(9) / 4), "s.tif, values: linear", 0.25),
    "pages": (lambda folder: save_pages(folder / "s.tif"), "s.tif, values: linear", None),
    "array_of_floats": (lambda folder: np.save(folder / "s.npy", 40 * texture()), "s.npy, values: linear", None),
    "array_of_bytes": (
        lambda folder: np.save(folder / "s.npy", np.rint(255 * texture()).astype(np.uint8)),
        "s.npy, values: linear", None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_pictures_have_the_same_focus_in_every_kind_of_file(made, tmp_path, kind):
    write, stated, step_um = KINDS[kind]
    write(tmp_path)
    own = resolve_recipe(made()).scenes["dots"]
    found = resolve_recipe(made(("pictures, values: linear, step_um: 0.5", stated))).scenes["dots"]
    assert (found.count, found.step_um) == (PICTURES, step_um)
    light = []
    for stack in (own, found):
        spec = stack.spec(get_sensor(HERE / "small_sensor.yaml"))
        stack.take_in(spec, tmp_path / "stacks")
        light.append(StackStore(tmp_path / "stacks", spec).load_planes(0, PICTURES))
    np.testing.assert_allclose(light[1] / light[1].mean(), light[0] / light[0].mean(), atol=0.02)


WRONG_FILES = {
    "step_contradicts": (
        lambda p: save_pages(p, IMAGEJ),
        "step_um: 0.7",
        "step_um of stack 'dots' is 0.7, and the file states 0.5",
    ),
    "steps_are_not_equal": (lambda p: save_ome(p, [0, 1, 2, 3, 4, 5, 6, 7, 9]), "", "1 to 2 µm apart | equal steps"),
    "the_focus_turns": (lambda p: save_ome(p, [0, 1, 2, 3, 4, 3, 2, 1, 0.5]), "", "µm apart | equal steps"),
}


@pytest.mark.parametrize("case", WRONG_FILES)
def test_a_file_that_contradicts_the_recipe_is_refused(made, tmp_path, case):
    save, stated, said = WRONG_FILES[case]
    save(tmp_path / "s.tif")
    path = made(("pictures, values: linear, step_um: 0.5", f"s.tif, values: linear{stated and ', ' + stated}"))
    assert_says(refusal(resolve_recipe, path), said)


def test_exr_files_are_not_decoded_as_srgb(made, tmp_path):
    write_exr(tmp_path)
    path = made(("pictures, values: linear, step_um: 0.5", "exr, values: srgb"))
    assert_says(refusal(resolve_recipe, path), "its tags say: linear light | leave values out")
