"""A malicious dataset: nothing outside it is read, and nothing in it is run."""

import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from browser import CHROMIUM, NO_CHROMIUM, run_in_page
from handmade_records import change

from saf_gen.benchmark.records import format_records, read_records
from saf_gen.stream.dataset import index_folder
from saf_gen.stream.manifest import read_manifest, write_manifest
from saf_gen.stream.stream_writer import write_stream

SECRET = "only for the owner of this machine"
SCRIPT = "<script>window.hit=1;fetch('http://127.0.0.1:9/')</script><img src=x onerror='window.hit=1'>"
BITE = f"{SCRIPT}\x1b[2J\x1b]0;owned\x07\u202e|`x`[y](javascript:window.hit=1)\n=cmd|'/C calc'!A0"
CODE = "import pathlib\npathlib.Path('ran').touch()\nclass Evil:\n    pass\n"
DEEP = "[" * 100_000
FRAMES, ROWS, COLUMNS = 400, 16, 16


def link_outside(file):
    del file["truth/depth"]
    file["truth/depth"] = h5py.ExternalLink("../../secret.h5", "/secret")


def store_outside(file):
    del file["focus/position"]
    file.create_dataset("focus/position", (20,), "u1", external=[("../../secret.txt", 0, 20)])


def be_virtual(file):
    layout = h5py.VirtualLayout(shape=(ROWS, COLUMNS, 50), dtype="uint8")
    layout[...] = h5py.VirtualSource("../../secret.h5", "spikes", shape=layout.shape)
    attributes = dict(file["spikes"].attrs)
    del file["spikes"]
    file.create_virtual_dataset("spikes", layout).attrs.update(attributes)


def be_huge(file):
    del file["truth/sharpness"]
    file.create_dataset("truth/sharpness", (1 << 40,), "f8", chunks=(1 << 20,))


def claim_code(file):
    file["provenance/scene.py"] = CODE


ATTACKS = {"link": link_outside, "stored": store_outside, "virtual": be_virtual, "huge": be_huge}
INTACT = ("plain", "bites", "deep")


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """The user's folder with a secret and the malicious dataset."""
    folder = tmp_path_factory.mktemp("desk")
    (folder / "secret.txt").write_text(f"{SECRET}\n" * 10)
    with h5py.File(folder / "secret.h5", "w") as secret:
        secret["secret"] = np.frombuffer(SECRET.encode(), np.uint8)
        secret["spikes"] = np.zeros((ROWS, COLUMNS, 50), np.uint8)
    data, rng = folder / "data", np.random.default_rng(11)
    for name in (*INTACT, *ATTACKS):
        bites = name != "plain"
        write_stream(
            data / "test" / f"{name}.h5",
            (rng.random((FRAMES, ROWS, COLUMNS)) < 0.3).astype(np.uint8),
            focus_position=np.linspace(0, 1, FRAMES),
            gain=np.ones((FRAMES, 2)),
            light_names=(BITE, "file.py:Evil") if bites else ("sun", "sky"),
            truth={"position": 0.5, "depth_of_focus": (0.4, 0.6), "frame": 199.5, "depth": np.ones((ROWS, COLUMNS)),
                   "sharpness": np.arange(9.0)},
            provenance={"sequence": DEEP, "grain": DEEP, "versions": BITE} if name == "deep"
            else {"recipe": BITE, "sequence": json.dumps({"scene": BITE, "light": "evil.py:Evil"}), "note": BITE},
        )  # fmt: skip
    index_folder(data)
    for name, attack in ATTACKS.items():
        with h5py.File(data / "test" / f"{name}.h5", "r+") as file:
            attack(file)
            claim_code(file)
            file.attrs.pop("spikes_sha256")
    manifest = read_manifest(data)
    spoiled = tuple(
        replace(entry, id=f"{n} {BITE}", scene=f"{n} {BITE}", light=BITE, split="test")
        for n, entry in enumerate(manifest.sequences)
    )
    write_manifest(data, replace(manifest, name=BITE, sequences=spoiled))
    (data / "evil.py").write_text(CODE)
    (data / "scenes/evil").mkdir(parents=True)
    (data / "scenes/evil/scene.py").write_text(CODE)
    (data / "methods.txt").write_text("data/evil.py:Evil+argmax\n")
    (data / "plugins").mkdir()
    return folder


