"""Packed datasets: a fetched dataset equals the packed one, and nothing else is ever accepted."""

import io
import json
import os
import shutil
import tarfile
import threading
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from hashlib import sha256
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from refusals import assert_says, refusal

import saf_gen
from saf_gen.errors import BadInput
from saf_gen.stream.dataset import index_folder, verify_dataset
from saf_gen.stream.manifest import read_manifest, write_manifest
from saf_gen.stream.sharing import fetch_dataset, pack_dataset, server

LICENCE = ("CC-BY-4.0",)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Four small streams in two splits, and a file of a focal stack. Do not change it."""
    folder = tmp_path_factory.mktemp("sharing") / "mine"
    rng = np.random.default_rng(3)
    for name in ("train/a-constant-00", "train/a-constant-01", "train/b-constant-00", "test/c-constant-00"):
        saf_gen.write_stream(folder / f"{name}.h5", rng.integers(0, 2, (200, 24, 32), dtype=np.uint8))
    (folder / "stacks/scene").mkdir(parents=True)
    (folder / "stacks/scene/lamp.exr").write_bytes(bytes(range(256)))
    index_folder(folder)
    return folder


@pytest.fixture(scope="module")
def packed(dataset, tmp_path_factory):
    """The packed dataset with one shard per stream. Do not change it."""
    folder = tmp_path_factory.mktemp("packed") / "out"
    pack_dataset(dataset, folder, shard_bytes=1, licences=LICENCE)
    return folder


@pytest.fixture
def copy(packed, tmp_path):
    """A copy of the packed dataset that a test may change."""
    return Path(shutil.copytree(packed, tmp_path / "copy"))


def files_of(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def streams_of(folder):
    return {name: content for name, content in files_of(folder).items() if name.endswith(".h5")}


class Handler(SimpleHTTPRequestHandler):
    """A server that serves ranges if ``ranges`` is true, and breaks off its first responses as ``breaks`` states."""

    def log_message(self, *_):
        pass

    def do_GET(self):
        path = Path(self.directory) / self.path.strip("/")
        if not path.is_file():
            self.send_error(404)
            return
        wanted = self.headers.get("Range", "")
        self.server.requests.append((path.name, wanted))
        content = path.read_bytes()
        start = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted and self.server.ranges else 0
        self.send_response(206 if start else 200)
        if start:
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        broken = self.server.breaks.get(path.name, 0) > 0
        self.server.breaks[path.name] = self.server.breaks.get(path.name, 0) - 1
        self.wfile.write(content[start : start + 1000] if broken else content[start:])


@contextmanager
def serve(folder, *, ranges=True, breaks=None):
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder))) as server:
        server.requests, server.ranges, server.breaks = [], ranges, dict(breaks or {})
        threading.Thread(target=partial(server.serve_forever, 0.01), daemon=True).start()
        try:
            yield server, f"http://127.0.0.1:{server.server_address[1]}"
        finally:
            server.shutdown()


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr(server, "WAIT_S", 0.0)


def test_what_is_fetched_is_what_was_packed(dataset, packed, tmp_path):
    seen = []
    folder, index = fetch_dataset(str(packed), tmp_path / "again", report=lambda *step: seen.append(step))
    assert streams_of(folder) == streams_of(dataset)
    assert (folder / "manifest.json").read_bytes() == (dataset / "manifest.json").read_bytes()
    assert verify_dataset(folder) == (4, {})
    assert seen[-1] == (index.total_bytes, index.total_bytes)
    assert sorted(p.name for p in folder.iterdir()) == ["README.md", "croissant.json", "manifest.json", "test", "train"]


def test_the_same_dataset_gives_the_same_bytes(dataset, packed, tmp_path):
    again = pack_dataset(dataset, tmp_path / "again", shard_bytes=1, licences=LICENCE)
    assert files_of(tmp_path / "again") == files_of(packed)
    assert again.index_sha256 == sha256((packed / "index.json").read_bytes()).hexdigest()
    assert again.missing == ("url", "creator")


def test_a_shard_holds_whole_streams_of_one_split(dataset, packed, tmp_path):
    assert sorted(p.name for p in packed.glob("*.tar")) == [
        *("test-00000.tar", "train-00000.tar", "train-00001.tar", "train-00002.tar")
    ]
    index = pack_dataset(dataset, tmp_path / "large", licences=LICENCE).index
    held = {shard.file: [member.file for member in shard.members] for shard in index.shards}
    assert held == {
        "test-00000.tar": ["test/c-constant-00.h5"],
        "train-00000.tar": ["train/a-constant-00.h5", "train/a-constant-01.h5", "train/b-constant-00.h5"],
    }
    with tarfile.open(tmp_path / "large/train-00000.tar") as tar:
        assert {(one.uid, one.mtime, one.uname) for one in tar} == {(0, 0, "")}


def test_focal_stacks_are_packed_when_asked_for(dataset, tmp_path):
    pack_dataset(dataset, tmp_path / "packed", stacks=True, licences=LICENCE)
    folder, _ = fetch_dataset(str(tmp_path / "packed"), tmp_path / "again")
    assert (folder / "stacks/scene/lamp.exr").read_bytes() == bytes(range(256))


@pytest.mark.parametrize("ranges", [True, False])
def test_a_download_that_breaks_off_goes_on(dataset, packed, tmp_path, ranges):
    """With ranges it resumes where it stopped; a server without ranges sends everything again."""
    with serve(packed, ranges=ranges, breaks={"test-00000.tar": 2 if ranges else 1}) as (server, address):
        folder, _ = fetch_dataset(f"{address}/index.json", tmp_path / "again")
    assert streams_of(folder) == streams_of(dataset)
    wanted = [span for name, span in server.requests if name == "test-00000.tar"]
    assert wanted == (["", "bytes=1000-", "bytes=2000-"] if ranges else ["", "bytes=1000-"])


def test_what_was_fetched_before_a_stop_is_not_fetched_again(dataset, packed, tmp_path):
    """The server always breaks off one shard: the folder is no dataset yet, and the other shards are kept."""
    broken = pytest.raises(
        BadInput, match=r"train-00001\.tar: cannot be fetched: .*run the same command again to continue"
    )
    with serve(packed, ranges=False, breaks={"train-00001.tar": 99}) as (_, address), broken:
        fetch_dataset(address, tmp_path / "again")
    assert not (tmp_path / "again/manifest.json").exists()
    kept = set(streams_of(tmp_path / "again"))
    assert len(kept) in (1, 2)
    with serve(packed) as (server, address):
        folder, _ = fetch_dataset(address, tmp_path / "again")
    assert streams_of(folder) == streams_of(dataset)
    names = [name for name, _ in server.requests if name.endswith(".tar")]
    assert len(names) == 4 - len(kept)
    assert dict(server.requests)["train-00001.tar"] == "bytes=1000-"


def test_a_server_that_sends_more_than_the_index_says_is_stopped(copy, tmp_path):
    path = copy / "test-00000.tar"
    path.write_bytes(path.read_bytes() + bytes(5_000_000))
    with (
        serve(copy) as (_, address),
        pytest.raises(BadInput, match=r"has more than the [\d,]+ bytes that the index states"),
    ):
        fetch_dataset(address, tmp_path / "again")
    assert not streams_of(tmp_path / "again").keys() & {"test/c-constant-00.h5"}


def edit_index(folder, change):
    path = folder / "index.json"
    index = json.loads(path.read_text())
    change(index)
    path.write_text(json.dumps(index))


def write_tar(folder, *infos):
    """Replace the test split's shard by another tar, and update its digest in the index."""
    path = folder / "test-00000.tar"
    with tarfile.open(path, "w") as tar:
        for info, content in infos:
            info.size = len(content)
            tar.addfile(info, io.BytesIO(content))

    def update_shard(index):
        shard = next(s for s in index["shards"] if s["file"] == path.name)
        shard |= {"bytes": path.stat().st_size, "sha256": sha256(path.read_bytes()).hexdigest()}

    edit_index(folder, update_shard)


