"""Paths in object stores, reading by ranges, and uploads that are complete or missing."""

import os
import time
from pathlib import Path

import pytest
from refusals import assert_says, refusal

from saf_gen.core import object_store, object_transfers
from saf_gen.core.files import write_text
from saf_gen.core.object_store import FIRST_RANGE, KEPT_RANGES, LARGEST_RANGE, StorePath, find_path
from saf_gen.core.object_transfers import abort_uploads, download_file, list_objects, upload_file

CONTENT = bytes(range(256)) * 4096


@pytest.fixture
def store(monkeypatch):
    """A folder of fsspec's in-memory store, whose ETags are no digests of the content."""
    import fsspec

    monkeypatch.setitem(object_store.SCHEMES, "memory", "fsspec")
    yield StorePath("memory", "bucket/folder")
    fsspec.filesystem("memory").store.clear()


@pytest.mark.parametrize("text", ["s3://data/a/b.h5", "s3:/data/a/b.h5", Path("s3://data/a/b.h5"), "S3://data//a/b.h5"])
def test_an_address_of_a_store_is_a_path_in_it_even_as_a_path_object(text):
    path = find_path(text)
    assert path == StorePath("s3", "data/a/b.h5")
    assert str(path) == "s3://data/a/b.h5"
    assert (path.name, path.stem, path.suffix, str(path.parent.parent)) == ("b.h5", "b", ".h5", "s3://data")


@pytest.mark.parametrize("text", ["a/b.h5", "/a/b.h5", "c:/a", ".", "a:b", Path("x.h5")])
def test_all_else_is_a_path_on_a_disk(text):
    assert find_path(text) == Path(text)


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ("foo://data/a", "foo:// is not a known kind of address | s3://, or a path on a disk"),
        ("https://host/a", "https:// is not a known kind | saf-gen fetch"),
        ("s3:///", "names no bucket | s3://BUCKET/FOLDER"),
        ("s3://data/../a", "names no bucket"),
    ],
)
def test_an_address_of_something_else_is_refused(text, fragments):
    assert_says(refusal(find_path, text), fragments)


