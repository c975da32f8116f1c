"""Scenes whose stack is given: how they are made, what is recorded from them, their truth, and what is refused."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image
from refusals import assert_says, refusal
from scipy.ndimage import gaussian_filter
from small_dataset import HERE, SCENES

import saf_gen
from saf_gen.authoring.template import scene_from_pictures
from saf_gen.generate.plan import make_plan
from saf_gen.generate.resolve import coarse_sampling, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.scene.scene_folder import find_any_scene, find_scene

PICTURES, PEAK, STEP_UM = 9, 3.4, 0.5
RECIPE = """\
name: real
seed: 3
camera: {sensor: SENSOR, frames: 320, exposure: {mean_rate: 0.2}}
focus: {positions: 5}
render: {samples: 16}
lights:
  constant: {kind: constant}
splits:
  test: {scenes: [dots], lights: [constant]}
"""
STATED = {"linear": True, "licence": "CC0-1.0", "step_um": STEP_UM, "box": (32, 20, 64, 40)}


def texture(peak=PEAK):
    """Return pictures (focus, 80, 128) from 0 to 1 whose Gaussian blur grows with the square of the distance to a peak.

    The variance of the blur is a parabola, so a curve that falls with it is symmetric about the peak.
    """
    flat = gaussian_filter(np.random.default_rng(7).random((80, 128)), 1.5)
    flat = (flat - flat.min()) / np.ptp(flat)
    return np.stack([gaussian_filter(flat, np.hypot(0.5, 0.4 * (k - peak))) for k in range(PICTURES)])


def save(folder, pictures, dtype=np.uint16, white=50_000):
    """Write pictures of values 0 to 1 as TIFF files."""
    folder.mkdir(exist_ok=True)
    for k, picture in enumerate(pictures):
        Image.fromarray((picture * white).astype(dtype)).save(folder / f"z_{k}.tif")
    return folder


@pytest.fixture
def scenes(tmp_path, monkeypatch):
    """A folder in which scenes are found; returns a function that makes one of pictures."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))

    def make(pictures, name="dots", **changes):
        shutil.rmtree(tmp_path / "scenes" / name, ignore_errors=True)
        return scene_from_pictures(pictures, name, root=tmp_path / "scenes", **{**STATED, **changes})

    return make


@pytest.fixture
def made(tmp_path, scenes):
    """A scene of 16-bit pictures of known focus; returns a function that writes a recipe of it with changes."""
    scenes(save(tmp_path / "pictures", texture()))

    def write(*changes):
        text = RECIPE.replace("SENSOR", str(HERE / "small_sensor.yaml"))
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "real.yaml"
        path.write_text(text)
        return path

    return write


@pytest.mark.slow
def test_the_scene_states_what_was_said_and_holds_the_light(made, tmp_path, scenes):
    card, folder = scenes(tmp_path / "pictures")
    scene = find_any_scene("dots")
    assert (scene.folder / "scene.yaml", scene.folder / "pictures") == (card, folder)
    assert (scene.card.title, scene.card.source, scene.card.licence) == ("dots", "pictures pictures", "CC0-1.0")
    assert (scene.card.pictures.step_um, scene.card.pictures.box) == (STEP_UM, (32, 20, 64, 40))
    light = np.stack([*scene.read_pictures()])
    assert light / light.mean() == pytest.approx(texture() / texture().mean(), abs=1e-3)
    assert_says(refusal(find_scene, "dots"), "scene 'dots' was photographed | scenes that are rendered")


@pytest.mark.slow
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


def test_the_digest_follows_the_pictures_and_nothing_is_taken_in_after_they_changed(made, tmp_path, scenes):
    resolved = resolve_recipe(made())
    key = resolved.sequences[0].time_stack.specs[0].key
    card = tmp_path / "scenes/dots/scene.yaml"
    card.write_text(card.read_text().replace('title: "dots"', "title: Black dots"))
    assert resolve_recipe(made()).sequences[0].time_stack.specs[0].key == key
    save(tmp_path / "pictures", texture(4))
    scenes(tmp_path / "pictures")
    assert resolve_recipe(made()).sequences[0].time_stack.specs[0].key != key
    found = generate(resolved, tmp_path / "out")
    assert found.exit_code == 2
    assert_says(next(iter(found.failed.values())), "the pictures have changed | run saf-gen generate again")


def test_the_light_of_a_stack_is_its_key(made):
    light = "{key: {kind: flicker, depth: 0.3}, ambient: {kind: constant}}"
    resolved = resolve_recipe(made(("constant: {kind: constant}", f"constant: {light}")))
    assert set(resolved.sequences[0].planned.schedule) == {"light"}
    assert "dots has no light with the role ambient" in coarse_sampling(resolved)[-1]


@pytest.mark.slow
def test_a_recipe_of_given_stacks_needs_no_renderer(made, tmp_path):
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


