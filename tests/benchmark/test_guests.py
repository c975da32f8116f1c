"""Methods of others run as guests: whatever they do, only their own runs fail, and they see counts and positions."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dask_processes import children
from landlock import has_landlock
from planted_sweeps import make_spikes, write_three_sweeps

from saf_gen.benchmark.admission import admit_method, run_method
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.guests.host import Limits
from saf_gen.benchmark.method_spec import split_halves
from saf_gen.benchmark.records import record_to_json
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.optics.actuators import get_actuator
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

FILE = Path(__file__).with_name("hostile_methods.py")
SHORT = Limits(load_s=60, run_s=1.5, resident_bytes=600 << 20)
LONG = Limits(load_s=60, run_s=60, resident_bytes=600 << 20)


def load_hostile():
    spec = importlib.util.spec_from_file_location("hostile_methods", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    left_out = set() if has_landlock() else module.SHUT_IN
    return {name: reason for name, reason in module.HOSTILE.items() if name not in left_out}


HOSTILE = load_hostile()
FEW = ("exits_at_once", "reads_address_zero", "never_ends", "forks_and_returns_twice", "closes_all_descriptors")


@pytest.fixture(scope="module")
def sweep_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("guest") / "a.h5"
    write_stream(path, make_spikes(200.0, shape=(400, 24, 32)), focus_position=np.linspace(0, 1, 400, dtype=np.float32))
    return path


@pytest.fixture(scope="module")
def sweep(sweep_file):
    with open_stream(sweep_file) as stream:
        yield WindowCounts(stream)


@pytest.fixture
def run(sweep):
    """Return a function that runs a method on a recording, and returns its answer, its problem and its cost."""
    guests = []

    def call(spec, limits=SHORT):
        method = admit_method(spec, limits)
        guests.append(method.guest)
        view = RecordingView(sweep, None if method.guest else method.measure)
        return *run_method(method, view, scorer=view.scorer), view

    yield call
    for guest in guests:
        if guest is not None:
            guest.close()


@pytest.mark.daily(24)
@pytest.mark.parametrize(
    "name", [name if name in FEW else pytest.param(name, marks=pytest.mark.slow) for name in HOSTILE]
)
def test_a_hostile_method_fails_for_itself_only(run, sweep, name):
    answer, problem, view = run(f"sd+{FILE}:{name}", SHORT if "within" in HOSTILE[name] else LONG)
    if HOSTILE[name]:
        assert re.search(HOSTILE[name], problem), problem
        assert answer.frame is None
        assert len(problem) <= 300
        assert "\n" not in problem
    else:
        assert (answer.frame, problem) == (7.0, ""), answer.note
    assert view.scorer.windows >= 0
    after = run("variance+argmax:window=50")[0]
    assert after.frame is not None


@pytest.mark.slow
def test_a_guest_gives_what_the_same_method_gives_in_the_evaluator(tmp_path):
    """Bit for bit, for each form of input and for a search that looks at counts, in both tracks."""
    (tmp_path / "mine.py").write_text(COPIES)
    dataset = write_three_sweeps(tmp_path / "three")
    shipped = ["sd+argmax:window=50", "sd_debiased+egs_code", "sd_tfi+argmax:window=80", "vollath_f4_n+peak_fit"]
    guests = [f"{tmp_path}/mine.py:{name}+{search}" for name, search in GUESTS]
    records = evaluate(dataset, methods=[*shipped, *guests], draw=False, check=False).records
    for one, other in zip(shipped, guests, strict=True):
        mine, theirs = ([plain(r) for r in records if r.who.method == name] for name in (one, other))
        for a, b in zip(mine, theirs, strict=True):
            assert {key: (a[key], b[key]) for key in a if a[key] != b[key]} == {}, other


@pytest.mark.slow
def test_the_closed_loop_is_the_same_for_a_guest(tmp_path, captured_dataset):
    (tmp_path / "mine.py").write_text(COPIES + WAITS)
    searches = ("hill_climb", "golden_section", "sgfs_causal", "photon_aware", f"{tmp_path}/mine.py:Waits")
    copy = f"{tmp_path}/mine.py:Copy:of=sd"
    protocol = ClosedLoopProtocol(get_actuator("voice_coil"))
    methods = [f"{measure}+{search}" for search in searches for measure in ("sd", copy)]
    records = evaluate(
        captured_dataset, methods=methods, protocol=protocol, draw=False, check=False, limits=LONG
    ).records
    for one, other in zip(methods[::2], methods[1::2], strict=True):
        mine, theirs = ([plain(r) for r in records if r.who.method == name] for name in (one, other))
        for a, b in zip(mine, theirs, strict=True):
            assert {key: (a[key], b[key]) for key in a if a[key] != b[key]} == {}, other
    waits = next(record for record in records if record.who.method == methods[-1])
    assert (waits.judgement.status, waits.judgement.note) == (
        "failed",
        f"the budget of {waits.what.frames} frames was spent",
    )


@pytest.mark.long
def test_hostile_methods_fail_for_themselves_in_the_closed_loop(tmp_path, captured_dataset):
    protocol = ClosedLoopProtocol(get_actuator("voice_coil"))
    hostile = {f"sd+{FILE}:{name}": HOSTILE[name] for name in FEW}
    methods = ["sd+hill_climb", *hostile, "tenengrad_n+golden_section"]
    records = evaluate(
        captured_dataset, methods=methods, protocol=protocol, draw=False, check=False, limits=SHORT
    ).records
    alone = evaluate(
        captured_dataset, methods=[methods[0], methods[-1]], protocol=protocol, draw=False, check=False
    ).records
    assert [plain(r) for r in records if r.who.method not in hostile] == [plain(r) for r in alone]
    for record in records:
        if hostile.get(record.who.method):
            assert record.judgement.status == "failed"
            assert re.search(hostile[record.who.method], record.judgement.note), record.judgement.note


WAITS = """
class Waits:
    commands = True

    def __call__(self, view):
        from saf_gen.parts import Answer
        view.move(0.3)
        while True:
            try:
                view.wait(1000)
            except Exception:
                view.score(view.now - 8, view.now)
