"""The all-in-focus picture: it is the recorded one where that is in focus, and blurs into it elsewhere."""

import shutil

import capture_dataset
import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy.ndimage import map_coordinates, spline_filter

import saf_gen
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.render.all_in_focus import render_all_in_focus
from saf_gen.stack.all_in_focus import AllInFocus, load_all_in_focus
from saf_gen.stack.capture import Capture
from saf_gen.stack.focal_stack import StackStore

pytestmark = pytest.mark.slow

RECIPE = (
    capture_dataset.RECIPE.replace("samples: 16,", "samples: 256,")
    .replace("[static, dynamic]", "[static]")
    .replace("mean_rate: 0.2", "mean_rate: 0.2, f_number: 1.0")
)
NOISE = 0.02
"""Relative noise of a picture with this number of samples, and what a residual blur of half a pixel leaves."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        folder = capture_dataset.make_dataset(tmp_path_factory.mktemp("still"), patch, RECIPE)
        yield folder


@pytest.fixture(scope="module")
def stream(dataset):
    with saf_gen.open_stream(dataset / "test/plane-lamp_only-00.h5") as opened:
        yield opened


@pytest.fixture(scope="module")
def sharp(dataset, stream):
    return render_all_in_focus(stream, dataset / "stacks", variant=capture_dataset.VARIANT)


def planes(stream, dataset, *positions):
    source = Capture.from_stream(stream, dataset / "stacks").open_charge_source()
    return np.stack([source.charge_image(0, position) for position in positions])


def test_in_focus_it_is_the_recorded_picture_of_each_light(dataset, stream, sharp):
    truth = stream.truth
    (focused,) = planes(stream, dataset, truth.position)
    assert (sharp.shape, sharp.dtype) == (focused.shape, np.float32)
    blur = stream.blur(round(truth.frame))
    assert np.abs(blur).max() < 0.5
    for group in range(len(stream.light_names)):
        off = (sharp[group] - focused[group]) / focused[group].mean()
        assert np.sqrt(np.mean(off**2)) < 3 * NOISE


def test_its_light_is_that_of_the_aperture_of_the_recording(dataset, stream, sharp):
    (focused,) = planes(stream, dataset, stream.truth.position)
    assert sharp.mean(axis=(1, 2)) == pytest.approx(focused.mean(axis=(1, 2)), rel=0.005)


def disc(points=300):
    """Points spread evenly over a disc of diameter 1, on a sunflower's spiral: (2, points)."""
    n = np.arange(points) + 0.5
    angle = np.pi * (1 + np.sqrt(5)) * n
    return np.sqrt(n / points) / 2 * np.stack([np.cos(angle), np.sin(angle)])


def test_blurred_by_the_closed_form_it_is_the_picture_out_of_focus(dataset, stream, sharp):
    """The blur of the renderer is that of stream.blur, at both ends of the travel, within the steps of the search."""
    drive = AllInFocus.of_stream(stream, dataset / "stacks").spec.drive
    picture = spline_filter(sharp.sum(axis=0))
    centre = (np.array(picture.shape) - 1)[:, None, None] / 2
    inner = slice(8, -8), slice(8, -8)
    for frame in (0, stream.shape[0] - 1):
        position = float(stream.focus_position[frame])
        (seen,) = planes(stream, dataset, position).sum(axis=1)
        breathing = float(drive.image_distance(position) / drive.image_distance(stream.truth.position))
        width, trials = float(np.abs(np.median(stream.blur(frame)))), np.linspace(0.7, 1.3, 13)
        assert width > 3
        errors = []
        for trial in trials:
            at = [
                (np.indices(picture.shape) + trial * width * point[:, None, None] - centre) / breathing + centre
                for point in disc().T
            ]
            found = np.mean([map_coordinates(picture, one, prefilter=False)[inner] for one in at], axis=0)
            errors.append(np.mean((found / found.mean() - seen[inner] / seen[inner].mean()) ** 2))
        assert trials[int(np.argmin(errors))] == pytest.approx(1, abs=0.051)


def test_it_is_rendered_once_and_read_without_a_renderer(dataset, stream, sharp, monkeypatch):
    spec = AllInFocus.of_stream(stream, dataset / "stacks").spec
    store = StackStore(dataset / "stacks", spec)
    before = {path.name: path.stat().st_mtime_ns for path in store.folder.iterdir()}
    assert np.array_equal(load_all_in_focus(stream, dataset / "stacks"), sharp)
    with saf_gen.open_stream(dataset / "test/plane-constant-00.h5") as other:
        render_all_in_focus(other, dataset / "stacks", variant=capture_dataset.VARIANT)
    assert {path.name: path.stat().st_mtime_ns for path in store.folder.iterdir()} == before


def test_a_dataset_with_the_picture_is_still_the_same(dataset, stream, sharp):
    outcome = generate(resolve_recipe(dataset.parent / "takes.yaml"), dataset, variant=capture_dataset.VARIANT)
    assert outcome.failed == {}
    with saf_gen.open_stream(dataset / "test/plane-lamp_only-00.h5") as again:
        assert again.content_sha256 == stream.content_sha256
    assert AllInFocus.of_stream(stream, dataset / "stacks").load().shape == sharp.shape


def test_what_is_missing_damaged_or_changed_is_refused_in_one_line(dataset, stream, sharp, tmp_path, monkeypatch):
    stacks = tmp_path / "stacks"
    shutil.copytree(dataset / "stacks", stacks)
    picture = AllInFocus.of_stream(stream, stacks)
    folder = StackStore(stacks, picture.spec).folder
    lamp = folder / "lamp.exr"
    lamp.write_bytes(lamp.read_bytes()[:-1])
    assert_says(refusal(load_all_in_focus, stream, stacks), "lacks lamp | render it")
    shutil.rmtree(folder)
    assert_says(refusal(load_all_in_focus, stream, stacks), "lacks geometry, lamp, room | render it")
    assert_says(refusal(load_all_in_focus, stream, tmp_path / "nowhere"), "there is no focal stack")
    card = dataset.parent / "scenes/plane/scene.py"
    text = card.read_text()
    card.write_text(text.replace("scale(60)", "scale(50)"))
    try:
        error = refusal(render_all_in_focus, stream, stacks, variant=capture_dataset.VARIANT)
    finally:
        card.write_text(text)
    assert_says(error, "scene 'plane' has changed")
    assert_says(refusal(render_all_in_focus, stream, stacks, variant="lvm"), "lvm | llvm")


def test_where_no_pinhole_can_be_it_is_refused_in_one_line(captured_dataset):
    with saf_gen.open_stream(captured_dataset / "test/plane-dynamic-constant-00.h5") as moving:
        assert_says(refusal(load_all_in_focus, moving, captured_dataset / "stacks"), "its scene moves | at rest")
    with saf_gen.open_stream(next(saf_gen.sample().rglob("*constant-00.h5"))) as elsewhere:
        error = refusal(load_all_in_focus, elsewhere, captured_dataset / "stacks")
    assert_says(error, "there is no focal stack")
