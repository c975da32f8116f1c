"""A resumed evaluation equals a fresh one, whatever changed meanwhile of what its methods read."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from planted_sweeps import write_three_sweeps

from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.guests import guest
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.method_spec import TunedMethod, format_tuned
from saf_gen.benchmark.records import record_to_json

CARD = """name: mine
measure: main.py:Mine
search: walk.py:walk
files: [listed.txt]
"""
MAIN = """
import json, pathlib
from dataclasses import dataclass
from typing import ClassVar
import helper
from inside import deeper
try:
    import neighbour
except ImportError:
    neighbour = None

HERE = pathlib.Path(__file__).parent
WEIGHTS = json.loads((HERE / "weights.json").read_text())
KEPT = []

@dataclass(frozen=True)
class Mine:
    file: str = ""
    scale: float = 1.0
    score_range: ClassVar[str] = "any"
    degree: ClassVar[int] = 0

    def __call__(self, counts):
        if not KEPT:
            KEPT.append(float((HERE / "first.txt").read_text()))
        late = [float(open(HERE / name).read()) for name in ("called.txt", "listed.txt")]
        try:
            late.append(float(open(HERE / "maybe.txt").read()))
        except FileNotFoundError:
            pass
        option = float(open(self.file).read()) if self.file else 0.0
        part = helper.FACTOR + deeper.PART + WEIGHTS["w"] + sum(late) + KEPT[0] + option + (neighbour is None)
        return float(counts.var()) + self.scale * part * float(counts[0, 0])
"""
WALK = """
from saf_gen.parts import Answer
def walk(view):
    scores = [view.score(first, first + 50) for first in range(0, view.frames - 50, 50)]
    best = max(range(len(scores)), key=scores.__getitem__)
    return Answer(50.0 * best + 24.5, trace=tuple(scores))
"""
NET = """
from dataclasses import dataclass
from saf_gen.core.onnx_network import OnnxNetwork
@dataclass(frozen=True)
class Net:
    file: str
    def __call__(self, counts):
        return float(OnnxNetwork(self.file)(x=[counts.var(), 0.0])[0][0])
"""
PACKAGE = """
import pathlib
from pkg.parts import FACTOR
def measure(counts):
    return float(counts.var()) * FACTOR * float((pathlib.Path(__file__).parent / "weights.txt").read_text())
"""
ENTRY_POINTS = "[saf_gen.measures]\npkg_measure = pkg:measure\n"
FILES = {"main.py": MAIN, "walk.py": WALK, "helper.py": "FACTOR = 2.0", "inside/__init__.py": "",
         "inside/deeper.py": "PART = 1.0", "weights.json": '{"w": 1.0}', "first.txt": "1", "called.txt": "2",
         "listed.txt": "3", "net.py": NET, "site/pkg/__init__.py": PACKAGE, "site/pkg/parts.py": "FACTOR = 1.0",
         "site/pkg/weights.txt": "1", "site/pkg-1.0.dist-info/entry_points.txt": ENTRY_POINTS,
         "site/pkg-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: pkg\nVersion: 1.0\n",
         "option.txt": "4", "neighbour.py": "", "method.yaml": CARD}  # fmt: skip
TUNED = TunedMethod("", "small", "train", "recorded", "", "target", 3, "c0ffee", "0.1.0", ())


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_three_sweeps(tmp_path_factory.mktemp("data"))


@pytest.fixture
def mine(tmp_path, monkeypatch, forget_packages):
    """A folder with a method, in the working folder."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        file = tmp_path / "mine" / name
        file.parent.mkdir(exist_ok=True, parents=True)
        file.write_text(text)
    (tmp_path / "mine" / "scale.onnx").write_bytes(scaling_network(3.0))
    tune(1.0)(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "mine" / "site")
    forget_packages()
    monkeypatch.setattr(guest, "_GUESTS", {})  # a package of this name was elsewhere in another test
    close("mine/main.py:Mine+argmax")  # a tuned file may name only code that the command line named
    return tmp_path / "mine"


def pieces(*fields):
    """Return a protobuf message of (number, value) fields."""
    message = b""
    for number, value in fields:
        value = value.encode() if isinstance(value, str) else value
        message += (
            bytes([number << 3, value]) if isinstance(value, int) else bytes([number << 3 | 2, len(value)]) + value
        )
    return message