"""
GUESTS = [
    ("Copy:of=sd", "argmax:window=50"),
    ("Halves", "egs_code"),
    ("Intervals", "argmax:window=80"),
    ("Copy:of=vollath_f4_n", "peak_fit"),
]
COPIES = """
from dataclasses import dataclass
from typing import ClassVar
from saf_gen.plugins.measures import get_measure

@dataclass(frozen=True)
class Copy:
    of: str = "sd"
    score_range: ClassVar[str] = "any"
    degree: ClassVar[int] = 0

    def __call__(self, counts):
        return get_measure(self.of)(counts)

@dataclass(frozen=True)
class Halves(Copy):
    of: str = "sd_debiased"
    halves: ClassVar[bool] = True

@dataclass(frozen=True)
class Intervals(Copy):
    of: str = "sd_tfi"
    intervals: ClassVar[bool] = True
"""
OWN = (
    "method", "code", "parameters", "limits", "seconds", "machine", "grain_of_curve", "optimum", "error_optimum_dof",
    "operations", "reference_rate",
)  # fmt: skip


def plain(record):
    return {key: value for key, value in record_to_json(record).items() if key not in OWN}


@pytest.mark.slow
def test_a_saboteur_changes_no_row_of_another(tmp_path):
    (tmp_path / "mine.py").write_text("import numpy as np\ndef mine(counts):\n    return float(np.var(counts))\n")
    dataset = write_three_sweeps(tmp_path / "three")
    others = ["sd+argmax:window=50", f"{tmp_path}/mine.py:mine+argmax:window=50", "tenengrad_n+egs_code"]
    alone = evaluate(dataset, methods=others, draw=False, check=False).records
    saboteurs = [f"sd+{FILE}:{name}" for name in ("patches_the_comparison", "forgets_this_package", "exits_at_once")]
    beside = evaluate(dataset, methods=[saboteurs[0], *others, *saboteurs[1:]], draw=False, check=False).records
    cost = ("seconds", "machine", "reference_rate")
    expected = [{k: v for k, v in record_to_json(r).items() if k not in cost} for r in alone]
    found = [{k: v for k, v in record_to_json(r).items() if k not in cost} for r in beside if r.who.method in others]
    assert found == expected
    assert {r.judgement.status for r in beside if r.who.method == saboteurs[2]} == {"failed"}


@pytest.mark.slow
def test_a_guest_holds_no_file_no_path_and_no_truth(tmp_path):
    """It looks through its descriptors, arguments, environment, folder and memory for what the evaluator knows."""
    dataset = write_three_sweeps(tmp_path / "secret-dataset-of-nobody")
    (tmp_path / "spy.py").write_text(SPY)
    (record, *_) = evaluate(dataset, methods=[f"sd+{tmp_path}/spy.py:spy"], draw=False, check=False).records
    assert record.judgement.note == "nothing found", record.judgement.note


SPY = """
import gc, os, sys
from pathlib import Path
from saf_gen.parts import Answer

