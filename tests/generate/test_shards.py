"""Shards of a job array: each piece in one of them, the largest as large as it must be, and one dataset together."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import capture_dataset
import pytest
from capture_dataset import VARIANT
from refusals import assert_says, refusal

from saf_gen.generate.plan import make_plan
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.generate.shards import partition
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.second_render import stacks_to_repeat
from saf_gen.stream.dataset import verify_dataset

RECIPES = sorted(path.stem for path in Path("recipes").glob("*.yaml") if path.stem not in ("paper_small", "variety"))
"""Without those with a few slices, of two minutes at most: loading their scenes again costs more than it saves."""
COUNTS = [1, 3, 8, 16, 32]
BEYOND = {
    ("learned", 16): 1.24,
    ("paper", 16): 1.23,
    ("paper", 32): 1.3,
    ("saf_live", 8): 1.23,
    ("saf_live", 16): 1.33,
    ("saf_live", 32): 1.56,
}
"""Largest shards, as multiples of the mean, above the aim of 1.2: pieces are too few (19 stacks in ``learned``), or
many cuts load scenes again whose loading costs as much as dozens of slices."""


@pytest.fixture(scope="module")
def shipped():
    return {name: resolve_recipe(f"recipes/{name}.yaml") for name in RECIPES}


@pytest.mark.daily(6)
@pytest.mark.slow
@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", RECIPES)
def test_every_piece_of_a_shipped_recipe_is_in_one_shard_and_none_is_much_too_large(shipped, name, count):
    work = shipped[name]
    shares = partition(work, count)
    stacks = {stack for s in work.sequences for stack in (s.time_stack, s.closed_loop_slices) if stack}
    assert sum(len(share.specs) for share in shares) == len({spec for stack in stacks for spec in stack.specs})
    assert frozenset().union(*(share.specs for share in shares)) == {spec for stack in stacks for spec in stack.specs}
    whole = [stack for share in shares for stack in share.whole]
    cut = {stack for share in shares for stack in share.cut}
    assert (len(whole), set(whole) | cut, set(whole) & cut) == (len(set(whole)), stacks, set())
    still = {stack for stack in stacks if not stack.is_moving}
    assert not still & cut
    dearest = dearest_piece(work)
    bound = BEYOND.get((name, count), 1.2)
    assert max(share.seconds for share in shares) <= max(bound * shares[0].all_seconds / count, dearest * 1.0001)
    most = 1.51 if name == "saf_live" else 1.28  # whose slices are cheap beside loading their scenes
    assert sum(share.seconds for share in shares) <= most * shares[0].all_seconds, "cuts cost less than what they split"


def dearest_piece(work):
    """Seconds of the dearest still stack with its recordings, alone in its shard; 0 if there is none."""
    stills = {s.time_stack: [] for s in work.sequences if not s.time_stack.is_moving}
    for sequence in work.sequences:
        if sequence.time_stack in stills:
            stills[sequence.time_stack].append(sequence)
    return max((partition(replace(work, sequences=tuple(s)), 1)[0].seconds for s in stills.values()), default=0.0)


RECIPE = """\
name: many
seed: 7
camera: {{sensor: vidar_400x250, frames: 400, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: 9{motion}}}
render: {{samples: 16{render}}}
lights: {{constant: {{kind: constant}}, ramp: {{kind: ramp, from: 0.5, to: 2.0}}}}
splits:
  train: {{scenes: [fan, bottle], lights: [constant, ramp], repeats: 12{more}}}
  test: {{scenes: [usaf_target], lights: [constant], repeats: 12}}
"""
RANDOM_MOTION = ", motion: {kind: sweep, from: {uniform: [0, 0.2]}}"
BOTH = ", scene_motion: [static, dynamic]"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "motion", "render"),
    [
        ("", "", ""),
        (", variants: 12", "", ""),
        (BOTH, "", ""),
        (BOTH, "", ", whole_slices: 0.004"),
        (BOTH, "", ", whole_slices: true"),
        (BOTH, RANDOM_MOTION, ", whole_slices: 0.004"),
        (BOTH, RANDOM_MOTION, ", estimator: plain"),
        (BOTH, ", motion: {choice: [{kind: sweep}, {kind: sweep, to: 0.7}, {kind: sweep, from: 0.02}]}", ""),
    ],
)
def test_stacks_shared_by_lights_and_ways_of_the_lens_are_dealt_out_once(tmp_path, more, motion, render):
    """The same recipe and number of shards always give the same shares; a stack's owner owns all that is shared."""
    path = tmp_path / "many.yaml"
    path.write_text(RECIPE.format(more=more, motion=motion, render=render))
    work = resolve_recipe(path)
    everything = {
        spec for s in work.sequences for st in (s.time_stack, s.closed_loop_slices) if st for spec in st.specs
    }
    for count in (1, 2, 3, 7, 40, 1000):
        shares = partition(work, count)
        assert shares == partition(resolve_recipe(path, part=(count, count)), count)
        assert sorted(spec.key for share in shares for spec in share.specs) == sorted(spec.key for spec in everything)
        for share in shares:
            assert all(set(stack.specs) <= share.specs for stack in share.whole)
            assert all(not set(stack.specs) <= share.specs or len(share.cut) > 1 for stack in share.cut)
        if count == 1:
            assert shares[0].cut == ()


