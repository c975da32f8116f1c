"""Test splits whose seed is drawn by the commit that fixes a method: the same dataset for everybody."""

import pytest

from saf_gen.generate.recipe import read_recipe
from studies.sealed.__main__ import main


@pytest.fixture
def draw(tmp_path, monkeypatch):
    """A function that draws a recipe in a folder of its own, and returns the path of the drawn one."""
    folder = tmp_path / "drawn"
    folder.mkdir()
    monkeypatch.chdir(folder)

    def run(recipe, commit):
        main(["draw", str(recipe), commit])
        return folder / f"{recipe.stem}-drawn.yaml"

    return run


@pytest.fixture
def refused(draw, capsys):
    """A function that returns the last line of a draw that ends with exit code 2."""

    def run(recipe, commit):
        with pytest.raises(SystemExit) as stop:
            draw(recipe, commit)
        assert stop.value.code == 2
        return capsys.readouterr().err.splitlines()[-1]

    return run


def test_a_drawn_split_hangs_on_the_text_and_on_the_commit(draw, small_recipe):
    found = []
    for commit, comment in (("a" * 40, ""), ("a" * 40, ""), ("b" * 40, ""), ("a" * 40, "# one more member\n")):
        small_recipe.write_text(small_recipe.read_text(encoding="utf-8") + comment, encoding="utf-8")
        path = draw(small_recipe, commit)
        drawn = read_recipe(path)
        found.append(drawn.seed)
        assert drawn.name == f"{read_recipe(small_recipe).name}_drawn"
        path.unlink()
    assert found[0] == found[1]
    assert len({3, *found}) == 4


def test_a_drawn_recipe_is_the_recipe_with_another_seed_and_name(draw, request):
    recipe = request.config.rootpath / "recipes/saf_bench.yaml"
    before = recipe.read_text(encoding="utf-8").splitlines()
    after = draw(recipe, "565887ff81b2a132db7ce6653e32986d32da48cd").read_text(encoding="utf-8").splitlines()
    changed = {old: new for old, new in zip(before, after, strict=True) if old != new}
    assert changed == {"name: saf_bench": "name: saf_bench_drawn", "seed: 6801": "seed: 7794775690296289177"}


def test_what_cannot_be_drawn_is_refused_in_one_line(refused, draw, small_recipe, tmp_path):
    assert "'a1b2c3d' is not a commit; allowed: 40 hexadecimal digits" in refused(small_recipe, "a1b2c3d")
    assert "without.yaml" in refused(tmp_path / "without.yaml", "a" * 40)
    (tmp_path / "without.yaml").write_text("name: without\n", encoding="utf-8")
    assert "without.yaml has no line with its seed" in refused(tmp_path / "without.yaml", "a" * 40)
    draw(small_recipe, "a" * 40)
    assert "small-drawn.yaml exists already" in refused(small_recipe, "b" * 40)
