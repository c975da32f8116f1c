"""The dataset card states the lens motion of the recipe, and the command that ranks methods."""

from dataclasses import replace

import pytest
from small_dataset import SMALL_RECIPE
from windowed_dataset import ENTRY

from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.run import write_dataset_card
from saf_gen.stream.manifest import Manifest, write_manifest


def card(tmp_path, motion, sequences=()):
    path = tmp_path / "small.yaml"
    path.write_text(SMALL_RECIPE.replace("positions: 9", f"positions: 9, motion: {motion}"))
    (tmp_path / "lens.csv").write_text("time_s,position\n0,0\n1,1\n")
    manifest = Manifest(name="small", recipe_fingerprint="r", variant="llvm", sequences=sequences)
    write_manifest(tmp_path, manifest)
    write_dataset_card(tmp_path, read_recipe(path), manifest=manifest, scenes=[])
    return (tmp_path / "README.md").read_text()


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ("{kind: hold, position: {uniform: [0.2, 0.8]}}", "`hold` (position uniform 0.2, 0.8)"),
        ("{choice: [{kind: sweep, to: 0.5}, {kind: sweep}]}", "`sweep` (to 0.5) or `sweep`"),
        ("{kind: from_csv, file: {choice: [lens.csv]}}", "`from_csv` (file choice lens.csv)"),
    ],
)
def test_the_card_states_the_lens_motion_in_one_row(tmp_path, motion, words):
    assert f"| lens motion | {words} |\n" in card(tmp_path, motion)


@pytest.mark.parametrize(
    ("splits", "command"),
    [(("train", "test"), "saf-gen evaluate ."), (("train", "validation"), "saf-gen evaluate . --split validation")],
)
def test_the_command_of_the_card_names_a_split_that_can_be_ranked(tmp_path, splits, command):
    entries = tuple(replace(ENTRY, id=split, split=split, file=f"{split}/{split}.h5") for split in splits)
    assert f"from this folder: `{command}`; to publish" in card(tmp_path, "{kind: sweep}", entries)