def spy(view):
    view.score(0, 100)
    word = "secret-dataset" + "-of-nobody"
    found = []
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            target = os.readlink(descriptor)
        except OSError:
            continue
        if not target.startswith(("pipe:", "/dev/null", "/memfd:", "/proc/")):
            found.append(target)
    found += [text for text in (*sys.argv, *os.environ.values(), os.getcwd()) if word in text]
    for thing in gc.get_objects():
        kind = type(thing).__name__
        if kind in ("SpikeStream", "Truth", "WindowCounts", "SequenceTask", "Record", "Dataset", "File"):
            found.append(kind)
        elif isinstance(thing, dict) and any(isinstance(v, str) and word in v for v in thing.values() if v is not word):
            found.append(f"a dict with {sorted(map(str, thing))[:3]}")
    walked, seen = [view], set()
    while walked and len(seen) < 20_000:
        thing = walked.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if not isinstance(thing, type) and ("truth" in dir(thing) or "best_position" in dir(thing)):
            found.append(f"{type(thing).__name__} has a truth")
        walked += [r for r in gc.get_referents(thing) if not isinstance(r, type(sys))][:100]
    return Answer(7.0, note="; ".join(map(str, found))[:900] or "nothing found")
"""


READS = """
import json, pathlib
from dataclasses import dataclass
import helper
from inside import deeper

HERE = pathlib.Path(__file__).parent
WEIGHTS = json.loads((HERE / "weights.json").read_text())
with open(HERE / "table.bin", "rb") as file:
    TABLE = file.read()

@dataclass(frozen=True)
class Mine:
    file: str = ""
    scale: float = 1.0

    def __call__(self, counts):
        option = float(open(self.file).read()) if self.file else 0.0
        return float(counts.var()) * self.scale * helper.FACTOR + deeper.PART + WEIGHTS["w"] + TABLE[0] + option
