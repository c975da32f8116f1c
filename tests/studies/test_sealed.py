"""Sealed recipes: committed to first, opened later, and then the same dataset for everybody."""

import hashlib

import pytest
import yaml

from saf_gen.generate.recipe import read_recipe
from studies.sealed.__main__ import main


@pytest.fixture
def sealed(small_recipe):
    """The sealed small recipe and its secret file."""
    main(["seal", str(small_recipe)])
    return small_recipe.with_stem("small-sealed"), small_recipe.with_suffix(".secret")


def refused(capsys, *arguments):
    """The last line of a command that ends with exit code 2."""
    with pytest.raises(SystemExit) as stop:
        main(list(map(str, arguments)))
    assert stop.value.code == 2
    return capsys.readouterr().err.splitlines()[-1]


def test_a_sealed_recipe_commits_to_its_secret_keeps_all_else_and_generates_nothing(call, sealed, small_recipe):
    path, secret = sealed
    before, after = (yaml.safe_load(p.read_text()) for p in (small_recipe, path))
    seed, text = after.pop("seed"), secret.read_text().strip()
    assert set(seed) == {"sealed", "salt"}
    assert hashlib.sha256(bytes.fromhex(text) + bytes.fromhex(seed["salt"])).hexdigest() == seed["sealed"]
    assert text not in path.read_text()
    assert secret.stat().st_mode & 0o077 == 0
    assert before.pop("seed") == 3
    assert before == after
    code, _, err = call("recipes", "check", path)
    assert (code, err.count("\n")) == (2, 1)
    assert "small-sealed.yaml:2: seed is" in err


def test_everybody_who_opens_a_recipe_gets_the_same_new_seed(sealed, small_recipe):
    path, secret = sealed
    main(["open", str(path), str(secret)])
    first = read_recipe(opened := small_recipe.with_stem("small-open"))
    opened.unlink()
    main(["open", str(path), secret.read_text().strip()])
    assert read_recipe(opened) == first
    assert first.seed != 3


def test_the_sealed_splits_of_the_benchmark_open_to_the_seeds_they_were_made_with(tmp_path, request):
    folder = request.config.rootpath / "studies/sealed"
    seeds = []
    for name in ("saf_bench-v3_sealed", "saf_bench-v3_sealed_2"):
        text = (folder / f"{name}.yaml").read_text(encoding="utf-8")
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
        secret = text.split("The secret is\n# ")[1][:64]
        main(["open", str(tmp_path / f"{name}.yaml"), secret])
        seeds.append(read_recipe(tmp_path / f"{name}-open.yaml").seed)
    assert seeds == [4763740025290823031, 4075791652983917933]


def test_what_does_not_fit_is_refused_in_one_line(capsys, sealed, small_recipe):
    path, secret = sealed
    assert "the secret 00000000… is not that of" in refused(capsys, "open", path, "0" * 64)
    assert "'my secret' is not a secret; allowed: 64 hexadecimal digits" in refused(capsys, "open", path, "my secret")
    assert "is not sealed" in refused(capsys, "open", small_recipe, secret)
    assert "is sealed already" in refused(capsys, "seal", path)
    assert "small-sealed.yaml exists already" in refused(capsys, "seal", small_recipe)
    path.unlink()
    assert "small.secret exists already" in refused(capsys, "seal", small_recipe)


def test_a_drawn_split_hangs_on_the_text_and_on_the_commit(small_recipe, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    found = []
    for commit, comment in (("a" * 40, ""), ("a" * 40, ""), ("b" * 40, ""), ("a" * 40, "# one more member\n")):
        small_recipe.write_text(small_recipe.read_text(encoding="utf-8") + comment, encoding="utf-8")
        main(["draw", str(small_recipe), commit])
        drawn = read_recipe(tmp_path / "small-drawn.yaml")
        found.append(drawn.seed)
        assert drawn.name == f"{read_recipe(small_recipe).name}_drawn"
        (tmp_path / "small-drawn.yaml").unlink()
    assert found[0] == found[1]
    assert len({3, *found}) == 4
    assert "is not a commit" in refused(capsys, "draw", small_recipe, "a1b2c3d")
