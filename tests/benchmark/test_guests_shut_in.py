"""What guests reach of the file system, their digests, and their clock: whatever their method does while it loads."""

import os
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dask_processes import wait_until
from landlock import has_landlock
from planted_sweeps import make_spikes, write_three_sweeps

from saf_gen.benchmark.admission import admit_method, run_method
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.guests import host
from saf_gen.benchmark.guests.host import Limits
from saf_gen.benchmark.guests.reach import reach_of
from saf_gen.benchmark.records import record_to_json
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

LIMITS = Limits(load_s=30, run_s=3)
MEASURE = "def mine(counts):\n    return float(counts.var())\n"


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    path = tmp_path_factory.mktemp("guest") / "a.h5"
    write_stream(path, make_spikes(200.0, shape=(400, 24, 32)), focus_position=np.linspace(0, 1, 400, dtype=np.float32))
    with open_stream(path) as stream:
        yield WindowCounts(stream)


@pytest.fixture
def run(sweep, tmp_path):
    """Return a function that runs a method of this text on a recording: the method, its answer, problem and cost."""
    guests = []

    def call(text, name="mine+argmax:window=50", limits=LIMITS):
        (tmp_path / "own").mkdir(exist_ok=True)
        (tmp_path / "own" / "mine.py").write_text(text)
        spec = f"{tmp_path}/own/mine.py:{name}" if "+" in name else f"sd+{tmp_path}/own/mine.py:{name}"
        method = admit_method(spec, limits)
        guests.append(method.guest)
        view = RecordingView(sweep, None)
        return method, *run_method(method, view, scorer=view.scorer), view

    yield call
    for guest in guests:
        guest.close()


LOADS = {
    "a pipe without a reader": "os.mkfifo('pipe')\nos.open('pipe', os.O_RDONLY | os.O_NONBLOCK)",
    "a loop of links": "os.symlink('a', 'b')\nos.symlink('b', 'a')\ntry:\n    open('a')\nexcept OSError:\n    pass",
    "forged paths": "for path in ('\\0', 'x' * 9999, '\\udcff', '/proc/self/mem', ''):\n"
    "    sys.audit('open', path, 'r', os.O_RDONLY)",
    "links to devices": "os.symlink('/dev/zero', 'zero')\nopen('zero', 'rb').close()",
    "a folder": "os.open('.', os.O_RDONLY)",
}


@pytest.mark.slow
@pytest.mark.parametrize("text", LOADS.values(), ids=LOADS)
def test_what_a_method_opens_while_it_loads_holds_nobody(run, text):
    method, answer, problem, _ = run(f"import os, sys\n{text}\n{MEASURE}")
    assert (problem, answer.frame is not None) == ("", True)
    assert [name for name, _ in method.guest.files if name == "mine.py"] == ["mine.py"]


@pytest.mark.slow
def test_digests_are_made_within_the_time_to_load(run, tmp_path):
    """A file of a terabyte of nothing is on the method's own clock."""
    (tmp_path / "own").mkdir()
    with (tmp_path / "own" / "huge.bin").open("wb") as file:
        file.truncate(1 << 40)
    began = time.monotonic()
    text = f"open(__file__.replace('mine.py', 'huge.bin'), 'rb').close()\n{MEASURE}"
    _, answer, problem, _ = run(text, limits=replace(LIMITS, load_s=3.0))
    assert (answer.frame, problem) == (None, "over a limit: it did not load within 3 s")
    assert time.monotonic() - began < 20


@pytest.mark.slow
def test_a_method_cannot_unsay_the_files_that_the_user_named(run):
    forges = (
        "from saf_gen.benchmark.guests.code_files import CodeFiles\n"
        "CodeFiles.digests = lambda self: [['mine.py', 'f' * 64]]\n"
    )
    method, answer, problem, _ = run(forges + MEASURE)
    assert (answer.frame, problem) == (None, "while it was loaded, its process sent nonsense")
    assert method.guest.files != [["mine.py", "f" * 64]]


SLOW = """
import time
from saf_gen.benchmark.guests.process import GuestLine
from saf_gen.parts import Answer
send = GuestLine.send
def slowly(self, message):
    if "pong" in message:
        time.sleep(PONG)
    send(self, message)
GuestLine.send = slowly
def mine(view):
    for number in range(WINDOWS):
        time.sleep(0.04)
        view.score(number, number + 50)
    return Answer(7.0)
"""


@pytest.mark.slow
def test_slow_replies_to_pings_hide_no_time(run):
    _, answer, problem, view = run(SLOW.replace("WINDOWS", "20").replace("PONG", "0.05"), "mine")
    assert (answer.frame, problem) == (7.0, "")
    assert view.scorer.seconds > 0.75
    for windows, pong in (("100", "0.05"), ("20", "0.3")):
        _, answer, problem, _ = run(SLOW.replace("WINDOWS", windows).replace("PONG", pong), "mine")
        assert (answer.frame, problem) == (None, "over a limit: it did not answer within 3 s")


