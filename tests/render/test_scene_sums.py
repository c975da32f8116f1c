"""Sums of what a script returned: the last digits that another processor rounds do not count, other values do."""

import copy
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from capture_dataset import VARIANT

from saf_gen.render.backend import activate_backend
from saf_gen.render.scene_sums import sum_up
from saf_gen.stack.same_scene import is_same

CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
FACES = np.array([[0, 1, 2], [2, 3, 0]], dtype=np.uint32)
BLOBS = {f"blob{n}": {"type": "sphere", "center": [0.1 * n, 0.2, 0.5], "radius": 0.02} for n in range(40)}


@pytest.fixture(autouse=True)
def _backend():
    activate_backend(VARIANT)


def texture(side=512, seed=1, contrast=1.0):
    return (1 - contrast * np.random.default_rng(seed).random((side, side, 3))).astype(np.float32)


def mesh(corners=CORNERS, faces=FACES):
    made = mi.Mesh("sheet", len(corners), len(faces))
    held = mi.traverse(made)
    held["vertex_positions"], held["faces"] = np.ravel(corners), np.ravel(faces)
    held.update()
    return made


def scene(**changes):
    return {
        "print": {"type": "rectangle", "bsdf": {"type": "bitmap", "bitmap": mi.Bitmap(texture())}},
        "sheet": mesh(),
        "lamp": {"type": "point", "position": [0.3, 0.2, -0.1], "intensity": {"type": "rgb", "value": 20.0}},
        "room": {"type": "constant", "radiance": {"type": "rgb", "value": 0.5}},
        "plate": {"type": "cube", "to_world": mi.ScalarTransform4f().translate([0, 0, 2]).rotate([0, 1, 0], 30)},
        "glass": mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.3}}),
        **BLOBS,
        **changes,
    }


def sums(described, folder="."):
    return sum_up(described, folder=Path(folder))


def with_bitmap(values):
    return {"type": "rectangle", "bsdf": {"type": "bitmap", "bitmap": mi.Bitmap(values)}}


def lit(lamp, room):
    values = zip(("lamp", "room"), (lamp, room), strict=True)
    return {name: {"type": "constant", "radiance": {"type": "rgb", "value": value}} for name, value in values}


OTHERS = {
    "another seed of a texture": lambda: scene(print=with_bitmap(texture(seed=2))),
    "a large texture of little contrast": lambda: scene(print=with_bitmap(texture(2048, seed=2, contrast=0.05))),
    "one letter of a print": lambda: scene(print=with_bitmap(_with_letter(texture()))),
    "a shifted print": lambda: scene(print=with_bitmap(np.roll(texture(), 1, axis=1))),
    "a vertex that moved by a hundredth": lambda: scene(sheet=mesh(CORNERS + np.eye(4, 3, dtype=np.float32) / 100)),
    "vertices in another order": lambda: scene(sheet=mesh(CORNERS[[1, 0, 2, 3]], FACES)),
    "another diagonal": lambda: scene(sheet=mesh(faces=np.array([[0, 1, 3], [1, 2, 3]], dtype=np.uint32))),
    "one object less": lambda: {name: entry for name, entry in scene().items() if name != "blob7"},
    "two lights swapped": lambda: scene(**lit(0.5, 20.0)),
    "a lamp that moved by a thousandth": lambda: scene(lamp=scene()["lamp"] | {"position": [0.3003, 0.2, -0.1]}),
    "a plate that turned by a tenth of a degree": lambda: scene(plate=_turned(30.1)),
    "another name": lambda: {("a" if name == "blob7" else name): entry for name, entry in scene().items()},
    "another type": lambda: scene(plate={"type": "sphere"}),
    "another surface that Mitsuba has loaded": lambda: scene(
        glass=mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.301}})
    ),
    "objects in another order": lambda: dict(reversed(scene().items())),
    "one blob of forty elsewhere": lambda: scene(blob7=BLOBS["blob7"] | {"center": [0.701, 0.2, 0.5]}),
}


def _with_letter(values):
    values[20:30, 40:46] = 0
    return values


def _turned(degrees):
    return {"type": "cube", "to_world": mi.ScalarTransform4f().translate([0, 0, 2]).rotate([0, 1, 0], degrees)}


@pytest.mark.parametrize("what", OTHERS)
def test_another_scene_has_other_sums(what):
    usual = scene(**lit(20.0, 0.5)) if "lights" in what else scene()
    if "large" in what:
        usual = scene(print=with_bitmap(texture(2048, contrast=0.05)))
    assert not is_same(sums(OTHERS[what]()), sums(usual))


def test_the_same_scene_has_the_same_sums():
    assert sums(scene()) == sums(scene())
    assert sums(copy.copy(scene())) == sums(scene())


@pytest.mark.parametrize("seed", range(5))
def test_last_digits_do_not_count(seed):
    """Relative errors of 1e-7 in all values, and of zeros, as other processors make them."""
    random = np.random.default_rng(seed)

    def noisy(values):
        values = np.asarray(values, dtype=np.float64)
        return values * (1 + random.uniform(-1e-7, 1e-7, values.shape)) + random.uniform(-1e-16, 1e-16, values.shape)

    changed = scene(
        print=with_bitmap(noisy(texture()).astype(np.float32)),
        sheet=mesh(noisy(CORNERS).astype(np.float32)),
        lamp=scene()["lamp"] | {"position": noisy([0.3, 0.2, -0.1]).tolist()},
        plate={"type": "cube", "to_world": mi.ScalarTransform4f(noisy(_turned(30)["to_world"].matrix).tolist())},
        **{name: entry | {"center": noisy(entry["center"]).tolist()} for name, entry in BLOBS.items()},
    )
    assert is_same(sums(changed), sums(scene()))


def test_texels_that_round_to_the_next_of_256_values_do_not_count():
    random = np.random.default_rng(1)
    values = (texture() * 255).astype(np.uint8)
    other = values.copy()
    other.ravel()[random.integers(0, values.size, 20)] ^= 1
    assert is_same(sums(scene(print=with_bitmap(other))), sums(scene(print=with_bitmap(values))))


def test_a_file_counts_by_its_name_in_the_folder_and_by_its_content_elsewhere(tmp_path):
    def of(folder, name, content):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / name).write_bytes(content)
        return {"print": {"type": "bitmap", "filename": str(tmp_path / folder / name)}}

    inside = [sums(of(home, "a.png", b"same"), tmp_path / home) for home in ("here", "there")]
    assert inside[0] == inside[1], "the same scene in another place"
    assert inside[0] != sums(of("here", "b.png", b"same"), tmp_path / "here")
    outside = [sums(of("elsewhere", *file), tmp_path / "here") for file in (("x.png", b"1234"), ("y.png", b"1234"))]
    assert outside[0] == outside[1], "a temporary file"
    assert not is_same(outside[0], sums(of("elsewhere", "x.png", b"1235"), tmp_path / "here"))


def test_sums_leave_constants_of_the_renderer_as_they_are():
    """A constant that is evaluated would make other kernels."""
    if VARIANT == "scalar":
        pytest.skip("scalar has no kernels")
    import drjit as dr

    constant = mi.Float(0.5)
    sums({"value": constant, "colour": mi.Color3f(0.1, 0.2, 0.3)})
    assert constant.state == dr.VarState.Literal
