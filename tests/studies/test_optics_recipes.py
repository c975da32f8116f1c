"""The recipes of studies/optics: one set of scenes behind lenses with and without aberrations and colour."""

from pathlib import Path

import pytest

from saf_gen.generate.resolve import resolve_recipe

FOLDER = Path("studies/optics")
CONDITIONS = sorted(path.stem for path in FOLDER.glob("*.yaml"))


@pytest.fixture(scope="module")
def resolved():
    return {name: resolve_recipe(FOLDER / f"{name}.yaml") for name in CONDITIONS}


@pytest.mark.slow
def test_conditions_share_members_motions_and_seeds_so_that_answers_can_be_paired(resolved):
    assert CONDITIONS == ["colour", "mild", "none", "strong"]
    alike = {
        name: [(p.id, p.seed, p.params, p.motion, p.mean_rate) for p in (s.planned for s in work.sequences)]
        for name, work in resolved.items()
    }
    assert len(alike["none"]) == 48
    assert all(one == alike["none"] for one in alike.values())


def test_conditions_differ_in_what_the_lens_does(resolved):
    stacks = {name: {s.time_stack.specs[0].key for s in work.sequences} for name, work in resolved.items()}
    assert len(frozenset().union(*stacks.values())) == sum(len(keys) for keys in stacks.values()) == 4 * 24
    coloured = {name for name, work in resolved.items() if all(s.planned.axial_colour for s in work.sequences)}
    assert coloured == {"colour"}