def named(text):
    """Return the processes that have this text as an argument."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            found += [path.parent.name] if text.encode() in path.read_bytes().split(b"\0") else []
    return found


@pytest.mark.slow
def test_a_child_with_an_empty_environment_ends_with_the_run(run):
    child = (
        "import subprocess\nfrom saf_gen.parts import Answer\ndef mine(view):\n"
        "    subprocess.Popen(['sleep', '4321.5'], env={}, start_new_session=True, cwd='/')\n    return Answer(7.0)\n"
    )
    method, answer, _, _ = run(child, "mine")
    assert answer.frame == 7.0
    wait_until(lambda: named("4321.5"), 10)
    method.guest.close()
    assert named("4321.5") == []


NUMBA = """
import pathlib
import numba, numpy as np, scipy.ndimage
WEIGHTS = np.load(pathlib.Path(__file__).parent / "weights.npz")["w"]

@numba.njit(cache=True)
def total(image):
    found = 0.0
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            found += image[row, column] ** 2
    return found

def mine(counts):
    return float(total(scipy.ndimage.laplace(counts.astype(np.float64))) * WEIGHTS[0])
"""


@pytest.mark.slow
def test_a_method_answers_alike_with_and_without_landlock(tmp_path, monkeypatch):
    """One with numba, scipy and a file of weights; the record says what shut it in."""
    (tmp_path / "mine.py").write_text(NUMBA)
    np.savez(tmp_path / "weights.npz", w=np.array([2.0, 3.0]))
    dataset, spec = write_three_sweeps(tmp_path / "datasets" / "three"), f"{tmp_path}/mine.py:mine+argmax:window=50"
    how = {"methods": [spec], "draw": False, "check": False}
    inside = evaluate(dataset, limits=Limits(run_s=59), **how).records
    monkeypatch.setattr(host, "reach_of", lambda *_, **__: None)
    outside = evaluate(dataset, limits=Limits(run_s=58), **how).records
    assert {record.judgement.status for record in inside} == {"answered"}
    assert {record.who.limits for record in outside} == {"58 s, 2,048 MiB, Landlock 0"}
    if has_landlock():
        assert all(int(record.who.limits.rpartition(" ")[2]) >= 6 for record in inside)
    cost = ("seconds", "reference_rate", "limits")
    plain = [
        [{k: v for k, v in record_to_json(r).items() if k not in cost} for r in rows] for rows in (inside, outside)
    ]
    assert plain[0] == plain[1]


@pytest.fixture
def layout(tmp_path):
    """The usual folder of somebody who writes a method, and much that it must not read."""
    for name in (
        *("mine.py", "weights.h5", "table.txt", "notes/a.txt", "package/__init__.py", "package/part.py"),
        *("datasets/one/manifest.json", "datasets/one/test/a.h5", "datasets/readme.txt", "out/records.jsonl"),
        *("out/index.html", ".ssh/id", "package/.secret", "takes/b.h5", "takes/truth.csv"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    (tmp_path / "link").symlink_to(tmp_path / "datasets" / "one")
    return tmp_path


def test_a_guest_reads_what_is_beside_its_method_but_no_dataset(layout):
    reach = reach_of([str(layout)], [str(layout / "weights.h5")], own=layout / "work")
    readable = {Path(path).relative_to(layout).as_posix() for path in reach.readable if path.startswith(str(layout))}
    assert readable == {
        *("mine.py", "weights.h5", "table.txt", "notes", "package/__init__.py", "package/part.py"),
        "datasets/readme.txt",
    }
    assert str(layout) in reach.listed
    assert not any(Path(path).is_relative_to("/home") or path == "/" for path in reach.writable)


TRIES = """
import os, pathlib
import package.part
from saf_gen.parts import Answer
HERE = pathlib.Path(__file__).parent
def mine(view):
    said = []
    for path in ("table.txt", "notes/a.txt", "datasets/one/manifest.json", "datasets/one/test/a.h5",
                 "out/records.jsonl", "link/manifest.json", ".ssh/id", "takes/truth.csv", "weights.h5"):
        try:
            said.append((HERE / path).read_text()[:1])
        except OSError as error:
            said.append(type(error).__name__[0])
    return Answer(7.0, note="".join(said))
"""


@pytest.mark.slow
@pytest.mark.skipif(not has_landlock(), reason="the system does not shut guests in")
def test_a_guest_opens_nothing_that_leads_to_a_dataset(layout, sweep):
    (layout / "mine.py").write_text(TRIES)
    for name in ("__init__", "part"):
        (layout / "package" / f"{name}.py").write_text("")
    method, view = admit_method(f"sd+{layout}/mine.py:mine", LIMITS), RecordingView(sweep, None)
    answer, problem = run_method(method, view, scorer=view.scorer)
    method.guest.close()
    assert (answer.note, problem) == ("tnPPPPPPP", "")


@pytest.mark.parametrize("text", ["60 s, 2,048 MiB", "60 s, 2,048 MiB, Landlock 0", "60 s, 2,048 MiB, Landlock 12"])
def test_limits_are_read_with_and_without_landlock(text):
    assert Limits.parse(text) == Limits()


@pytest.mark.slow
def test_a_guest_writes_no_kernels_that_others_load(run, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "shared"))
    note = "note=os.environ['NUMBA_CACHE_DIR']"
    text = f"import os\nfrom saf_gen.parts import Answer\ndef mine(view):\n    return Answer(7.0, {note})\n"
    _, answer, _, _ = run(text, "mine")
    assert answer.note.endswith("/kernels")
    assert str(tmp_path) not in answer.note
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "shared")
