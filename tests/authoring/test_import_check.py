"""An imported scene is rendered beside its source, and a line says how far both are apart."""

import re

import numpy as np
import pytest
from PIL import Image

from saf_gen.authoring.import_check import compare_with_source
from saf_gen.authoring.template import scene_from_export
from saf_gen.scene.scene_folder import load_scene

SOURCE = """<scene version="3.0.0">
<sensor type="perspective"><float name="fov" value="18"/>
<transform name="to_world"><scale value="2"/><lookat origin="0.1, 0, 0.55" target="0, 0, 0" up="0, 1, 0"/></transform>
</sensor>
<shape type="rectangle" id="left"><transform name="to_world"><scale value="0.1"/><translate x="-0.1"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="{paper}"/></bsdf></shape>
<shape type="rectangle" id="right"><transform name="to_world"><scale value="0.1"/><translate x="0.1"/></transform>
<bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf></shape>
<emitter type="constant" id="sky"><rgb name="radiance" value="{lamp}"/></emitter>
</scene>"""


@pytest.fixture
def take(own_folder):
    def import_scene(paper="0.8", lamp="1", source=SOURCE, **how):
        (own_folder / "source.xml").write_text(source.format(paper=paper, lamp=lamp))
        lines = []
        scene_from_export(own_folder / "source.xml", "two", root=own_folder / "scenes", notify=lines.append, **how)
        return own_folder / "scenes/two", lines

    return import_scene


def largest(line):
    return float(line.split("by at most ")[1].split("%")[0]) / 100


@pytest.mark.slow
def test_a_scene_as_in_its_source_differs_by_noise_alone_and_the_picture_changes_no_digest(take):
    folder, _ = take()
    digest = load_scene(folder).digest
    line = compare_with_source(folder, variant="scalar")
    assert line.startswith("picture: apart from Mitsuba's of scene.xml by at most ")
    assert largest(line) < 0.05
    noise = [float(share) for share in re.findall(r"noise: ([\d.]+)%", line)]
    assert len(noise) == 2
    assert 0 < noise[1] <= noise[0] < 3
    assert load_scene(folder).digest == digest
    grey = np.asarray(Image.open(folder / "import.png"))
    assert grey.shape == (240, 3 * 384)
    assert grey[:, 768:].mean() < 50 < grey[:, :384].mean()


@pytest.mark.slow
@pytest.mark.parametrize("edit", [("look_at_m: [0, 0, 0]", "look_at_m: [0.02, 0, 0]"), ("exported", "of others")])
def test_a_camera_that_is_not_that_of_the_source_shows(take, edit):
    folder, _ = take()
    card = folder / "scene.yaml"
    text = card.read_text()
    assert edit[0] in text
    card.write_text(text.replace(*edit))
    assert (largest(compare_with_source(folder, variant="scalar")) > 0.2) == ("look_at_m" in edit[0])


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["", "Eye"])
def test_a_chosen_camera_is_compared_with_that_of_the_source(take, camera):
    second = SOURCE.replace(
        '<sensor type="perspective">', '<sensor type="perspective" id="Sky"/><sensor type="perspective" id="Eye">'
    )
    folder, _ = take(source=second, camera="Eye")
    line = compare_with_source(folder, camera=camera, variant="scalar")
    assert (largest(line) < 0.05) == (camera == "Eye")


@pytest.mark.parametrize(
    ("paper", "lamp", "line"),
    [
        (
            "0, 1, 0",
            "1, 0, 0",
            "the lamp 'sky' and the surface 'left' both have a hue, which the sensor does not see: ",
        ),
        ("0, 1, 0", "1, 0, 0", "the surface reflects 72% of this light in place of 0%, the largest error of one"),
        ("1, 0, 0", "1, 0, 0", "the surface reflects 21% of this light in place of 100%, the largest"),
        ("0, 1, 0", "2, 2, 2", None),
        ("0.5, 0.5, 0.5", "1, 0, 0", None),
    ],
)
def test_a_lamp_and_a_surface_that_both_have_a_hue_are_named_with_the_error(take, paper, lamp, line):
    _, lines = take(paper, lamp)
    hues = [text for text in lines if text.startswith("colour: ")]
    assert len(hues) == (line is not None)
    assert line is None or line in hues[0]