def flip_a_bit(folder):
    path = folder / "test-00000.tar"
    content = bytearray(path.read_bytes())
    content[2000] ^= 1
    path.write_bytes(content)


def link(name, target):
    info = tarfile.TarInfo(name)
    info.type, info.linkname = tarfile.SYMTYPE, target
    return info


def set_member(name):
    def change(index):
        index["shards"][0]["members"][0]["file"] = name

    return lambda folder: edit_index(folder, change)


def set_key(key, value):
    return lambda folder: edit_index(folder, lambda index: index.update({key: value}))


DAMAGED = {
    "a flipped bit": (flip_a_bit, r"test-00000\.tar: has the SHA-256"),
    "a shard cut short": (lambda f: (f / "test-00000.tar").write_bytes(b"x"), r"has 1 bytes; allowed: "),
    "a shard that is missing": (lambda f: (f / "test-00000.tar").unlink(), r"has 0 bytes; allowed: "),
    "a changed manifest": (lambda f: (f / "manifest.json").write_text("{}"), r"manifest\.json: has 2 bytes"),
    "a path upwards": (set_member("../../outside.h5"), r"has the member '\.\./\.\./outside\.h5'"),
    "an absolute path": (set_member("/tmp/outside.h5"), r"has the member '/tmp/outside\.h5'"),
    "a hidden file": (set_member("test/.ssh"), r"has the member 'test/\.ssh'"),
    "a path of Windows": (set_member("test\\x.h5"), r"has the member"),
    "a name twice": (set_member("train/a-constant-00.h5"), r"names 'train/a-constant-00\.h5' 2 times"),
    "the manifest in a shard": (set_member("Manifest.json"), r"names 'manifest\.json' 2 times"),
    "a dataset's name that is a path": (set_key("name", "../mine"), r"the dataset's name is '\.\./mine'"),
    "a newer layout": (set_key("layout", 2), r"has layout 2; allowed: layout 1; update saf_gen"),
    "another format": (set_key("format", "x"), "is not the index of a packed dataset"),
    "an unknown key": (set_key("shard", []), "shard"),
    "a size that no number of this machine holds": (
        lambda f: edit_index(f, lambda index: index["shards"][0].update(bytes=10**400)),
        r"shards\.0\.bytes is 1000",
    ),
    "no manifest": (set_key("files", []), r"has no manifest\.json"),
    "no index": (lambda f: (f / "index.json").unlink(), "holds no packed dataset"),
    "no JSON": (lambda f: (f / "index.json").write_text("x"), "this is not JSON"),
    "a link in a shard": (
        lambda f: write_tar(f, (link("test/c-constant-00.h5", "/etc/passwd"), b"")),
        "holds 'test/c-constant-00.h5', which does not match the index",
    ),
    "a file that the index lacks": (
        lambda f: write_tar(f, (tarfile.TarInfo("../evil.py"), b"x")),
        r"holds '\.\./evil\.py', which does not match the index",
    ),
    "a shard without its file": (lambda f: write_tar(f), "lacks 'test/c-constant-00.h5'"),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGED.values(), ids=DAMAGED)