@pytest.mark.slow
def test_shares_of_a_split_make_that_split(shipped):
    whole = shipped["paper"]
    of_test = replace(whole, sequences=tuple(s for s in whole.sequences if s.planned.split == "test"))
    shares = partition(of_test, 8)
    recorded = {stack for share in shares for stack in (*share.whole, *share.cut)}
    assert {s.time_stack for s in of_test.sequences} <= recorded
    assert not {s.time_stack for s in whole.sequences if s.planned.split != "test"} & recorded


@pytest.mark.slow
def test_leaving_out_slices_of_the_closed_loop_moves_no_picture_of_a_recording(moving):
    """Shares do not depend on --keep-slices: one shard with another choice only leaves pictures out."""
    for n in (1, 2, 3):
        shard = replace(moving, part=(n, 3))
        all_of_it, few = (make_plan(shard, Path("/nowhere"), keep_slices=keep).to_render for keep in ("all", "none"))
        recorded = {s.time_stack for s in moving.sequences}
        assert few == {stack: specs for stack, specs in all_of_it.items() if stack in recorded}


# --- on one folder ------------------------------------------------------------------------------------

MOVING = ["plane-dynamic-constant-00", "plane-dynamic-lamp_only-00"]
STILL = ["plane-constant-00", "plane-lamp_only-00"]


@pytest.fixture
def made(half_captured_dataset, monkeypatch):
    """A dataset of one process: a still stack, 11 slices of a moving scene, and 6 of its closed loop; read-only."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(half_captured_dataset.parent / "scenes"))
    return half_captured_dataset


@pytest.fixture
def recipe(made, tmp_path):
    path = tmp_path / "takes.yaml"
    path.write_text(capture_dataset.RECIPE.replace("whole_slices: true", "whole_slices: 0.02"))
    return path


@pytest.fixture
def moving(recipe):
    return resolve_recipe(recipe)


def everything_in(folder):
    """The content of all files, and the digests of streams, whose files hold the time of writing."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix in (".json", ".exr", ".h5") and path.name != "croissant.json"
    }


def share_of(work, n, count):
    return partition(work, count)[n - 1]


def keep_only(folder, work, specs):
    """Remove all stacks but these, all recordings and the manifest, as before their shards were run."""
    for spec in {
        spec for s in work.sequences for st in (s.time_stack, s.closed_loop_slices) if st for spec in st.specs
    }:
        if spec not in specs:
            shutil.rmtree(folder / "stacks" / spec.key, ignore_errors=True)
    for path in (*folder.glob("*.json"), *folder.glob("test/*.h5"), *folder.glob("stacks/*/stack.grain.json")):
        path.unlink()


@pytest.fixture
def cut(made, moving):
    """The number of one of eight shards that has some slices of a stack that is recorded from, not all with grain."""
    shares = partition(moving, 8)
    stack = next(s.time_stack for s in moving.sequences if s.time_stack.is_moving)
    some = [n for n, share in enumerate(shares, start=1) if len(share.specs & set(stack.specs)) > 1]
    return next(n for n in some if grain_of(made, moving) - shares[n - 1].specs)


@pytest.fixture
def rest(made, moving, tmp_path, cut):
    """What the other seven of eight shards have made before shard ``cut`` is run."""
    folder, mine = tmp_path / "takes", share_of(moving, cut, 8)
    shutil.copytree(made, folder)
    others = [share_of(moving, n, 8).specs for n in range(1, 9) if n != cut]
    keep_only(folder, moving, frozenset().union(*others))
    assert 0 < len(mine.specs) < 6
    assert mine.cut
    return folder