@pytest.fixture
def at_desk(desk, monkeypatch, call):
    """Run a command there, and check that it prints no secret and no terminal control, and ran no code."""
    monkeypatch.chdir(desk)

    def run(*arguments):
        before = {p for p in desk.rglob("*") if "judged" not in p.parts and "merged" not in p.parts}
        code, out, err = call(*arguments)
        printed = out + err
        assert SECRET not in printed
        assert not any(sign in printed for sign in "\x1b\x07\u202e\x9b")
        assert "Traceback" not in printed
        assert not list(desk.rglob("ran"))
        assert {p for p in desk.rglob("*") if "judged" not in p.parts and "merged" not in p.parts} == before
        return code, out, err

    return run


def evaluated(desk, at_desk):
    if not (desk / "judged").exists():
        at_desk("evaluate", "data", "--method", "sd+argmax", "--method", "er_sumsq+sgfs_code", "--out", "judged")
    return desk / "judged"


@pytest.mark.slow
def test_intact_sequences_are_evaluated_and_the_others_are_named(desk, at_desk):
    shutil.rmtree(desk / "judged", ignore_errors=True)
    code, _, err = at_desk(
        "evaluate", "data", "--method", "sd+argmax", "--method", "er_sumsq+sgfs_code", "--out", "judged"
    )
    assert code == 1
    assert sum("could not be evaluated: " in line for line in err.splitlines()) == len(ATTACKS)
    assert len(read_records(desk / "judged")) == 2 * len(INTACT)
    for path in (desk / "judged").rglob("*"):
        if path.is_file():
            assert SECRET.encode() not in path.read_bytes()


@pytest.mark.slow
def test_each_stream_is_inspected_and_the_dataset_verified(desk, at_desk):
    for name in (*INTACT, *ATTACKS):
        for options in ((), ("--json",)):
            code, _, err = at_desk("inspect", f"data/test/{name}.h5", *options)
            assert code == (2 if name in ATTACKS else 0), name
            assert len(err.splitlines()) == (name in ATTACKS)
    code, out, err = at_desk("verify", "data")
    assert (code, len(err.splitlines())) == (1, len(ATTACKS))
    assert f"{len(INTACT)} of {len(INTACT) + len(ATTACKS)} sequences are intact" in out


def test_untrusted_evaluations_are_merged_without_harm(desk, at_desk):
    mine = evaluated(desk, at_desk)
    theirs = desk / "judged" / "theirs"
    theirs.mkdir(exist_ok=True)
    records = [
        change(r, method=f"{BITE}+argmax", code="x", note=BITE, parameters="evil.py:Evil", machine=BITE)
        for r in read_records(mine)
        if r.who.method == "sd+argmax"
    ]
    (theirs / "records.jsonl").write_text(format_records(records), encoding="utf-8")
    code, _, _ = at_desk("leaderboard", "merge", "judged", "judged/theirs", "--out", "merged")
    assert code == 0
    page = (desk / "merged/index.html").read_text(encoding="utf-8")
    assert "<script>window" not in page
    assert "<img src=x" not in page


def test_no_file_of_the_dataset_can_name_code(desk, at_desk):
    for name in ("data/evil.py:Evil+argmax", "os.path:join+argmax"):
        (desk / "data/methods.txt").write_text(f"{name}\n")
        code, _, err = at_desk("evaluate", "data", "--methods", "data/methods.txt", "--out", "judged")
        assert code == 2
        assert "names the code" in err


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_the_page_runs_none_of_its_code_in_chromium(desk, at_desk, tmp_path):
    """Only the page itself is requested from its server; the names are text on it."""
    evaluated(desk, at_desk)
    shutil.copytree(desk / "judged", tmp_path / "page")
    answer = run_in_page(
        tmp_path / "page",
        "await new Promise((done) => setTimeout(done, 300));"
        "return { hit: window.hit ?? null, images: page.querySelectorAll('img[src=\"x\"]').length,"
        " text: page.body.textContent.includes('<script>window.hit=1') };",
    )
    assert answer == {"hit": None, "images": 0, "text": True}