"""
READ = {"mine.py": READS, "helper.py": "FACTOR = 2", "inside/__init__.py": "", "inside/deeper.py": "PART = 1",
        "weights.json": '{"w": 1}', "table.bin": "a", "option.txt": "5"}  # fmt: skip


@pytest.fixture
def method_folder(tmp_path):
    for name, text in READ.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.slow
@pytest.mark.daily(2)
@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("mine.py", READS.replace("+ TABLE[0]", "- TABLE[0]")),
        ("helper.py", "FACTOR = 3"),
        ("inside/deeper.py", "PART = 2"),
        ("inside/__init__.py", "import math"),
        ("weights.json", '{"w": 2}'),
        ("table.bin", "b"),
        ("option.txt", "6"),
    ],
)
def test_the_digest_of_a_method_covers_what_it_reads_while_it_loads(method_folder, file, text):
    spec = f"{method_folder}/mine.py:Mine:file={method_folder}/option.txt+argmax:window=50"
    before = admit_method(spec)
    (method_folder / file).write_text(text)
    after = admit_method(spec)
    assert before.code != after.code
    (method_folder / file).write_text(READ[file])
    again = admit_method(spec)
    assert again.code == before.code
    for method in (after, again):
        method.guest.close()


@pytest.mark.slow
@pytest.mark.parametrize(("old", "new"), [("FACTOR = 2", "# a remark\nFACTOR = 2"), ("FACTOR = 2", "FACTOR  =  2")])
def test_remarks_and_blanks_do_not_change_a_digest(method_folder, old, new):
    spec = f"{method_folder}/mine.py:Mine+argmax:window=50"
    before = admit_method(spec).code
    (method_folder / "helper.py").write_text(READ["helper.py"].replace(old, new))
    method = admit_method(spec)
    assert method.code == before
    method.guest.close()


@pytest.mark.slow
def test_the_digest_does_not_depend_on_the_folder_but_on_the_options(method_folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("elsewhere") / "moved"
    shutil.copytree(method_folder, other)
    codes = []
    for folder, scale in ((method_folder, ""), (other, ""), (other, ":scale=2")):
        method = admit_method(f"{folder}/mine.py:Mine{scale}+argmax:window=50")
        codes.append(method.code)
        method.guest.close()
    assert codes[0] == codes[1] != codes[2]


@pytest.mark.slow
def test_two_files_with_equally_named_helpers_stay_apart(tmp_path, run):
    for name, factor in (("a", 1.0), ("b", -1.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "helper.py").write_text(f"FACTOR = {factor}")
        text = "import helper\ndef mine(counts):\n    return float(counts.var()) * helper.FACTOR\n"
        (tmp_path / name / "mine.py").write_text(text)
    a, b = (run(f"{tmp_path}/{name}/mine.py:mine+argmax:window=50", LONG) for name in "ab")
    scores = [view.scorer.scores for *_, view in (a, b)]
    assert scores[0] == {window: -score for window, score in scores[1].items()}
    assert a[0].frame != b[0].frame


@pytest.mark.slow
@pytest.mark.daily(2)
@pytest.mark.parametrize(
    "path",
    ["my dir/mine.py", "a+b/mine.py", "a + b/my file.py", "a,b=c/mine.py", "at@home/mine.py", "it's (1)/mine.py"],
)
def test_paths_with_blanks_and_signs_work(tmp_path, run, path):
    file = tmp_path / path
    file.parent.mkdir()
    file.write_text("def mine(counts, scale=1.0):\n    return float(counts.var()) * scale\n")
    for spec in (f"{file}:mine : scale = 2 + argmax: window=50", f"{file}:mine_n+argmax:window=50@frame"):
        answer, problem, view = run(spec, LONG)
        assert (problem, len(view.scorer.scores)) == ("", 8)
        assert answer.frame is not None


@pytest.mark.parametrize(
    ("name", "halves"),
    [
        ("sd+argmax", ["sd", "argmax"]),
        ("/a+b/m.py:M+argmax", ["/a+b/m.py:M", "argmax"]),
        ("sd+/a+b/s.py:S:x=1", ["sd", "/a+b/s.py:S:x=1"]),
        ("/a+b/m.py:M+/c+d/s.py:S", ["/a+b/m.py:M", "/c+d/s.py:S"]),
        ("m.py:M+/c+d/s.py:S", ["m.py:M", "/c+d/s.py:S"]),
        ("a.b:M+c.d:S", ["a.b:M", "c.d:S"]),
        ("sd", ["sd"]),
        ("sd+argmax+argmax", ["sd", "argmax", "argmax"]),
    ],
)
def test_a_plus_in_a_path_is_no_sign_of_a_method(name, halves):
    assert split_halves(name) == halves


@pytest.mark.slow
def test_a_guest_that_cannot_be_started_again_fails_its_own_row(tmp_path, captured_dataset, monkeypatch):
    """It ends in the first sequence, when the machine is out of processes."""
    protocol = ClosedLoopProtocol(get_actuator("voice_coil"))
    methods = ["sd+hill_climb", f"sd+{FILE}:exits_at_once", "tenengrad_n+golden_section"]
    own = replace(LONG, run_s=LONG.run_s + 1)  # another test may have ended the guest with the usual limits
    admit_method(methods[1], own)

    def refuse(*_, **__):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("saf_gen.core.child.subprocess.Popen", refuse)
    how = {"protocol": protocol, "draw": False, "check": False, "limits": own, "scene_motion": "static"}
    records = evaluate(captured_dataset, methods=methods, **how).records
    notes = {record.judgement.note for record in records if record.who.method == methods[1]}
    assert notes == {
        "its process ended with exit code 0",
        "its process cannot be started: Resource temporarily unavailable",
    }
    alone = evaluate(captured_dataset, methods=methods[::2], **how).records
    assert [plain(r) for r in records if r.who.method != methods[1]] == [plain(r) for r in alone]


class Breaks(RecordingView):
    """A view that breaks once the method has seen two windows."""

    def image(self, form, *, first, stop):
        if self.scorer.windows == 2:
            raise ZeroDivisionError("the evaluator's own")
        return super().image(form, first=first, stop=stop)


def running_children():
    """Return the ids of this process's children, without that of the command which lists them."""
    return {pid for pid in children(os.getpid()) if Path(f"/proc/{pid}").exists()}