def run_shard(recipe, folder, n, count=8):
    result = generate(resolve_recipe(recipe, part=(n, count)), folder, variant=VARIANT)
    assert result.failed == {}
    return result


@pytest.mark.slow
def test_shards_on_one_folder_make_every_file_that_one_process_makes(recipe, made, moving, rest, cut):
    """The shard that ends last renders its own slices alone; the others then measure grain, and the last records."""
    mine = share_of(moving, cut, 8)
    last = run_shard(recipe, rest, cut)
    assert len(last.rendered) == 3 * len(mine.specs)
    assert (last.recorded, last.manifest.sequences) == ([], ()), "the grain of others' slices is not measured yet"
    others = [run_shard(recipe, rest, n) for n in range(1, 9) if n != cut]
    assert [shard.rendered for shard in others] == [[]] * 7
    assert sorted(name for shard in others for name in shard.recorded) == sorted(MOVING + STILL)
    closing = generate(moving, rest, variant=VARIANT)
    assert (closing.rendered, closing.recorded, len(closing.kept)) == ([], [], 4)
    assert everything_in(rest) == everything_in(made)
    assert verify_dataset(rest) == (4, {})


@pytest.mark.slow
def test_the_closing_run_makes_what_a_lost_shard_and_early_ones_left(made, moving, rest, cut):
    mine = share_of(moving, cut, 8)
    closing = generate(moving, rest, variant=VARIANT)
    assert len(closing.rendered) == 3 * len(mine.specs)
    assert sorted(closing.recorded) == sorted(MOVING + STILL)
    assert everything_in(rest) == everything_in(made)


class Killed(BaseException):
    pass


@pytest.mark.daily(3)
@pytest.mark.slow
@pytest.mark.parametrize("file", ["geometry.exr", "geometry.json", "lamp.exr", "room.json", "stack.grain.json", ".h5"])
def test_a_shard_killed_in_any_phase_goes_on_where_it_was(recipe, made, moving, rest, monkeypatch, cut, file):
    """It dies before the second file of this kind gets its name, or the first of those that are made last."""
    mine, late = share_of(moving, cut, 8), file in ("stack.grain.json", ".h5")
    if late:  # all pictures are there, and for recording all grain
        for spec in {*mine.specs, *(spec for s in moving.sequences for spec in s.time_stack.specs)}:
            shutil.copytree(made / "stacks" / spec.key, rest / "stacks" / spec.key, dirs_exist_ok=True)
        for note in rest.glob("stacks/*/stack.grain.json") if file == "stack.grain.json" else ():
            note.unlink()
    n = cut if not late else next(n for n in range(1, 9) if grain_of(made, moving) & share_of(moving, n, 8).specs)
    named, rename = [], Path.replace

    def die(old, new):
        named.extend([new] if new.name.endswith(file) else [])
        if len(named) == (1 if late else 2):
            raise Killed
        return rename(old, new)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", die)
        with pytest.raises(Killed):
            run_shard(recipe, rest, n)
    there = count_pieces(rest, mine)
    assert len(run_shard(recipe, rest, n).rendered) == 3 * len(mine.specs) - there
    assert generate(moving, rest, variant=VARIANT).rendered == []
    assert everything_in(rest) == everything_in(made)


def grain_of(folder, work):
    """The slices of the moving scene whose grain is measured."""
    stack = next(s.time_stack for s in work.sequences if s.time_stack.is_moving)
    return set(stacks_to_repeat(stack.specs, folder / "stacks"))


def test_a_shard_renders_only_what_is_missing_of_its_own_whatever_else_is_missing(made, moving, rest, cut):
    """Also if shards of another number have made a part of it, or it was stopped amid its slices."""
    mine = share_of(moving, cut, 8)
    assert to_render(moving, rest, (cut, 8)) == mine.specs
    for spec in list(mine.specs)[:1]:
        shutil.copytree(made / "stacks" / spec.key, rest / "stacks" / spec.key)
        assert to_render(moving, rest, (cut, 8)) == mine.specs - {spec}
    for n in set(range(1, 9)) - {cut}:
        assert to_render(moving, rest, (n, 8)) == frozenset()
    left = [to_render(moving, rest, (n, 3)) for n in (1, 2, 3)]
    assert sum(map(len, left)) == len(mine.specs) - 1
    assert frozenset().union(*left) == to_render(moving, rest, (1, 1)) == mine.specs - {spec}


