"""Published datasets: what is fetched is the dataset folder, and nothing else is ever accepted."""

import json
import shutil
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from folder_server import serve
from refusals import assert_says, refusal

import saf_gen
from saf_gen.errors import BadInput
from saf_gen.stream.dataset import index_folder, verify_dataset
from saf_gen.stream.manifest import TABLE_NAME, Manifest, PublishedFile, read_manifest, write_manifest
from saf_gen.stream.sharing import fetch_dataset
from saf_gen.stream.sharing.fetching import check_fetchable, is_plain_path

STREAMS = ("train/a-constant-00", "train/a-constant-01", "train/b-constant-00", "test/c-constant-00")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Four small streams in two splits, a card, and a file of a focal stack. Do not change it."""
    folder = tmp_path_factory.mktemp("sharing") / "mine"
    rng = np.random.default_rng(3)
    for name in STREAMS:
        saf_gen.write_stream(folder / f"{name}.h5", rng.integers(0, 2, (200, 24, 32), dtype=np.uint8))
    (folder / "stacks/scene").mkdir(parents=True)
    (folder / "stacks/scene/lamp.exr").write_bytes(bytes(range(256)))
    (folder / "README.md").write_text("# Mine\n")
    index_folder(folder)
    return folder


@pytest.fixture
def copy(dataset, tmp_path):
    """A copy of the dataset that a test may change."""
    return Path(shutil.copytree(dataset, tmp_path / "copy"))


def files_of(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def streams_of(folder):
    return {name: content for name, content in files_of(folder).items() if name.endswith(".h5")}


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr("time.sleep", lambda seconds: None)


def fetch(folder, out, **options):
    """Fetch a folder from a server."""
    with serve(folder) as (_, address):
        return fetch_dataset(address, out, **options)


@pytest.mark.slow
def test_what_is_fetched_is_the_dataset_without_its_stacks(dataset, tmp_path):
    seen = []
    folder, manifest = fetch(dataset, tmp_path / "again", report=lambda *step: seen.append(step))
    assert files_of(folder) == {name: held for name, held in files_of(dataset).items() if "stacks" not in name}
    assert verify_dataset(folder) == (4, {})
    total = sum(len(content) for content in streams_of(dataset).values())
    assert seen[-1] == (total, total)
    assert sorted(one.file for one in manifest.files) == sorted(f"{name}.h5" for name in STREAMS)
    assert (folder / TABLE_NAME).read_text().startswith("id,split,scene,")


@pytest.mark.slow
def test_a_file_that_breaks_off_is_fetched_again(dataset, tmp_path):
    lines = []
    with serve(dataset, breaks={STREAM: 2}) as (server, address):
        folder, _ = fetch_dataset(f"{address}/manifest.json", tmp_path / "again", tell=lines.append)
    assert streams_of(folder) == streams_of(dataset)
    assert server.requests.count("test/c-constant-00.h5") == 3
    assert all("trying again in " in line for line in lines)


@pytest.mark.slow
def test_what_was_fetched_before_a_stop_is_not_fetched_again(dataset, tmp_path):
    """The server always breaks off one file: the folder is no dataset yet, and the other files are kept."""
    broken = pytest.raises(BadInput, match=r"b-constant-00\.h5: cannot be fetched: .*run the same command again")
    with serve(dataset, breaks={"train/b-constant-00.h5": 99}) as (_, address), broken:
        fetch_dataset(address, tmp_path / "again")
    assert not (tmp_path / "again/manifest.json").exists()
    kept = set(streams_of(tmp_path / "again"))
    assert kept
    with serve(dataset) as (server, address):
        folder, _ = fetch_dataset(address, tmp_path / "again")
    assert streams_of(folder) == streams_of(dataset)
    assert kept.isdisjoint(server.requests)
    assert sum(name.endswith(".h5") for name in server.requests) == 4 - len(kept)
    assert not (folder / ".fetch").exists()


@pytest.mark.slow
def test_a_stream_that_was_changed_here_is_fetched_again(dataset, tmp_path):
    folder, _ = fetch(dataset, tmp_path / "again")
    (folder / "test/c-constant-00.h5").write_bytes(b"x")
    fetch(dataset, folder)
    assert streams_of(folder) == streams_of(dataset)


def edit(folder, change):
    """Change the manifest of a folder, as somebody who writes a right checksum."""
    path = folder / "manifest.json"
    document = json.loads(path.read_text())
    del document["checksum"]
    change(document)
    path.write_text(json.dumps(document))


def rename(name):
    """Give a stream another name in the manifest, in both lists."""

    def change(document):
        old = document["files"][0]["file"]
        document["files"][0]["file"] = name
        next(one for one in document["sequences"] if one["file"] == old)["file"] = name

    return lambda folder: edit(folder, change)


def set_key(key, value):
    return lambda folder: edit(folder, lambda document: document.update({key: value}))


def flip_a_bit(folder):
    path = folder / "test/c-constant-00.h5"
    content = bytearray(path.read_bytes())
    content[2000] ^= 1
    path.write_bytes(content)


def lengthen(folder):
    path = folder / "test/c-constant-00.h5"
    path.write_bytes(path.read_bytes() + bytes(5_000_000))


STREAM = "test/c-constant-00.h5"
DAMAGED = {
    "a flipped bit": (flip_a_bit, r"c-constant-00\.h5: has the SHA-256"),
    "a file cut short": (lambda f: (f / STREAM).write_bytes(b"x"), r"broke off after 1 of"),
    "a file that is longer": (lengthen, r"has more than the [\d,]+ bytes that the manifest states"),
    "a file that is missing": (lambda f: (f / STREAM).unlink(), r"cannot be fetched: HTTP 404"),
    "another manifest": (lambda f: (f / "manifest.json").write_text("{}"), "is not the manifest of a dataset"),
    "no manifest": (lambda f: (f / "manifest.json").unlink(), r"manifest\.json: cannot be fetched: HTTP 404"),
    "no JSON": (lambda f: (f / "manifest.json").write_text("x"), "this is not JSON"),
    "a newer layout": (set_key("layout", 2), r"has layout 2; allowed: layout 1; update saf_gen"),
    "an unknown key": (set_key("shard", []), "shard"),
    "no digests": (set_key("files", []), r"does not list size and SHA-256 of"),
    "a file of no sequence": (
        lambda f: edit(f, lambda d: d["files"].append({**d["files"][0], "file": "evil.py"})),
        r"does not list as a sequence 'evil\.py'",
    ),
    "a size that no number of this machine holds": (
        lambda f: edit(f, lambda d: d["files"][0].update(bytes=10**400)), r"files\.0\.bytes is 1000",
    ),
    "a digest that is a path": (lambda f: edit(f, lambda d: d["files"][0].update(sha256="../x")), r"files\.0\.sha256"),
    "a name of a dataset that is a path": (set_key("name", "../mine"), r"the dataset's name is '\.\./mine'"),
    "a name of a dataset that is a device": (set_key("name", "NUL"), r"the dataset's name is 'NUL'"),
    "a path upwards": (rename("../../outside.h5"), "a relative path inside the dataset folder"),
    "an absolute path": (rename("/tmp/outside.h5"), "a relative path inside the dataset folder"),
    "a path of Windows": (rename("test\\x.h5"), "a relative path inside the dataset folder"),
    "a hidden file": (rename("test/.ssh"), r"has the file 'test/\.ssh'"),
    "a device": (rename("test/con.h5"), r"has the file 'test/con\.h5'"),
    "a name in two cases": (rename("train/A-constant-00.h5"), "each file once, on every system"),
    "a second manifest": (rename("Manifest.json"), "names 'Manifest.json' and 'manifest.json'"),
    "a file beside a folder of its name": (rename("TRAIN"), "has the file 'TRAIN' and the file 'train/"),
}  # fmt: skip


@pytest.mark.parametrize(("damage", "message"), DAMAGED.values(), ids=DAMAGED)
def test_tampered_data_are_refused_and_no_dataset_is_left(dataset, copy, tmp_path, damage, message):
    before = {p for p in tmp_path.rglob("*") if p.is_relative_to(copy)}
    damage(copy)
    with pytest.raises(BadInput, match=message) as refused:
        fetch(copy, tmp_path / "again")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "again/manifest.json").exists()
    assert streams_of(tmp_path / "again").items() <= streams_of(dataset).items(), "only correct streams may stay"
    written = {p for p in tmp_path.rglob("*")} - before
    assert all(p == tmp_path / "again" or p.is_relative_to(tmp_path / "again") for p in written)


@pytest.mark.parametrize(
    "name",
    ["nul", "CON.h5", "a/aux.tar.gz", "Prn", "com1", "LPT9.h5", "com²", "conin$", "nul .h5", "a.", "a /b", ".a",
     "a/../b", "a//b", "./a", "", "a\x7f", "a:b", "/a", "a/"],
)  # fmt: skip
def test_names_that_mean_something_else_elsewhere_are_not_plain(name):
    assert not is_plain_path(name)


@pytest.mark.parametrize("name", ["a", "a b/c.h5", "console.h5", "com10", "naïve/Ä.h5", "auxiliary", "a-con.h5"])
def test_other_names_are(name):
    assert is_plain_path(name)


def test_two_forms_of_one_accented_name_are_one_file(dataset):
    entry = read_manifest(dataset).sequences[0]
    names = ("test/\u00e9.h5", "test/e\u0301.h5")
    listed = Manifest(
        "mine", "", "recorded",
        tuple(type(entry)(**{**vars(entry), "id": str(n), "file": name}) for n, name in enumerate(names)),
        tuple(PublishedFile(name, 1, "0" * 64) for name in names),
    )  # fmt: skip
    assert_says(refusal(check_fetchable, listed, "there"), "each file once, on every system")


def test_a_link_is_not_published(copy, tmp_path, call):
    """The target of a link, or of a linked folder, is not what its owner put into the dataset."""
    shutil.move(copy / STREAM, tmp_path / "target.h5")
    (copy / STREAM).symlink_to(tmp_path / "target.h5")
    shutil.move(copy / "train", tmp_path / "train")
    (copy / "train").symlink_to(tmp_path / "train")
    write_manifest(copy, read_manifest(copy))
    assert read_manifest(copy).files == ()
    code, out, err = call("verify", copy)
    assert (code, out) == (0, "4 of 4 sequences are intact\n")
    assert err.startswith("warning: others could not fetch it: ")
    assert_says(refusal(fetch, copy, tmp_path / "again"), "does not list size and SHA-256 of | no links")
    assert not (tmp_path / "again").exists()


def test_verify_names_a_file_whose_bytes_are_not_those_of_the_manifest(copy, call):
    """Its content is the same, but whoever fetches it would refuse it."""
    assert call("verify", copy) == (0, "4 of 4 sequences are intact\n", "")
    (copy / STREAM).write_bytes((copy / STREAM).read_bytes() + b"x")
    code, out, err = call("verify", copy)
    assert (code, out) == (0, "4 of 4 sequences are intact\n")
    assert err.startswith("warning: others could not fetch it: ")
    assert f"{STREAM}: is a link, or has other bytes than its manifest states" in err


@pytest.mark.parametrize("what", ["test", ".fetch"])
def test_a_folder_inside_that_leads_elsewhere_is_not_written_through(dataset, tmp_path, what):
    (tmp_path / "again/.fetch").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    if what == ".fetch":
        (tmp_path / "again/.fetch").rmdir()
    (tmp_path / "again" / what).symlink_to(tmp_path / "elsewhere")
    assert_says(refusal(fetch, dataset, tmp_path / "again"), "is a symbolic link")
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_link_in_the_place_of_a_stream_is_replaced_and_not_followed(dataset, tmp_path):
    (tmp_path / "again/.fetch").mkdir(parents=True)
    (tmp_path / "again/test").mkdir()
    shutil.copy(dataset / STREAM, tmp_path / "held.h5")
    (tmp_path / "again" / STREAM).symlink_to(tmp_path / "held.h5")
    folder, _ = fetch(dataset, tmp_path / "again")
    assert not (folder / STREAM).is_symlink()
    assert (tmp_path / "held.h5").read_bytes() == (dataset / STREAM).read_bytes()


def test_nothing_is_fetched_over_other_files_or_to_a_disk_that_is_too_small(dataset, tmp_path, monkeypatch):
    (tmp_path / "README.md").write_text("mine")
    assert_says(refusal(fetch, dataset, tmp_path), "holds other files; give a folder that is empty or new")
    (tmp_path / "manifest.json").write_text("{}")
    assert_says(refusal(fetch, dataset, tmp_path), "holds another dataset")
    assert files_of(tmp_path) == {"README.md": b"mine", "manifest.json": b"{}"}
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(1, 1, 0))
    error = refusal(fetch, dataset, tmp_path / "again")
    assert_says(error, "the dataset needs 0 MB in | , but only 0 MB are free")
    assert not (tmp_path / "again").exists()


def test_an_address_or_a_digest_that_does_not_fit_is_one_line(dataset, tmp_path):
    digest = sha256((dataset / "manifest.json").read_bytes()).hexdigest()
    refused = refusal(fetch, dataset, tmp_path / "again", manifest_sha256="00")
    assert_says(refused, f"has the SHA-256 {digest}; allowed: 00")
    for address, says in {
        "https://example.org/x/manifest.json?signature=1": "has a query | an address without '?'",
        "ftp://example.org/x": "cannot be fetched | an http or https address",
        str(dataset): "cannot be fetched | an http or https address; copy a dataset that is on a disk as a folder",
    }.items():
        assert_says(refusal(fetch_dataset, address, tmp_path / "again"), says)
    assert not (tmp_path / "again").exists()


def test_the_command_prints_the_next_step(call, dataset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    digest = sha256((dataset / "manifest.json").read_bytes()).hexdigest().upper()
    with serve(dataset) as (_, address):
        code, out, err = call("fetch", address, "--sha256", digest)
    assert (code, err) == (0, "")
    assert "4 files, " in out
    assert f"dataset: {Path('datasets/mine')}   (next: saf-gen evaluate datasets/mine)\n" in out


@pytest.mark.slow
def test_a_card_is_bounded_and_may_be_missing(copy, tmp_path):
    (copy / "croissant.json").write_bytes(bytes(5_000_000))
    assert_says(refusal(fetch, copy, tmp_path / "again"), "croissant.json: cannot be fetched | more than 4,194,304")
    (copy / "croissant.json").unlink()
    fetch(copy, tmp_path / "again")


def test_an_address_where_nothing_is_says_so(dataset, tmp_path):
    with (
        serve(dataset) as (_, address),
        pytest.raises(BadInput, match=r"nothing/manifest\.json: cannot be fetched: .*check the address"),
    ):
        fetch_dataset(f"{address}/nothing", tmp_path / "again")
    with pytest.raises(BadInput, match="cannot be fetched: .*run the same command again"):
        fetch_dataset(address, tmp_path / "again")


def test_a_table_of_somebody_else_is_not_replaced(copy):
    (copy / TABLE_NAME).write_text("mine,too\n")
    assert_says(refusal(write_manifest, copy, read_manifest(copy)), "sequences.csv exists, and saf-gen did not write")
    assert (copy / TABLE_NAME).read_text() == "mine,too\n"