def scaling_network(factor):
    """Return the bytes of an ONNX file in which output ``y`` (2) is input ``x`` (2) times a factor."""
    kind = pieces((1, pieces((1, 1), (2, pieces((1, pieces((1, 2))))))))  # tensor(float), shape (2)
    weight = pieces((2, 1), (8, "factor"), (9, np.float32(factor).tobytes()))
    node = pieces((1, "x"), (1, "factor"), (2, "y"), (4, "Mul"))
    ends = [(number, pieces((1, name), (2, kind))) for number, name in ((11, "x"), (12, "y"))]
    graph = pieces((1, node), (2, "scale"), (5, weight), *ends)
    return pieces((1, 8), (7, graph), (8, pieces((1, ""), (2, 13))))


def rows(evaluation):
    timed = ("seconds", "reference_rate")
    return [{k: v for k, v in record_to_json(record).items() if k not in timed} for record in evaluation.records]


def close(spec):
    """End the method's process, so that it is loaded again."""
    if (running := admit_method(spec).guest) is not None:
        running.close()


def stop_in_the_third(dataset, spec):
    """Evaluate a method, and stop before the third sequence."""
    done = []

    def stop(steps, total, what):
        done.extend(name for name in ("one", "two", "three") if what == name)
        if done == ["one", "two"]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(dataset, methods=[spec], keep=KeptSequences("kept"), draw=False, progress=stop)


def write(name, text):
    return lambda folder: (folder / name).write_text(text)


def rewrite(folder):
    file = folder / "weights.json"
    status = file.stat()
    file.write_text('{"w": 5.0}')
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))


def write_network(factor):
    return lambda folder: (folder / "scale.onnx").write_bytes(scaling_network(factor))


def tune(scale):
    return lambda folder: Path("tuned.json").write_text(
        format_tuned(replace(TUNED, method=f"mine/main.py:Mine:scale={scale}+argmax"))
    )


FILE, FOLDER, OPTION = "mine/main.py:Mine+mine/walk.py:walk", "mine/", "mine/main.py:Mine:file=mine/option.txt+argmax"
NETWORK = "mine/net.py:Net:file=mine/scale.onnx+argmax"
CHANGES = {
    "nothing": (FILE, lambda folder: None, 2),
    "nothing in a folder": (FOLDER, lambda folder: None, 2),
    "the main file": (FILE, write("main.py", MAIN.replace("option +", "option -")), 0),
    "a helper": (FILE, write("helper.py", "FACTOR = 5.0"), 0),
    "a module in a package": (FILE, write("inside/deeper.py", "PART = 5.0"), 0),
    "a file opened while loading": (FILE, write("weights.json", '{"w": 5.0}'), 0),
    "a file that the card names": (FOLDER, write("listed.txt", "5"), 0),
    "the card": (FOLDER, write("method.yaml", CARD.replace("Mine", "Mine:scale=3")), 0),
    "the search of the card": (FOLDER, write("walk.py", WALK.replace("50.0 * best", "1.0 + 50.0 * best")), 0),
    "a file of the same length and time": (FILE, rewrite, 0),
    "a network that an option names": (NETWORK, write_network(-3.0), 0),
    "the content of an option": (OPTION, write("option.txt", "5"), 0),
    "a neighbour that is renamed": (FILE, lambda folder: (folder / "neighbour.py").rename(folder / "other.py"), 0),
    "a value in a tuned file": ("@tuned.json", tune(5.0), 0),
    "the code of a tuned file": ("@tuned.json", write("helper.py", "FACTOR = 5.0"), 0),
    "a method of a package": ("pkg_measure+argmax", write("site/pkg/parts.py", "FACTOR = -1.0"), 0),
    "weights of a package": ("pkg_measure+argmax", write("site/pkg/weights.txt", "5"), 0),
}


@pytest.mark.slow
@pytest.mark.daily(2)
@pytest.mark.parametrize("change", CHANGES)
def test_a_resumed_evaluation_equals_a_fresh_one(change, mine, dataset, monkeypatch):
    spec, apply, reused = CHANGES[change]
    if "net" in spec:
        pytest.importorskip("onnxruntime", reason="the extra onnx is not installed")
    stop_in_the_third(dataset, spec)
    close(spec)
    apply(mine)
    kept = KeptSequences("kept")
    resumed = evaluate(dataset, methods=[spec], keep=kept, draw=False)
    close(spec)
    fresh = evaluate(dataset, methods=[spec], draw=False)
    close(spec)
    assert kept.reused == reused
    assert rows(resumed) == rows(fresh)
    assert {record.judgement.status for record in fresh.records} == {"answered"}


@pytest.mark.slow
def test_code_does_not_cover_what_is_read_only_in_a_call(mine, dataset):
    """The card of a folder, an option, or reading it while loading makes a file a part of the code."""
    stop_in_the_third(dataset, FILE)
    write("called.txt", "5")(mine)
    kept = KeptSequences("kept")
    evaluate(dataset, methods=[FILE], keep=kept, draw=False)
    assert kept.reused == 2
    close(FILE)
