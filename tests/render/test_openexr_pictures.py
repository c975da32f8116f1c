"""Scenes with OpenEXR pictures load, and look as with the same picture in another format."""

import mitsuba as mi
import numpy as np
import OpenEXR
import pytest
from written_scenes import VARIANT, load_setup, render_stack_once, write_scene

from saf_gen.render import backend
from saf_gen.render.render_setup import SensorGrid


def shapes_with(kind, file):
    if kind == "envmap":
        lamp = f"'room': {{'type': 'envmap', 'filename': {file!r}}}"
        surface = "'reflectance': {'type': 'rgb', 'value': 0.5}"
    else:
        lamp = "'room': {'type': 'constant', 'radiance': {'type': 'rgb', 'value': 1.0}}"
        surface = f"'reflectance': {{'type': 'bitmap', 'raw': True, 'filename': {file!r}}}"
    wall = "{'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).scale(0.3 * m), 'bsdf': {'type': 'diffuse', %s}}"
    return f"{{'wall': {wall % surface}, {lamp}}}"


@pytest.mark.parametrize("kind", ["envmap", "bitmap"])
def test_a_scene_with_openexr_loads_and_looks_the_same(tmp_path, monkeypatch, kind):
    """On one thread, as on a machine of one core."""
    monkeypatch.setattr(backend, "usable_cores", lambda: 1)
    backend.activate_backend(VARIANT)
    values = np.random.default_rng(1).uniform(0.1, 0.9, (32, 64, 3)).astype(np.float32)
    stacks = []
    for ending in ("exr", "pfm"):
        folder = tmp_path / ending
        folder.mkdir()
        file = folder / f"picture.{ending}"
        if ending == "exr":  # by the format's own library: on one thread, Mitsuba writes it for ever
            OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": values}).write(str(file))
        else:
            mi.Bitmap(values).write(str(file))
        scene = write_scene(folder, monkeypatch, shapes=shapes_with(kind, str(file)), light="room", target="wall")
        setup = load_setup(scene, ("room",), name=VARIANT, grid=SensorGrid(rows=10, columns=16, pitch_m=240e-6))
        stacks.append(render_stack_once(setup, positions=3, samples=4, seed=1))
    np.testing.assert_allclose(stacks[0], stacks[1], rtol=2e-3)  # Mitsuba may write halves
    assert stacks[0].std() > 0.01 * stacks[0].mean()