def to_render(work, folder, part):
    plan = make_plan(replace(work, part=part), folder)
    return frozenset(spec for specs in plan.to_render.values() for spec in specs)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [("name: takes", "name: other", "holds the dataset 'takes' | 'other'"), ("seed: 3", "seed: 4", "")],
)
def test_a_shard_of_another_recipe_is_refused_and_a_changed_recipe_lists_nothing(
    recipe, made, tmp_path, old, new, words
):
    """Shards of the same recipe leave a list as it is."""
    folder = tmp_path / "takes"
    shutil.copytree(made, folder)
    before = (folder / "manifest.json").read_bytes()
    run_shard(recipe, folder, 8000, 8000)
    assert (folder / "manifest.json").read_bytes() == before
    recipe.write_text(recipe.read_text().replace(old, new))
    if words:
        assert_says(refusal(run_shard, recipe, folder, 8000, 8000), words)
        assert (folder / "manifest.json").read_bytes() == before
    else:
        assert run_shard(recipe, folder, 8000, 8000).manifest.sequences == ()


def test_an_empty_shard_says_so_and_no_command_takes_an_unfinished_array_for_a_dataset(call, recipe, made, tmp_path):
    folder = tmp_path / "new"
    code, out, err = call("generate", recipe, "--out", folder, "--shard", "99/99", "--keep-slices", "none")
    assert (code, err) == (0, "")
    assert "shard 99/99 has nothing to make" in out
    closing = f"saf-gen generate {recipe} --out {folder} --keep-slices none"
    assert f"next, once all 99 shards have ended: {closing}" in " ".join(out.split())
    for words in (("evaluate", folder, "--out", tmp_path / "e"), ("verify", folder)):
        code, _, err = call(*words)
        assert (code, err.count("\n")) == (2, 1)
        assert "no " in err
    assert make_plan(resolve_recipe(recipe), folder).to_render


def test_a_shard_that_cannot_write_says_so_in_one_line_and_nothing_is_made(recipe, made, tmp_path, call):
    (tmp_path / "file").write_text("in the way")
    for n in (1, 99):
        code, _, err = call("generate", recipe, "--out", tmp_path / "file/ds", "--shard", f"{n}/99")
        assert (code, err.count("\n"), "file/ds cannot be written" in err) == (2, 1, True)


# --- on separate disks --------------------------------------------------------------------------------


@pytest.fixture
def apart(recipe, made, moving, tmp_path):
    """What each of three shards has made in a folder of its own; one has recorded the still scene."""
    folders = [tmp_path / f"shard{n}" for n in (1, 2, 3)]
    for n, folder in enumerate(folders, start=1):
        run_shard(recipe, folder, 8000, 8000)
        for spec in share_of(moving, n, 3).specs:
            shutil.copytree(made / "stacks" / spec.key, folder / "stacks" / spec.key)
        share = share_of(moving, n, 3)
        if any(not stack.is_moving for stack in share.whole):
            shutil.copytree(made / "test", folder / "test", ignore=shutil.ignore_patterns("*dynamic*"))
        for spec in (spec for stack in share.cut for spec in stack.specs):
            (folder / "stacks" / spec.key / "stack.grain.json").unlink(missing_ok=True)
    return folders


def sources(folders):
    return [word for folder in folders for word in ("--from", folder)]


@pytest.mark.slow
def test_shards_on_separate_disks_become_the_dataset_of_one_process(call, recipe, made, moving, apart, tmp_path):
    """Only the grain of the cut stack is left to measure; a damaged picture is taken from nowhere."""
    before = [everything_in(folder) for folder in apart]
    code, out, err = call("generate", recipe, *sources(apart), "--out", tmp_path / "all", "--variant", VARIANT)
    assert code == 0, err
    assert "MB copied from 3 folders" in out
    assert "2 sequences recorded, 2 kept from before, 0 pieces of focal stacks rendered" in out
    assert everything_in(tmp_path / "all") == everything_in(made)
    assert [everything_in(folder) for folder in apart] == before
    code, out, err = call("generate", recipe, *sources(apart), "--out", tmp_path / "all", "--keep-slices", "none")
    assert (code, out.splitlines()[0]) == (0, "0 MB copied from 3 folders")
    assert "MB of time slices deleted" in out
    assert verify_dataset(tmp_path / "all") == (4, {})
    code, out, err = call(
        "generate", recipe, "--from", tmp_path / "all", "--out", tmp_path / "moved", "--keep-slices", "none"
    )
    assert code == 0, err
    assert "0 sequences recorded, 4 kept from before, 0 pieces of focal stacks rendered" in out