@pytest.mark.slow
def test_an_error_of_the_evaluator_in_mid_run_ends_the_guest(tmp_path, sweep):
    """Otherwise the guest would take the first reply of its next run for a window of this one."""
    (tmp_path / "mine.py").write_text("def mine(counts):\n    return float(counts.var())\n")
    before = running_children()
    method, view = admit_method(f"{tmp_path}/mine.py:mine+argmax:window=50", LONG), Breaks(sweep, None)
    (guest,) = running_children() - before
    with pytest.raises(ZeroDivisionError):
        run_method(method, view, scorer=view.scorer)
    assert guest not in running_children()
    view = RecordingView(sweep, None)
    answer, problem = run_method(method, view, scorer=view.scorer)
    assert (problem, len(view.scorer.scores)) == ("", 8)
    assert answer.frame == admitted_alone("variance+argmax:window=50", sweep).frame
    method.guest.close()


def admitted_alone(spec, sweep):
    method = admit_method(spec)
    view = RecordingView(sweep, method.measure)
    return run_method(method, view, scorer=view.scorer)[0]


@pytest.mark.slow
def test_a_killed_evaluator_leaves_no_guest_and_no_folder(tmp_path):
    (tmp_path / "mine.py").write_text("def mine(counts):\n    return float(counts.var())\n")
    code = (
        "import os, signal; from saf_gen.benchmark.admission import admit_method\n"
        f"guest = admit_method({f'{tmp_path}/mine.py:mine+argmax'!r})\n{BELOW}"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    deadline = time.monotonic() + 60
    assert len(run.stdout.split()) == 2, run.stderr  # with its supervisor
    while time.monotonic() < deadline and (
        list(tmp_path.glob("saf-gen-guest-*")) or any(map(is_running, run.stdout.split()))
    ):
        time.sleep(0.05)
    assert list(tmp_path.glob("saf-gen-guest-*")) == []
    assert not any(map(is_running, run.stdout.split()))


BELOW = """
from saf_gen.core.child import _children
def below(process):
    return [found for child in _children(process) for found in (child, *below(child))]
print(*below(os.getpid()), flush=True)
"""


@pytest.mark.parametrize(
    "name", [pytest.param("holds_the_interpreter", marks=pytest.mark.slow), "leaves_a_child_behind"]
)
def test_a_killed_evaluator_leaves_nothing_that_a_guest_started(tmp_path, sweep_file, name):
    """Not even a guest that never lets another thread look for the evaluator, nor a child in a session of its own."""
    code = (
        "import os, signal, sys, threading, time\n"
        "from saf_gen.benchmark.admission import admit_method, run_method\n"
        "from saf_gen.benchmark.guests.host import Limits\n"
        "from saf_gen.benchmark.view.recording import RecordingView, WindowCounts\n"
        "from saf_gen.stream.stream_file import open_stream\n"
        f"method = admit_method('sd+{FILE}:{name}', Limits(load_s=8, run_s=8))\n"
        f"view = RecordingView(WindowCounts(open_stream('{sweep_file}')), None)\n"
        "run = lambda: run_method(method, view, scorer=view.scorer)\n"
        "threading.Thread(target=run, daemon=True).start()\n"
        "time.sleep(2)\n"
        f"{BELOW}"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and any(map(is_running, run.stdout.split())):
        time.sleep(0.1)
    assert len(run.stdout.split()) == (3 if name == "leaves_a_child_behind" else 2), run.stderr
    assert not any(map(is_running, run.stdout.split()))


def is_running(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
