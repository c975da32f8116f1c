"""Scenes that were ported make what they made before, so that they keep the digest of the text before."""

import mitsuba as mi
import numpy as np
import pytest
from written_scenes import needs_llvm

from saf_gen.render import backend, mitsuba_scene
from saf_gen.scene import scene_folder
from saf_gen.scene.ported_scenes import PORTED
from saf_gen.scene.scene_folder import find_scene

ARRAYS = ("faces", "vertex_positions", "vertex_normals", "vertex_texcoords", "vertex_tone")
QUICK = ("usaf_target", "low_texture", "usaf_microscope")
MADE = {
    "usaf_target": (17430761, 952.67045, 0, 0, 0),
    "low_texture": (1.0142295e10, 18805.87, 267519.43, 200683.95, 0),
    "usaf_microscope": (1.3827436e09, 40390.712, 72407.349, 9156.3303, 0),
    "camel": (4.1732917e10, 46888.557, 482650.36, 309034.17, 0),
    "two_planes": (843695, 756.8082, 1737.6528, 1270.8222, 0),
    "lily_anther": (81471732, 7789.527, 0, 15094.08, 0),
    "foliage": (3.4810532e10, 9616905.7, 807629.88, 512128.66, 0),
    "night_street": (3.0791125e09, 9435994.5, 0, 110110.48, 0),
    "bookshelf": (8.2867389e08, 55610.948, 54014.644, 42437.192, 0),
    "bottle": (9.0727304e08, 40121.123, 55347.388, 0, 0),
    "cardiac_muscle": (67130818, 2433.1245, 0, 13862.917, 0),
    "fan": (3.5203947e10, 314247.23, 479843.61, 31615.175, 64005.576),
    "speculars": (8.222793e10, 173416.5, 704213.52, 642689.31, 0),
    "crossroad": (5.0842559e10, 93324357, 695594.81, 1153269.4, 0),
}
"""Weighted sums of the arrays of all meshes, as the scripts before the port made them."""


def sums(described):
    found = np.zeros(len(ARRAYS))
    for held in (mi.traverse(shape) for shape in described.values() if isinstance(shape, mi.Mesh)):
        for n, name in enumerate(ARRAYS):
            array = np.nan_to_num(np.array(held[name], np.float64)) if name in held else np.empty(0)
            found[n] += (np.abs(array) * (1 + np.arange(array.size) % 7)).sum()
    return found


def test_every_ported_scene_is_found_by_its_text(monkeypatch):
    digests = {name: find_scene(name).digest for name in MADE}
    monkeypatch.setattr(scene_folder, "PORTED", {})
    assert {find_scene(name).digest: digest for name, digest in digests.items()} == PORTED


def test_an_edit_gives_a_ported_scene_a_digest_of_its_own(tmp_path, monkeypatch):
    source = find_scene("usaf_target").folder
    copy = tmp_path / "usaf_target"
    copy.mkdir()
    for file in source.iterdir():
        if file.is_file():
            (copy / file.name).write_bytes(file.read_bytes())
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    before = find_scene("usaf_target").digest
    assert before in PORTED.values()
    (copy / "scene.py").write_text((copy / "scene.py").read_text() + "\n# edited\n")
    assert find_scene("usaf_target").digest not in {before, *PORTED, *PORTED.values()}


@needs_llvm
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in QUICK else pytest.mark.long) for name in MADE]
)
def test_a_ported_scene_makes_what_it_made(name):
    """Within rounding, which differs from processor to processor; on the one of the port, every bit was the same."""
    backend.activate_backend("llvm")
    assert sums(mitsuba_scene.scene_dict(find_scene(name))) == pytest.approx(MADE[name], rel=1e-5)
