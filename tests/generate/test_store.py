"""Generating into an object store: complete, and resumed from any moment, through a scratch folder on this machine."""

import hashlib
import json
import shutil
from dataclasses import replace

import pytest
from capture_dataset import VARIANT
from refusals import assert_says, refusal
from small_dataset import SCENES, SMALL_RECIPE

from saf_gen.core.object_store import StorePath
from saf_gen.errors import BadInput
from saf_gen.generate import plan as plan_module
from saf_gen.generate import store as store_module
from saf_gen.generate.plan import find_scratch, make_plan, split_into_batches
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate, run_plan
from saf_gen.generate.store import run_to_store
from saf_gen.stream.dataset import verify_dataset
from saf_gen.stream.manifest import read_manifest

NAMES = ["plane-constant-00", "plane-continuous-00", "plane-lamp_only-00"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The recipe and a local dataset of it, rendered once, and copied to where a run should find its work done."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.yaml").write_text(SMALL_RECIPE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SAF_GEN_SCENES", str(SCENES))
        result = generate(resolve_recipe(folder / "small.yaml"), folder / "local", variant=VARIANT)
    assert result.failed == {}
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch, test_scenes):
    """A working folder with the recipe."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(made / "small.yaml", tmp_path)
    return tmp_path


@pytest.fixture
def store(s3):
    """An empty folder in the store."""
    yield StorePath("s3", "data/sets/small")
    if s3.exists("data/sets"):
        s3.rm("data/sets", recursive=True)


@pytest.fixture
def work(here):
    return resolve_recipe(here / "small.yaml")


def fill_scratch(made, work, store):
    """Fill the scratch folder, as if an earlier run had made everything and uploaded nothing."""
    shutil.copytree(made / "local", find_scratch(work, store))


def run(work, store, **options):
    return run_to_store(make_plan(work, store), variant=VARIANT, **options)


@pytest.mark.slow
def test_a_dataset_in_a_store_is_the_one_on_a_disk_and_nothing_is_left_here(made, work, store, here, s3):
    reported = []
    result = run(work, store, report=lambda name, done: reported.append(name) if done >= 1 else None)
    assert (result.recorded, result.kept, result.failed) == (NAMES, [], {})
    assert result.manifest == read_manifest(store) == read_manifest(made / "local")
    assert verify_dataset(store) == (3, {})
    names = {path.relative_to(made / "local").as_posix() for path in (made / "local").rglob("*") if path.is_file()}
    assert {key.removeprefix("data/sets/small/") for key in s3.find("data/sets/small")} == names
    assert [path.name for path in here.rglob("*") if path.name != "datasets"] == ["small.yaml"]
    uploads = sorted(name for name in reported if name.startswith("upload"))
    assert uploads == [f"upload test/{name}.h5" for name in NAMES]


@pytest.mark.slow
def test_what_the_store_holds_is_neither_rendered_nor_recorded_nor_sent_again(made, work, store, s3, monkeypatch):
    """Eight files of stacks, three streams, and twice three cards are uploaded."""
    fill_scratch(made, work, store)
    sent, send = [], store_module.upload_file
    monkeypatch.setattr(store_module, "upload_file", lambda file, target: (sent.append(target), send(file, target)))
    first = run(work, store)
    assert len(sent) == 8 + 3 + 2 * 3
    before = s3.find("data/sets/small", detail=True)
    monkeypatch.setattr(store_module, "run_plan", lambda *args, **options: pytest.fail("something is made again"))
    again = run(work, store)
    assert (again.recorded, again.kept, again.manifest) == ([], NAMES, first.manifest)
    after = s3.find("data/sets/small", detail=True)
    assert {key: facts["ETag"] for key, facts in after.items()} == {k: facts["ETag"] for k, facts in before.items()}
    assert len(sent) == 8 + 3 + 2 * 3 + 3
    assert not find_scratch(work, store).exists()


@pytest.mark.slow
def test_a_lost_stream_and_a_lost_manifest_are_made_again_from_the_store(made, work, store, s3):
    fill_scratch(made, work, store)
    first = run(work, store)
    s3.rm_file(f"{store.key}/test/{NAMES[1]}.h5")
    s3.rm_file(f"{store.key}/manifest.json")
    again = run(work, store)
    assert (again.rendered, again.recorded, sorted(again.kept)) == ([], [NAMES[1]], [NAMES[0], NAMES[2]])
    assert again.manifest == first.manifest
    assert verify_dataset(store) == (3, {})


class Killed(BaseException):
    pass


@pytest.mark.slow
def test_a_run_stopped_at_any_upload_lists_only_complete_streams_and_resumes(made, work, store, s3, monkeypatch):
    """The run stops before (even step) or after (odd) one upload of eight files of stacks, three streams and six cards.

    The test of what is not sent again covers a run that stops after the last of them.
    """
    send, sent = store_module.upload_file, []
    whole = {file.name: hashlib.md5(file.read_bytes()).hexdigest() for file in (made / "local/test").iterdir()}
    monkeypatch.setattr(store_module, "TRANSFERS", 1)
    for steps in (7, 16, 24):
        fill_scratch(made, work, store)
        sent.clear()

        def stop(file, target, at=steps):
            if len(sent) == at // 2 and at % 2 == 0:
                raise Killed
            sent.append(target)
            send(file, target)
            if len(sent) == at // 2 + 1:
                raise Killed

        monkeypatch.setattr(store_module, "upload_file", stop)
        with pytest.raises(Killed):
            run(work, store)
        monkeypatch.setattr(store_module, "upload_file", send)
        if s3.exists(f"{store.key}/manifest.json"):
            assert verify_dataset(store)[1] == {}
        if steps % 4 == 3:
            shutil.rmtree(find_scratch(work, store), ignore_errors=True)
        result = run(work, store)
        assert result.failed == {}
        assert result.manifest.sequences == read_manifest(store).sequences == read_manifest(made / "local").sequences
        there = s3.find(f"{store.key}/test", detail=True)
        assert {key.rpartition("/")[2]: facts["ETag"].strip('"') for key, facts in there.items()} == whole
        assert not find_scratch(work, store).exists()
        s3.rm(store.key, recursive=True)


@pytest.mark.slow
def test_a_stream_of_another_recipe_is_not_listed_while_it_is_made_again(made, work, store, s3, monkeypatch):
    fill_scratch(made, work, store)
    run(work, store)
    s3.copy(f"{store.key}/test/{NAMES[0]}.h5", f"{store.key}/test/{NAMES[1]}.h5")
    text = json.loads(s3.cat_file(f"{store.key}/manifest.json"))
    text.pop("checksum")
    text["sequences"][1]["fingerprint"] = "of another recipe"
    s3.pipe_file(f"{store.key}/manifest.json", json.dumps(text).encode())

    def look(*args, **options):
        assert [entry.id for entry in read_manifest(store).sequences] == [NAMES[0], NAMES[2]]
        return run_plan(*args, **options)

    monkeypatch.setattr(store_module, "run_plan", look)
    assert run(work, store).recorded == [NAMES[1]]
    assert verify_dataset(store) == (3, {})


@pytest.mark.slow
def test_shards_of_whole_stacks_make_the_dataset_in_a_store(made, here, store, call):
    """The only stack and its recordings are of the first shard; the second has nothing to make, and says so."""
    for part, count in ((1, 3), (2, 0)):
        shard = make_plan(resolve_recipe(here / "small.yaml", part=(part, 2)), store)
        assert len(shard.sequences) == count
        if count:
            fill_scratch(made, shard.resolved, store)
        result = run_to_store(shard, variant=VARIANT)
    assert [entry.id for entry in result.manifest.sequences] == NAMES
    assert verify_dataset(store) == (3, {})


def test_batches_hold_complete_stacks_up_to_a_size(work, monkeypatch):
    sequences = list(work.sequences)
    assert split_into_batches(sequences) == [sequences]
    other = [replace(s, time_stack=replace(s.time_stack, slice_frames=(0, 8)), scene=None) for s in sequences]
    assert split_into_batches([*sequences, *other]) == [[*sequences, *other]]  # the same pictures
    specs = [replace(spec, samples=99) for spec in sequences[0].time_stack.specs]
    apart = [replace(s, time_stack=replace(s.time_stack, specs=tuple(specs))) for s in sequences]
    mixed = [one for pair in zip(sequences, apart, strict=True) for one in pair]
    monkeypatch.setattr(plan_module, "BATCH_BYTES", 1)
    assert split_into_batches(mixed) == [sequences, apart]
    assert split_into_batches([]) == []


def test_a_dry_run_lists_the_uploads_and_writes_nothing(made, work, store, here, s3, call):
    code, out, err = call("generate", "small.yaml", "--out", str(store), "--dry-run")
    assert code == 0, err
    assert "3 sequences in s3://data/sets/small" in out
    assert "to upload to s3://data/sets/small: about 0.00 GB" in out
    assert "scratch: at most about 0.00 GB in datasets/.s3-data%2Fsets%2Fsmall" in err
    assert "focal stacks to render: plane" in out
    assert (s3.exists(store.key), [path.name for path in here.iterdir()]) == (False, ["small.yaml"])
    fill_scratch(made, work, store)
    run(work, store)
    code, out, err = call("generate", "small.yaml", "--out", str(store), "--dry-run")
    assert (code, out.count(" yes ") + out.count(" yes\n"), "scratch" in err) == (0, 3, False)
    assert "focal stacks to render: none, all exist" in out


def test_bad_stores_are_refused_before_anything_is_made(work, store, here, s3, call, monkeypatch):
    code, _, err = call("generate", "small.yaml", "--out", "s3://none/small")
    assert (code, err.count("\n")) == (2, 1)
    assert "there is no bucket 'none'" in err
    s3.pipe_file(store.key, b"an object")
    assert_says(refusal(run, work, store), "s3://data/sets/small: this is an object | a folder")
    s3.rm_file(store.key)

    def refuse(key, data):
        raise PermissionError(13, "Access Denied")

    with monkeypatch.context() as patch:
        patch.setattr(s3, "pipe_file", refuse)
        assert_says(refusal(run, work, store), "the store refuses: Access Denied")
    s3.pipe_file(f"{store.key}/manifest.json", b"{}")
    assert_says(refusal(run, work, store), "s3://data/sets/small/manifest.json | is not the manifest of a dataset")
    assert [path.name for path in here.iterdir()] == ["small.yaml"]


@pytest.mark.slow
def test_a_store_that_fails_later_ends_the_run_in_one_line(made, work, store, monkeypatch):
    fill_scratch(made, work, store)
    send = store_module.upload_file

    def fail(file, target):
        if file.suffix == ".h5":
            raise BadInput("the store does not answer", where=str(target))
        send(file, target)

    with monkeypatch.context() as patch:
        patch.setattr(store_module, "upload_file", fail)
        assert_says(refusal(run, work, store), "s3://data/sets/small/test/ | does not answer")
