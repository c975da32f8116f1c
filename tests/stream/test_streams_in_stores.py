"""Streams and datasets in an object store: the same content and checks as on a disk, read by ranges."""

import gc
import pickle
import re
import shutil

import h5py
import numpy as np
import pytest
from planted_sweeps import list_streams, write_sweep
from refusals import assert_says, refusal

import saf_gen
from saf_gen.core.object_store import find_path
from saf_gen.stream.dataset import verify_dataset
from saf_gen.stream.manifest import read_manifest

pytestmark = pytest.mark.slow

FRAMES = 8_000


@pytest.fixture(scope="module")
def long_stream(tmp_path_factory):
    """A file whose four time blocks are far larger than its metadata, as random bits cannot be compressed."""
    path = tmp_path_factory.mktemp("long") / "long.h5"
    spikes = np.random.default_rng(5).random((FRAMES, 64, 200), dtype=np.float32) < 0.5
    saf_gen.write_stream(path, spikes, focus_position=np.linspace(0, 1, FRAMES), provenance={"note": "one" * 100})
    return path


@pytest.fixture(scope="module")
def address(s3, long_stream):
    s3.put_file(str(long_stream), "data/streams/long.h5")
    return "s3://data/streams/long.h5"


@pytest.fixture
def requested(s3, monkeypatch):
    """The number of bytes of each range that is requested from the server."""
    ranges = []
    call = type(s3)._call_s3

    async def listen(self, method, *args, **options):
        if method == "get_object":
            first, last = re.fullmatch(r"bytes=(\d+)-(\d+)", options["Range"]).groups()
            ranges.append(int(last) - int(first) + 1)
        return await call(self, method, *args, **options)

    monkeypatch.setattr(type(s3), "_call_s3", listen)
    return ranges


def test_a_window_of_100_frames_fetches_its_time_block_and_not_the_file(address, long_stream, requested):
    with saf_gen.open_stream(address) as remote, saf_gen.open_stream(long_stream) as local:
        at_opening = sum(requested)
        assert np.array_equal(remote.counts(4_100, 4_200), local.counts(4_100, 4_200))
        size = long_stream.stat().st_size
        assert (FRAMES, at_opening < size / 20) == (local.shape[0], True)
        assert size / 4 * 0.95 < sum(requested) - at_opening < size / 4 * 1.6  # a quarter, and some read ahead
        before = len(requested)
        remote.counts(4_300, 4_400)
        assert len(requested) == before  # it is in memory


def test_a_stream_in_a_store_has_the_content_of_the_file(address, long_stream, requested):
    with saf_gen.open_stream(address) as remote, saf_gen.open_stream(long_stream) as local:
        assert remote.content_sha256 == local.content_sha256
        assert remote.metadata.provenance == local.metadata.provenance
        assert np.array_equal(remote.frames(1_990, 2_010), local.frames(1_990, 2_010))
        requested.clear()
        remote.verify()
        assert sum(requested) < 1.1 * long_stream.stat().st_size
        assert max(requested) <= 1 << 20
        with pickle.loads(pickle.dumps(remote)) as again:
            assert np.array_equal(again.counts(0, 8), local.counts(0, 8))


def test_garbage_of_hdf5_is_not_collected_while_hdf5_waits_for_an_object(address, long_stream):
    """Freed in the client's thread, it would wait for h5py's lock, whose holder waits for the client."""
    before = gc.get_threshold()
    with h5py.File(long_stream) as file, saf_gen.open_stream(address) as stream:
        gc.set_threshold(50, 2, 2)
        try:
            for first in range(0, FRAMES, 2_000):
                for _ in range(20):
                    circle = [file["spikes"]]
                    circle.append(circle)
                stream.counts(first, first + 10)
        finally:
            gc.set_threshold(*before)
    assert gc.isenabled()


def test_an_object_that_is_replaced_or_deleted_during_reading_is_reported(s3, long_stream):
    for end, words in ((s3.rm_file, "there is no such object"), (lambda key: s3.pipe_file(key, b"x"), "was replaced")):
        s3.put_file(str(long_stream), "data/streams/short-lived.h5")
        with saf_gen.open_stream("s3://data/streams/short-lived.h5") as stream:
            stream.counts(0, 100)
            end("data/streams/short-lived.h5")
            error = refusal(stream.counts, 6_000, 6_100)
            assert_says(error, f"s3://data/streams/short-lived.h5: | {words}")