def test_what_is_known_of_the_steps_is_said_in_a_line(made, tmp_path, scenes):
    scenes(tmp_path / "pictures", step_um=None)
    (line,) = coarse_sampling(resolve_recipe(made()))
    assert "9 pictures, whose steps are not known; no depth of focus; in picture sd 3." in line


@pytest.mark.slow
def test_a_recipe_may_have_rendered_scenes_beside_them(made, tmp_path, monkeypatch):
    """Each has its own positions and truth; the card of the dataset says both, and shards share both out."""
    monkeypatch.setenv("SAF_GEN_SCENES", os.pathsep.join([str(tmp_path / "scenes"), str(SCENES)]))
    path = made(("scenes: [dots]", "scenes: [dots, plane]"))
    found = generate(resolve_recipe(path), tmp_path / "out", variant="scalar")
    assert (found.failed, len(found.recorded)) == ({}, 2)
    truths = {}
    for entry in found.manifest.sequences:
        with saf_gen.open_stream(tmp_path / "out" / entry.file) as stream:
            truths[entry.scene] = stream.truth
    assert truths["dots"].sharpness.shape == (PICTURES,)
    assert truths["plane"].sharpness.shape == (5,)
    assert np.isfinite(truths["plane"].depth_of_focus).all()
    assert not np.isfinite(truths["dots"].depth_of_focus).any()
    page = (tmp_path / "out" / "README.md").read_text()
    assert "photographed" in page
    assert "Mitsuba" in page
    parts = [make_plan(resolve_recipe(path, part=(n, 2)), tmp_path / "new") for n in (1, 2)]
    assert sorted(plan.renders for plan in parts) == [False, True]


def test_shards_share_stacks_and_their_cost_is_known(made, tmp_path, scenes):
    scenes(tmp_path / "pictures", "again")
    path = made(("scenes: [dots]", "scenes: [dots, again]"))
    parts = [make_plan(resolve_recipe(path, part=(n, 2)), tmp_path / "out") for n in (1, 2)]
    assert sorted(label for plan in parts for label in plan.labels) == ["again", "dots"]
    assert all(plan.estimate().render_s > 0 and not plan.renders for plan in parts)