def test_tampered_data_are_refused_and_no_dataset_is_left(dataset, copy, tmp_path, damage, message):
    before = {p for p in tmp_path.rglob("*") if p.is_relative_to(copy)}
    damage(copy)
    with pytest.raises(BadInput, match=message) as refused:
        fetch_dataset(str(copy), tmp_path / "again")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "again/manifest.json").exists()
    assert streams_of(tmp_path / "again").items() <= streams_of(dataset).items(), "only correct streams may stay"
    written = {p for p in tmp_path.rglob("*")} - before
    assert all(p == tmp_path / "again" or p.is_relative_to(tmp_path / "again") for p in written)


def test_content_that_is_not_the_indexed_one_is_refused_though_its_shard_is_right(copy, tmp_path):
    with tarfile.open(copy / "test-00000.tar") as tar:
        (info,) = tar.getmembers()
    write_tar(copy, (tarfile.TarInfo(info.name), bytes(info.size)))
    with pytest.raises(BadInput, match=r"test-00000\.tar: test/c-constant-00\.h5: differs from the index"):
        fetch_dataset(str(copy), tmp_path / "again")
    assert not (tmp_path / "again/test/c-constant-00.h5").exists()


def test_a_folder_inside_that_leads_elsewhere_is_not_written_through(packed, tmp_path):
    (tmp_path / "again/.fetch").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "again/test").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BadInput, match="leads out of"):
        fetch_dataset(str(packed), tmp_path / "again")
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_an_index_without_an_end_is_not_read(copy, tmp_path, kind):
    index = copy / "index.json"
    index.unlink()
    if kind == "pipe":
        os.mkfifo(index)
    else:
        index.symlink_to("/dev/zero")
    with pytest.raises(BadInput, match=r"index\.json is not a file on a disk"):
        fetch_dataset(str(copy), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_nothing_is_fetched_over_other_files_or_to_a_disk_that_is_too_small(packed, tmp_path, monkeypatch):
    (tmp_path / "README.md").write_text("mine")
    assert_says(refusal(fetch_dataset, str(packed), tmp_path), "holds other files; give a folder that is empty or new")
    (tmp_path / "manifest.json").write_text("{}")
    assert_says(refusal(fetch_dataset, str(packed), tmp_path), "holds another dataset")
    assert files_of(tmp_path) == {"README.md": b"mine", "manifest.json": b"{}"}
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(1, 1, 0))
    error = refusal(fetch_dataset, str(packed), tmp_path / "again")
    assert_says(error, "the dataset needs 0 MB in | , but only 0 MB are free")
    assert not (tmp_path / "again").exists()