def test_nothing_but_generate_writes_to_a_store(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    error = refusal(write_text, Path("s3://data/a.txt"), "text")
    assert_says(error, "s3://data/a.txt is in an object store | only `saf-gen generate` writes")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_extra_is_one_line(monkeypatch):
    monkeypatch.setitem(object_store.SCHEMES, "s3", "no_such_package")
    error = refusal(StorePath("s3", "data/a").exists)
    assert_says(error, "s3:// needs the package no_such_package | pip install 'saf-gen[s3]'")


def test_reading_goes_by_ranges_that_grow_and_stay_within_their_memory(store, tmp_path):
    (tmp_path / "file").write_bytes(CONTENT * 20)
    upload_file(tmp_path / "file", store / "file")
    with (store / "file").open() as reader:
        assert (reader.seek(10_000_000), reader.read(3)) == (10_000_000, (CONTENT * 20)[10_000_000:10_000_003])
        assert (reader.requests, reader.fetched) == (1, FIRST_RANGE)
        reader.seek(0)
        found = b"".join(iter(lambda: reader.read(10_000), b""))
        assert found == CONTENT * 20
        assert reader.requests < 30
        assert sum(len(data) for _, data in reader._ranges) <= KEPT_RANGES * LARGEST_RANGE


def test_an_upload_is_read_back_where_the_store_gives_no_digest(store, tmp_path, monkeypatch):
    """An object that differs is deleted, so that it cannot be mistaken for a complete one."""
    file = tmp_path / "file"
    file.write_bytes(CONTENT)
    upload_file(file, store / "file")
    assert list_objects(store) == {"file"}
    download_file(store / "file", tmp_path / "again")
    assert (tmp_path / "again").read_bytes() == CONTENT
    files = store.file_system()

    def spoil(source, target, **options):
        files.pipe_file(target, CONTENT[:-1] + b"?")

    monkeypatch.setattr(type(files), "put_file", lambda self, *args, **options: spoil(*args, **options))
    assert_says(refusal(upload_file, file, store / "spoilt"), "spoilt | differs from the uploaded file and was deleted")
    assert list_objects(store) == {"file"}


@pytest.mark.slow
def test_an_upload_in_parts_is_checked_by_its_etag_alone(s3, tmp_path, monkeypatch):
    monkeypatch.setattr(object_transfers, "PART_BYTES", 5 << 20)
    monkeypatch.setattr(object_transfers, "_has_same_content", lambda file, target: pytest.fail("it was read back"))
    file, target = tmp_path / "file", StorePath("s3", "data/parts/file")
    for content in (CONTENT, CONTENT * 11):
        file.write_bytes(content)
        upload_file(file, target)
        assert s3.info(target.key)["size"] == len(content)
    assert s3.info(target.key)["ETag"].endswith('-3"')


def test_unfinished_uploads_are_aborted_unless_others_may_be_writing_them(s3, monkeypatch):
    monkeypatch.setattr(object_transfers, "ABANDONED_S", 1e9)  # moto reports that every upload began in 2010
    for name in ("ours", "others", "elsewhere"):
        key = f"{'kills' if name != 'elsewhere' else 'other'}/{name}"
        upload = s3.call_s3("create_multipart_upload", Bucket="data", Key=key)
        s3.call_s3("upload_part", Bucket="data", Key=key, PartNumber=1, UploadId=upload["UploadId"], Body=b"half")
    folder = StorePath("s3", "data/kills")
    assert list_objects(folder) == set()
    assert abort_uploads(folder, own_names={"ours"}) == (1, 1)
    left = s3.call_s3("list_multipart_uploads", Bucket="data")["Uploads"]
    assert sorted(upload["Key"] for upload in left) == ["kills/others", "other/elsewhere"]
    monkeypatch.setattr(object_transfers, "ABANDONED_S", 0.0)
    assert abort_uploads(folder, own_names=()) == (1, 0)


def ask(address):
    return lambda: find_path(address).is_dir()


@pytest.mark.parametrize(
    ("address", "environment", "fragments"),
    [
        ("s3://no-such-bucket/a", {}, "s3://no-such-bucket/a: there is no bucket 'no-such-bucket'"),
        ("s3://data/a", {"AWS_ENDPOINT_URL": "http://127.0.0.1:9"}, "does not answer | AWS_ENDPOINT_URL"),
        ("s3://data/a", {"AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""}, "no credentials | AWS_PROFILE"),
        ("s3://data/a", {"AWS_PROFILE": "nobody"}, "no credentials | nobody"),
    ],
)
def test_a_store_that_cannot_be_used_is_one_line(
    s3, forget_store_clients, address, environment, fragments, monkeypatch, tmp_path
):
    for name, value in {"AWS_EC2_METADATA_DISABLED": "true", "AWS_MAX_ATTEMPTS": "1", **environment}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    assert_says(refusal(ask(address)), fragments)


def test_a_store_that_denies_access_is_one_line(s3, monkeypatch):
    def refuse(key):
        raise PermissionError(13, "Forbidden")

    monkeypatch.setattr(s3, "info", refuse)
    assert_says(refusal(ask("s3://data/a")), "the store refuses: Forbidden | AWS_SECRET_ACCESS_KEY")


def test_an_object_has_size_and_time(s3):
    s3.pipe_file("data/times/a", b"123")
    found = find_path("s3://data/times/a").stat()
    assert found.st_size == 3
    assert abs(found.st_mtime - time.time()) < 3600
    assert_says(refusal(find_path("s3://data/times/b").stat), "no such object")
    assert [str(path) for path in find_path("s3://data/times").iterdir()] == ["s3://data/times/a"]
    assert isinstance(found, os.stat_result)