WRONG = {
    "a lens": ([("positions: 5", "positions: 5, drive: stage")], "focus.drive is given | 'dots' was photographed"),
    "aberrations": ([("positions: 5", "positions: 5, aberrations: none")], "focus.aberrations is given"),
    "samples": (
        [("samples: 16", "samples: 16, per_scene: {dots: {samples: 4}}")],
        "given pictures are without samples | leave dots out",
    ),
    "absolute": ([("mean_rate: 0.2", "absolute: true")], "camera.exposure.absolute is given | with a mean_rate"),
    "per depth": ([("mean_rate: 0.2", "spikes_per_depth: 9")], "camera.exposure.spikes_per_depth is given"),
    "f_number": ([("mean_rate: 0.2", "mean_rate: 0.2, f_number: 2")], "camera.exposure.f_number is given"),
    "spectrum": (
        [("{kind: constant}", "{kind: constant, spectrum: led}")],
        "light 'constant' on dots: | has a spectrum",
    ),
    "lux": ([("{kind: constant}", "{kind: constant, unit: lux, gain: 5}")], "lux"),
    "moving": ([("lights: [constant]", "lights: [constant], scene_motion: [dynamic]")], "nothing moves in dots"),
    "a parameter": ([("lights:\n", "scene_params: {dots: {tilt: 1}}\nlights:\n")], "tilt"),
    "all in focus": ([("lights:\n", "truth: {sharp: true}\nlights:\n")], "truth.sharp: | was photographed"),
    "no scene": ([("scenes: [dots]", "scenes: [dot]")], "dot | dots"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_given_pictures_do_not_have_is_refused_in_a_line(made, case):
    changes, said = WRONG[case]
    assert_says(refusal(resolve_recipe, made(*changes)), f"real.yaml | {said}")


def test_a_sensor_larger_than_the_pictures_is_refused(made):
    path = made()
    path.write_text(path.read_text().replace(str(HERE / "small_sensor.yaml"), "vidar_400x250"))
    assert_says(refusal(resolve_recipe, path), "128 × 80 pixels | 400 × 250")


STATEMENTS = {
    "no_such_curve": ({"linear": False, "transfer": "gamma"}, "unknown transfer 'gamma' | bt709, srgb"),
    "no_curve": ({"linear": False}, "does not say how its values stand for light | --transfer srgb"),
    "step_of_0": ({"step_um": 0.0}, "step_um"),
    "a_name_with_a_space": ({"name": "my dots"}, "cannot be called 'my dots' | my_dots"),
    "a_shipped_name": ({"name": "camel"}, "'camel' already exists"),
}


@pytest.mark.parametrize("case", STATEMENTS)
def test_what_is_wrong_about_pictures_is_told_in_a_line_and_nothing_is_left(scenes, tmp_path, case):
    changes, said = STATEMENTS[case]
    save(tmp_path / "pictures", texture())
    assert_says(refusal(scenes, tmp_path / "pictures", **changes), said)
    assert not (tmp_path / "scenes").exists()


@pytest.mark.parametrize(
    ("box", "said"),
    [
        ((100, 20, 64, 40), "box is [100, 20, 64, 40] | columns 0 to 128"),
        ((32, 20, 8, 40), "box is | at least 16 × 16"),
    ],
)
def test_a_box_off_the_sensor_is_refused(made, tmp_path, scenes, box, said):
    scenes(tmp_path / "pictures", box=box)
    assert_says(refusal(resolve_recipe, made()), said)


def test_pictures_that_were_changed_by_hand_are_refused(made, tmp_path):
    folder = tmp_path / "scenes/dots/pictures"
    for bad, said in (
        (np.zeros((80, 128)), "is float64 (80, 128) | float32 (80, 128)"),
        (np.zeros((80, 127), np.float32), "float32 (80, 127) | float32 (80, 128)"),
        (np.full((80, 128), np.nan, np.float32), "negative or not finite"),
        (np.array([{}], object), "cannot be read"),
    ):
        np.save(folder / "0004.npy", bad, allow_pickle=True)
        assert_says(refusal(resolve_recipe, made()), f"0004.npy | {said}")
    (folder / "0004.npy").unlink()
    os.mkfifo(folder / "0004.npy")
    assert_says(refusal(resolve_recipe, made()), "0004.npy is not a file on a disk")


@pytest.mark.parametrize(
    ("peak", "said"),
    [
        (-2, "is largest in the first picture"),
        (PICTURES + 1, "is largest in the last picture"),
        (None, "in all pictures"),
    ],
)
def test_a_focus_that_is_not_between_the_pictures_is_no_truth(made, tmp_path, scenes, peak, said):
    scenes(save(tmp_path / "other", np.full((PICTURES, 80, 128), 0.5) if peak is None else texture(peak)))
    assert_says(refusal(resolve_recipe, made()), said)


def test_pictures_that_are_few_black_or_of_several_sizes_are_refused(made, tmp_path, scenes):
    folder, path = tmp_path / "pictures", made()
    Image.fromarray(np.zeros((80, 128), np.uint16)).save(folder / "z_2.tif")
    scenes(folder)
    assert_says(refusal(resolve_recipe, path), "a picture is black")
    Image.fromarray(np.ones((60, 128), np.uint16)).save(folder / "z_2.tif")
    assert_says(refusal(scenes, folder), "(60, 128) | (80, 128)")
    for k in range(2, PICTURES):
        (folder / f"z_{k}.tif").unlink()
    assert_says(refusal(scenes, folder), "has 2 pictures | at least 3")


def srgb(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def save_pages(path):
    pages = [Image.fromarray((picture * 50_000).astype(np.uint16)) for picture in texture()]
    pages[0].save(path, save_all=True, append_images=pages[1:])


def save_ome(path):
    tifffile.imwrite(path, (texture() * 50_000).astype(np.uint16), ome=True, metadata={"axes": "ZYX"})


def write_png(folder):
    (folder / "png").mkdir()
    for k, picture in enumerate(texture()):
        Image.fromarray(np.rint(255 * srgb(picture)).astype(np.uint8)).save(folder / "png" / f"scan{k + 8}.png")


def write_exr(folder):
    (folder / "exr").mkdir()
    for k, picture in enumerate(texture()):
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"Y": picture.astype(np.float32)}).write(str(folder / "exr" / f"z{k}.exr"))


KINDS = {
    "png": (write_png, "png", {"linear": False, "transfer": "srgb"}),
    "exr": (write_exr, "exr", {"linear": False}),
    "ome": (lambda folder: save_ome(folder / "s.tif"), "s.tif", {}),
    "pages": (lambda folder: save_pages(folder / "s.tif"), "s.tif", {}),
    "array_of_floats": (lambda folder: np.save(folder / "s.npy", 40 * texture()), "s.npy", {}),
    "array_of_bytes": (
        lambda folder: np.save(folder / "s.npy", np.rint(255 * texture()).astype(np.uint8)),
        "s.npy", {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_pictures_have_the_same_light_in_every_kind_of_file(made, tmp_path, scenes, kind):
    write, name, stated = KINDS[kind]
    write(tmp_path)
    scenes(tmp_path / name, "other", **stated)
    own, found = (np.stack([*find_any_scene(scene).read_pictures()]) for scene in ("dots", "other"))
    np.testing.assert_allclose(found / found.mean(), own / own.mean(), atol=0.02)


def test_exr_files_are_not_decoded_as_srgb(scenes, tmp_path):
    write_exr(tmp_path)
    assert_says(
        refusal(scenes, tmp_path / "exr", linear=False, transfer="srgb"), "--transfer srgb is given for linear light"
    )