def test_an_address_or_a_digest_that_does_not_fit_is_one_line(packed, tmp_path):
    def fetch(address, **options):
        return refusal(fetch_dataset, address, tmp_path / "again", **options)

    digest = sha256((packed / "index.json").read_bytes()).hexdigest()
    assert_says(fetch(str(packed), index_sha256="00"), f"has the SHA-256 {digest}; allowed: 00")
    assert_says(fetch("https://example.org/x/index.json?signature=1"), "has a query | an address without '?'")
    assert not (tmp_path / "again").exists()


def test_a_dataset_that_is_damaged_or_has_no_licence_is_not_packed(dataset, packed, tmp_path):
    def pack(folder, out=tmp_path / "out", licences=LICENCE):
        return refusal(pack_dataset, folder, out, licences=licences)

    assert_says(pack(dataset, licences=()), "the licence of | is not stated; state one with --licence NAME")
    assert_says(pack(dataset, licences=["my own"]), "licence 'my own' is not an SPDX name")
    assert_says(pack(dataset, packed), "already holds this dataset, completely packed")
    assert_says(pack(dataset, dataset), "is not empty")
    damaged = tmp_path / "damaged"
    shutil.copytree(dataset, damaged)
    shutil.copy(damaged / "train/a-constant-00.h5", damaged / "test/c-constant-00.h5")
    assert_says(pack(damaged), "c-constant-00.h5: holds 200 frames with the SHA-256")
    manifest = read_manifest(damaged)
    for split in ("a/b", ".hidden"):
        write_manifest(damaged, replace(manifest, sequences=(replace(manifest.sequences[0], split=split),)))
        assert_says(pack(damaged), f"split '{split}' cannot begin the name of a file")
    assert not (tmp_path / "out").exists()


def test_packing_that_was_stopped_leaves_no_folder_and_starts_again(dataset, packed, tmp_path, monkeypatch):
    def stop(*step):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pack_dataset(dataset, tmp_path / "out", shard_bytes=1, licences=LICENCE, report=stop)
    assert not list(tmp_path.iterdir())
    pack_dataset(dataset, tmp_path / "out", shard_bytes=1, licences=LICENCE)
    assert files_of(tmp_path / "out") == files_of(packed)
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_the_commands_print_the_digest_and_the_next_step(call, dataset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = call("pack", dataset, "--out", "packed", "--licence", "CC-BY-4.0", "--url", "https://example.org")
    digest = sha256((tmp_path / "packed/index.json").read_bytes()).hexdigest().upper()
    assert (code, err) == (0, "its card has no creator; add --creator\n")
    assert f"next: saf-gen fetch packed --sha256 {digest.lower()}\n" in out
    code, out, err = call("fetch", "packed", "--sha256", digest)
    assert (code, err) == (0, "")
    assert "4 files, " in out
    assert f"dataset: {Path('datasets/mine')}   (next: saf-gen evaluate datasets/mine)\n" in out
    code, _, err = call("fetch", "ftp://example.org/x")
    assert code == 2
    assert err == "saf-gen: ftp://example.org/x cannot be fetched; allowed: an http or https address, or a folder\n"


def test_an_address_where_nothing_is_says_so(packed, tmp_path):
    with (
        serve(packed) as (_, address),
        pytest.raises(BadInput, match=r"nothing/index\.json: cannot be fetched: .*check the address"),
    ):
        fetch_dataset(f"{address}/nothing", tmp_path / "again")
    with pytest.raises(BadInput, match="cannot be fetched: .*run the same command again"):
        fetch_dataset(address, tmp_path / "again")
