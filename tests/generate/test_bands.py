"""Recipes that ask for bands: what is rendered, shared and refused. Nothing is rendered here."""

import shutil

import numpy as np
import pytest
import yaml
from refusals import assert_says, refusal
from small_dataset import SCENES, SMALL_RECIPE

from saf_gen.generate.plan import make_plan
from saf_gen.generate.resolve import coarse_sampling, recipe_digest, recipe_fingerprint, resolve_recipe

FILE = {"file": "c_mount", "f_number": 2.0, "focus_range_m": [0.60, 0.42]}
THIN = {"focal_length_mm": 25, "f_number": 2.0, "focus_range_m": [0.60, 0.42]}
LED, SODIUM, MONO = ({"kind": "constant", **({"spectrum": one} if one else {})} for one in ("led", "sodium", None))


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a recipe of scenes by their lenses, and of lights."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))

    def written(lenses=(FILE,), *, lights=None, camera=None, **render):
        names = [f"plane_{n}" for n in range(len(lenses))]
        for name, lens in zip(names, lenses, strict=True):
            folder = tmp_path / "scenes" / name
            shutil.copytree(SCENES / "plane", folder, dirs_exist_ok=True)
            card = yaml.safe_load((SCENES / "plane" / "scene.yaml").read_text())
            (folder / "scene.yaml").write_text(yaml.safe_dump({**card, "id": name, "lens": lens}))
        recipe = yaml.safe_load(SMALL_RECIPE)
        recipe["focus"] = {"positions": 9}
        recipe["render"] = {"samples": 8, **render}
        recipe["camera"] |= {"filter": "ir_cut", **(camera or {})}
        recipe["lights"] = lights or {"led": LED}
        recipe["splits"] = {"test": {"scenes": names, "lights": list(recipe["lights"])}}
        path = tmp_path / "small.yaml"
        path.write_text(yaml.safe_dump(recipe))
        return path

    return written


def test_each_band_is_a_stack_of_its_own_with_the_lens_and_the_waves_of_its_wavelength(write, tmp_path):
    resolved = resolve_recipe(write(bands=3))
    (s,) = resolved.sequences
    assert s.planned.bands_nm == (550.0, 650.0, 450.0)  # the one nearest to the lens's own wavelength first
    specs = s.time_stack.specs
    assert len({spec.key for spec in specs}) == 3
    assert [spec.wavelength_m for spec in specs] == pytest.approx([550e-9, 650e-9, 450e-9])
    lens = s.scene.card.lens.lens
    assert [spec.drive.wavefront for spec in specs] == [lens.rays_at(nm) for nm in (550, 650, 450)]
    assert not s.time_stack.is_moving
    plan = make_plan(resolved, tmp_path / "out")
    assert plan.to_render == {s.time_stack: specs}
    (line,) = coarse_sampling(resolved)[-1:]
    assert "mixed from those of 3 wavelengths" in line


def test_cost_grows_with_the_number_of_bands(write, tmp_path):
    cost = {
        bands: make_plan(resolve_recipe(write(bands=bands)), tmp_path / "out").estimate().render_s for bands in (1, 4)
    }
    assert 2 < cost[4] / cost[1] <= 4  # grain is measured at one wavelength


def test_one_band_is_the_recipe_without_any(write):
    one, none = (resolve_recipe(write(**options)) for options in ({"bands": 1}, {}))
    assert recipe_fingerprint(one.recipe) == recipe_fingerprint(none.recipe)
    assert recipe_digest(one) == recipe_digest(none)
    assert "bands" not in none.recipe.model_dump(mode="json")["render"]


def test_another_lamp_or_sensor_costs_no_rendering(write):
    first, second = (
        resolve_recipe(write(bands=3, lights={"lamp": {"kind": "constant", "spectrum": lamp}}, camera=camera))
        for lamp, camera in (("led", {}), ({"daylight": 6504}, {"noise": {"shot": False}}))
    )
    assert first.sequences[0].time_stack == second.sequences[0].time_stack


def test_what_has_no_bands_is_rendered_as_ever(write):
    """A light without a spectrum, and a thin lens, beside a lens file in bands."""
    mixed = resolve_recipe(write((FILE, THIN), lights={"led": LED, "mono": MONO}, bands=3))
    counts = {(s.scene.id, s.planned.light): len(s.time_stack.specs) for s in mixed.sequences}
    assert counts == {("plane_0", "led"): 3, ("plane_0", "mono"): 1, ("plane_1", "led"): 1, ("plane_1", "mono"): 1}
    alone = resolve_recipe(write((FILE, THIN), lights={"mono": MONO}, camera={"filter": "none"}))
    stacks = [{s.time_stack for s in one.sequences if s.planned.light == "mono"} for one in (mixed, alone)]
    assert stacks[0] == stacks[1]


REFUSED = {
    "no lens file": ({"lenses": (THIN,), "bands": 4}, "render.bands is 4 | no light with a spectrum | allowed: 1"),
    "no spectrum": ({"lights": {"mono": MONO}, "camera": {"filter": "none"}, "bands": 4}, "no light with a spectrum"),
    "light of one wavelength": ({"lights": {"sodium": SODIUM}, "bands": 2}, "shows no light of this recipe better"),
    "none": ({"bands": 0}, "render.bands"),
    "below none": ({"bands": -3}, "render.bands"),
    "too many": ({"bands": 33}, "render.bands"),
    "a part": ({"bands": 2.5}, "render.bands"),
    "a word": ({"bands": "many"}, "render.bands"),
    "wavelengths": ({"bands": [450, 650]}, "render.bands"),
    "a misspelt key": ({"band": 3}, "did you mean 'bands'"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_bands_that_make_no_sense_are_refused_in_one_line(write, what):
    options, said = REFUSED[what]
    assert_says(refusal(resolve_recipe, write(**options)), said)


def test_a_lens_that_one_wavelength_shows_more_than_a_pixel_off_is_shown_in_bands(write, small_sensor, tmp_path):
    """Pixels of 5 µm at the edge of a large picture."""
    sensor = yaml.safe_load(small_sensor.read_text()) | {"rows": 100, "columns": 2000, "pitch_m": 5e-6}
    (tmp_path / "wide.yaml").write_text(yaml.safe_dump(sensor))
    wide = {"lenses": ({**FILE, "f_number": 1.4},), "camera": {"sensor": "wide.yaml"}}
    said = str(refusal(resolve_recipe, write(**wide)))
    assert "at most 1 of either" in said
    assert "bands: 4" in said
    resolve_recipe(write(**wide, bands=8))


def test_shards_deal_out_bands_each_once(write):
    from saf_gen.generate.shards import share_out

    resolved = resolve_recipe(write(bands=4))
    shares = share_out(resolved, 3)
    assert sorted(spec.key for share in shares for spec in share.specs) == sorted(
        spec.key for spec in resolved.sequences[0].time_stack.specs
    )
    assert max(share.seconds for share in shares) < 0.7 * np.sum([share.seconds for share in shares])