def test_what_is_no_stream_is_refused_as_on_a_disk(s3, tmp_path, long_stream):
    def refuse(name, change):
        shutil.copy(long_stream, tmp_path / name)
        change(tmp_path / name)
        s3.put_file(str(tmp_path / name), f"data/strange/{name}")
        return refusal(saf_gen.open_stream, f"s3://data/strange/{name}")

    def lead_elsewhere(path):
        with h5py.File(path, "r+") as file:
            del file["focus"]
            file["focus"] = h5py.ExternalLink(str(long_stream), "focus")

    assert_says(refuse("link.h5", lead_elsewhere), "s3://data/strange/link.h5 | /focus is a link; allowed")
    assert_says(refuse("cut.h5", lambda path: path.write_bytes(path.read_bytes()[:100_000])), "cut.h5 | truncated")
    assert_says(refuse("empty.h5", lambda path: path.write_bytes(b"")), "is empty")
    assert_says(refusal(saf_gen.open_stream, "s3://data/strange/lnik.h5"), "no such file | link.h5")
    assert_says(refusal(saf_gen.open_stream, "s3://data/strange"), "this is a folder")


@pytest.fixture
def dataset(s3, tmp_path):
    """A dataset of two small sweeps, on the disk and in the store."""
    for name, peak in (("one", 300.0), ("two", 500.0)):
        write_sweep(tmp_path / f"small/test/{name}.h5", peak)
    list_streams(tmp_path / "small", {"id": "one"}, {"id": "two"})
    s3.put(str(tmp_path / "small") + "/", "data/small/", recursive=True)
    yield "s3://data/small"
    s3.rm("data/small", recursive=True)


def test_a_dataset_in_a_store_is_listed_and_verified(s3, dataset, tmp_path):
    assert read_manifest(dataset) == read_manifest(tmp_path / "small")
    assert verify_dataset(dataset) == (2, {})
    s3.rm_file("data/small/test/two.h5")
    count, problems = verify_dataset(dataset)
    assert (count, list(problems)) == (2, ["two"])
    assert "s3://data/small/test/two.h5: there is no such file" in problems["two"]
    assert_says(refusal(read_manifest, "s3://data/smal"), "there is no such folder | small")
    assert_says(refusal(read_manifest, "s3://data/small/test"), "has no manifest.json")
    text = s3.cat_file("data/small/manifest.json")
    s3.pipe_file("data/small/manifest.json", text.replace(b'"seed": 1', b'"seed": 2', 1))
    assert "s3://data/small/manifest.json" in str(refusal(read_manifest, dataset))


def test_an_evaluation_of_a_store_equals_that_of_a_disk_and_names_what_is_lost(
    s3, dataset, tmp_path, call, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for source in (dataset, "small"):
        code, out, err = call("evaluate", source, "--method", "sd+argmax", "--out", f"of-{len(source)}")
        assert (code, err) == (0, ""), out
    answers = [
        re.findall(r'"(?:sequence|frame|error)": [^,]*', (tmp_path / name / "records.jsonl").read_text())
        for name in ("of-15", "of-5")
    ]
    assert answers[0] == answers[1] != []
    for options, message in (
        (("--track", "closed_loop"), "the closed loop does not work on a dataset in an object store"),
        (("--out", "s3://data/evaluation"), "s3://data/evaluation is in an object store"),
    ):
        code, _, err = call("evaluate", dataset, "--method", "sd+argmax", *options)
        assert (code, err.count("\n"), message in err) == (2, 1, True)
    s3.rm_file("data/small/test/one.h5")
    code, _, err = call("evaluate", dataset, "--method", "sd+argmax", "--out", str(tmp_path / "results"))
    assert (code, err.count("\n")) == (1, 1)
    assert "one could not be evaluated: s3://data/small/test/one.h5: there is no such file" in err
    assert (tmp_path / "results/records.jsonl").read_text().count("\n") == 1


def test_streams_in_stores_are_inspected_scored_and_drawn(dataset, tmp_path, call):
    code, out, _ = call("inspect", f"{dataset}/test/one.h5")
    assert code == 0
    assert f"{dataset}/test/one.h5" in out
    size = (tmp_path / "small/test/one.h5").stat().st_size * 8 / (800 * 48 * 64)
    assert f"{size:.3f} bit per pixel and frame" in out
    code, out, _ = call("score", f"{dataset}/test/one.h5", "--measure", "sd", "--window", "200")
    assert (code, out.count("\n")) == (0, 5)
    code, _, _ = call("view", f"{dataset}/test/one.h5", "--out", str(tmp_path / "one.png"))
    assert code == 0
    assert (tmp_path / "one.png").stat().st_size > 1_000
    assert find_path(dataset).is_dir()
