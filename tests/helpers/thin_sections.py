"""A small thin section that tests write: 10× at NA 0.12, of which a sensor of 16 × 24 pixels sees 48 µm × 32 µm."""

from saf_gen.render.render_setup import SensorGrid
from saf_gen.scene.scene_folder import find_scene

GRID = SensorGrid(rows=16, columns=24, pitch_m=20e-6)
CARD = """\
id: slide
title: A slide
licence: Apache-2.0
source: here
camera: {origin_m: [0, 0, 0.0198], look_at_m: [0, 0, 0]}
lens: {drive: stage, focal_length_mm: 18, f_number: 3.6, magnification: 10, travel_m: [-1.2e-4, 1.2e-4]}
section:
  wavelength_nm: 550
  condensers: {wide: {coherence: 0.6, radiance: 50}, narrow: {coherence: 0.3, radiance: 80}}
lights: {lamp: [wide], stopped: [narrow]}
target: [section]
params: {height_um: {uniform: [-40, 40]}, seed: 3}
"""
BUILD = """\
import numpy as np

def build(params):
    noise = np.random.default_rng(int(params["seed"])).normal(size=(60, 80))
    smooth = sum(np.roll(noise, (i, j), (0, 1)) for i in range(3) for j in range(3)) / 3
    return {"transmission": 0.99, "path_nm": 30 * smooth, "texel_um": 1.0, "height_um": params["height_um"]}
"""


def write_slide(folder, monkeypatch, *, card=CARD, build=BUILD):
    """Write the scene ``slide`` into a folder and find it."""
    scene = folder / "slide"
    scene.mkdir()
    (scene / "scene.yaml").write_text(card, encoding="utf-8")
    (scene / "scene.py").write_text(build, encoding="utf-8")
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder))
    return find_scene("slide")
