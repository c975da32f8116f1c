"""The size of texels on textured surfaces."""

import mitsuba as mi
import numpy as np
import pytest
from small_dataset import SCENES

from saf_gen.optics import ImageDistanceDrive
from saf_gen.render.depth_and_target import footprints
from saf_gen.render.render_setup import RenderSetup, SensorGrid

pytestmark = pytest.mark.usefixtures("every_backend")
GRID = SensorGrid(12, 16, 1e-4)
EVERY_PIXEL = np.ones((12, 16), dtype=bool)


def texels(shape, *, unit_m=1.0):
    down = mi.ScalarTransform4f().look_at(origin=[0, 0, 0.5 / unit_m], target=[0, 0, 0], up=[0, 1, 0])
    loaded = mi.load_dict({"type": "scene", "it": shape}, optimize=False)
    setup = RenderSetup(loaded, None, down, ImageDistanceDrive(0.025, 2.0, (0.6, 0.4)), GRID, unit_m)
    return footprints(setup, ("it",), position=0.5, target=EVERY_PIXEL)


def picture(rows, columns, **more):
    data = np.full((rows, columns, 1), 0.5, dtype=np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(data), "raw": True, **more}


def sheet(texture, unit_m=1.0):
    """A sheet of 0.4 m × 0.2 m."""
    at = mi.ScalarTransform4f().scale([0.2 / unit_m, 0.1 / unit_m, 1])
    return {"type": "rectangle", "to_world": at, "bsdf": {"type": "diffuse", "reflectance": texture}}


@pytest.mark.parametrize("unit_m", [1.0, 0.001])
def test_a_texel_is_the_side_over_the_number_of_texels(unit_m):
    """100 rows over 0.2 m and 100 columns over 0.4 m give texels of 2 mm × 4 mm."""
    sizes = texels(sheet(picture(100, 100), unit_m), unit_m=unit_m)
    assert sizes.size == EVERY_PIXEL.sum()
    assert sizes == pytest.approx(np.sqrt(0.002 * 0.004), rel=1e-4)


def test_a_texture_that_is_repeated_has_smaller_texels():
    repeated = picture(100, 100, to_uv=mi.ScalarTransform4f().scale([4, 4, 1]))
    assert texels(sheet(repeated)) == pytest.approx(np.sqrt(0.002 * 0.004) / 4, rel=1e-4)


def test_the_finest_of_several_bitmaps_counts():
    shape = sheet(picture(100, 100))
    shape["bsdf"] = {"type": "principled", "base_color": picture(100, 100), "roughness": picture(10, 10)}
    assert texels(shape) == pytest.approx(np.sqrt(0.002 * 0.004), rel=1e-4)


def test_a_mesh_of_a_file_has_the_texels_of_its_coordinates():
    """The crate of the exported scene has sides of 0.1 m, each with the complete picture of 512 texels."""
    shape = {
        "type": "ply",
        "filename": str(SCENES / "workbench/meshes/Crate.001.ply"),
        "to_world": mi.ScalarTransform4f().translate([0, -0.05, 0]),
        "bsdf": {"type": "diffuse", "reflectance": picture(512, 512)},
    }
    sizes = texels(shape)
    assert sizes.size
    assert sizes == pytest.approx(0.1 / 512, rel=1e-3)


def test_a_surface_without_a_bitmap_has_none():
    assert texels(sheet({"type": "checkerboard"})).size == 0
    assert texels(sheet(0.5)).size == 0