@pytest.mark.slow
def test_what_a_lost_or_damaged_shard_lacks_is_named_and_made(recipe, made, moving, apart, tmp_path, call):
    (spec,) = list(share_of(moving, 2, 3).specs)[:1]
    picture = apart[1] / "stacks" / spec.key / "lamp.exr"
    picture.write_bytes(picture.read_bytes()[:-7])
    code, out, err = call("generate", recipe, *sources(apart), "--out", apart[0], "--variant", VARIANT)
    assert code == 0, err
    assert "these stacks lack pictures, which are rendered here: plane, dynamic" in err
    assert "1 piece of focal stacks rendered" in out
    assert everything_in(apart[0]) == everything_in(made)


@pytest.mark.slow
def test_folders_that_are_no_shards_of_the_recipe_are_refused_before_anything_is_copied(recipe, apart, tmp_path, call):
    (tmp_path / "empty").mkdir()
    other = tmp_path / "changed.yaml"
    other.write_text(recipe.read_text().replace("seed: 3", "seed: 4"))
    foreign = tmp_path / "foreign.yaml"
    foreign.write_text(recipe.read_text().replace("name: takes", "name: foreign"))
    out = tmp_path / "all"
    for named, folders, message in [
        (recipe, [*apart, tmp_path / "empty"], "empty: has no manifest.json; allowed: a folder that a shard"),
        (recipe, [apart[0], tmp_path / "gone"], "gone: has no manifest.json"),
        (recipe, [apart[0], tmp_path / "changed.yaml"], "has no manifest.json"),
        (other, apart, "shard1: was made from another version of the recipe"),
        (foreign, apart, "shard1 holds the dataset 'takes', but the recipe makes 'foreign'"),
    ]:
        code, _, err = call("generate", named, *sources(folders), "--out", out)
        assert (code, err.count("\n")) == (2, 1)
        assert message in err
    for words in (["--shard", "1/2"], ["--split", "test"], ["--dry-run"]):
        code, _, err = call("generate", recipe, *sources(apart), *words, "--out", out)
        assert (code, err.count("\n"), "without --dry-run, --shard and --split" in err) == (2, 1, True)
    assert not out.exists()
    (tmp_path / "file").write_text("in the way")
    code, _, err = call("generate", recipe, *sources(apart), "--out", tmp_path / "file/ds")
    assert (code, err.count("\n"), "file/ds cannot be written" in err) == (2, 1, True)


# --- real processes -----------------------------------------------------------------------------------


def start(recipe, folder, *options):
    command = [sys.executable, "-m", "saf_gen", "generate", str(recipe), "--out", str(folder), "--variant", VARIANT]
    return subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    )


def count_rendered(process):
    out, _ = process.communicate(timeout=600)
    assert process.returncode == 0
    return int(re.search(r"(\d+) pieces of focal stacks rendered", out)[1])


@pytest.mark.long
@pytest.mark.parametrize("count", [3, 8])
def test_processes_started_one_after_the_other_render_each_piece_once_though_one_is_killed(
    recipe, made, moving, tmp_path, count
):
    """They start 3 s apart; the second is killed amid its slices, before the third starts, and run again."""
    folder, begun = tmp_path / "takes", []
    mine = share_of(moving, 2, count)
    for n in range(1, count + 1):
        begun.append(start(recipe, folder, "--shard", f"{n}/{count}"))
        deadline = time.monotonic() + (300 if n == 2 else 3)
        while time.monotonic() < deadline and not (n == 2 and count_pieces(folder, mine)):
            time.sleep(0.005)
        if n == 2:
            os.killpg(begun[1].pid, signal.SIGKILL)
            begun[1].communicate()
    there = count_pieces(folder, mine)
    assert 0 < there < 3 * len(mine.specs), "killed too late"
    rendered = [count_rendered(p) for n, p in enumerate(begun) if n != 1]
    rendered.append(there + count_rendered(start(recipe, folder, "--shard", f"2/{count}")))
    assert sum(rendered) == 3 * mine.all_specs
    assert count_rendered(start(recipe, folder)) == 0
    assert everything_in(folder) == everything_in(made)
    assert verify_dataset(folder) == (4, {})


def count_pieces(folder, share):
    return sum(3 - len(StackStore(folder / "stacks", spec).missing_pieces()) for spec in share.specs)
