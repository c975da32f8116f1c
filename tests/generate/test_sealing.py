"""Sealed recipes: committed to first, opened later, and then the same dataset for everybody."""

import hashlib
import re

import pytest
import yaml
from refusals import refusal

from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import draw_sequences


@pytest.fixture
def sealed(call, small_recipe):
    """The sealed small recipe and its secret file."""
    assert call("recipes", "seal", small_recipe)[0] == 0
    return small_recipe.with_stem("small-sealed"), small_recipe.with_suffix(".secret")


def test_a_sealed_recipe_commits_to_its_secret_and_keeps_all_else(sealed, small_recipe):
    path, secret = sealed
    before, after = (yaml.safe_load(p.read_text()) for p in (small_recipe, path))
    seed = after.pop("seed")
    text = secret.read_text().strip()
    assert set(seed) == {"sealed", "salt"}
    assert hashlib.sha256(bytes.fromhex(text) + bytes.fromhex(seed["salt"])).hexdigest() == seed["sealed"]
    assert text not in path.read_text()
    assert secret.stat().st_mode & 0o077 == 0
    assert before.pop("seed") == 3
    assert before == after


def test_a_sealed_recipe_generates_nothing(call, sealed, tmp_path):
    for words in (("generate", sealed[0], "--out", tmp_path / "data"), ("recipes", "check", sealed[0])):
        code, _, err = call(*words)
        assert (code, err.count("\n")) == (2, 1)
        assert "small-sealed.yaml:2: this recipe is sealed; run saf-gen recipes unseal" in err
    assert not (tmp_path / "data").exists()


def test_everybody_who_unseals_a_recipe_gets_the_same_new_seed(call, sealed, small_recipe):
    path, secret = sealed
    code, out, _ = call("recipes", "unseal", path, "--secret", secret)
    assert code == 0
    opened = read_recipe(small_recipe.with_stem("small-open"))
    assert f"seed {opened.seed} " in out
    other = small_recipe.with_stem("other")
    assert call("recipes", "unseal", path, "--secret", secret.read_text().strip(), "--out", other)[0] == 0
    assert read_recipe(other) == opened
    assert opened.seed != 3
    assert 0 <= opened.seed < 2**63
    assert {s.seed for s in draw_sequences(opened)}.isdisjoint(
        s.seed for s in draw_sequences(read_recipe(small_recipe))
    )


@pytest.mark.parametrize(
    ("secret", "message"),
    [
        ("0" * 64, "the secret 00000000… is not the sealed secret; allowed: the secret of "),
        ("my secret", "'my secret' is not a secret; allowed: 64 hexadecimal digits"),
    ],
)
def test_another_secret_opens_nothing(call, sealed, secret, message, tmp_path):
    code, _, err = call("recipes", "unseal", sealed[0], "--secret", secret)
    assert (code, err.count("\n")) == (2, 1)
    assert message in err
    assert not list(tmp_path.glob("*-open.yaml"))


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (r'salt: "\w+"', 'salt: "12"', "seed.salt is '12'"),
        (r'salt: "\w+"', "salty: 1", "unknown key 'salty' in seed"),
        (r"sealed: ", "selaed: ", "unknown key 'selaed' in seed"),
    ],
)
def test_a_seal_that_does_not_fit_is_refused_with_its_line(sealed, old, new, problem):
    sealed[0].write_text(re.sub(old, new, sealed[0].read_text(), count=1))
    error = refusal(read_recipe, sealed[0])
    assert problem in error.problem
    assert error.where.endswith("small-sealed.yaml:2")


def test_a_secret_is_made_once_and_a_recipe_sealed_once(call, sealed, small_recipe):
    before = sealed[1].read_text()
    assert "small-sealed.yaml exists already" in call("recipes", "seal", small_recipe)[2]
    assert "this recipe is sealed" in call("recipes", "seal", sealed[0])[2]
    assert "this recipe is not sealed" in call("recipes", "unseal", small_recipe, "--secret", sealed[1])[2]
    sealed[0].unlink()
    _, _, err = call("recipes", "seal", small_recipe)
    assert "small.secret exists already" in err
    assert "or remove it if no recipe was published with it" in err, "its run may have been stopped"
    assert sealed[1].read_text() == before
