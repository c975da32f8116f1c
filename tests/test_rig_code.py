"""Which files the digest of the rig is over, and what moves it."""

import shutil
from pathlib import Path

import pytest
from sweeps import write_sweep

import saf_gen
from saf_gen.contest import rig_code as module
from saf_gen.contest.rig_code import ELSEWHERE, rig_code, rig_files
from saf_gen.evaluate import evaluate
from saf_gen.leaderboard import merged

PACKAGE = Path(saf_gen.__file__).parent
TRACKS = ("recorded", "closed_loop")


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A copy of saf_gen's files, elsewhere."""
    folder = tmp_path_factory.mktemp("elsewhere") / "saf_gen"
    return shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__", "assets"))


@pytest.fixture
def changed(package):
    """The digests of both tracks, after a change of a file; it is undone."""
    undo = {}

    def digests(name, change):
        path = package / name
        undo[path] = path.read_bytes() if path.exists() else None
        path.write_bytes(change(undo[path] or b""))
        rig_code.cache_clear()
        return [rig_code(track, package) for track in TRACKS]

    yield digests
    for path, before in undo.items():
        path.unlink() if before is None else path.write_bytes(before)
    rig_code.cache_clear()


def names(track):
    return {name for name, _ in rig_files(track)}


def test_the_same_files_elsewhere_give_the_same(package):
    for track in TRACKS:
        assert rig_code(track, package) == rig_code(track)
        assert len(rig_code(track)) == 12
    assert rig_code("recorded") != rig_code("closed_loop")


@pytest.mark.parametrize(
    ("name", "moves"),
    [
        ("rig/intervals.py", (True, True)),  # the input of NAME_tfi
        ("rig/counts.py", (True, True)),
        ("rig/scoring.py", (True, True)),
        ("scores.py", (True, True)),
        ("bits.py", (True, True)),
        ("contest/recorded.py", (True, False)),
        ("contest/predictions.py", (True, False)),
        ("contest/loop.py", (False, True)),
        ("contest/terms.py", (False, True)),
        ("contest/verdict.py", (False, True)),
        ("rig/film.py", (False, True)),
        ("rig/live.py", (False, True)),
        ("rig/sweep.py", (False, True)),
        ("actuators/lens.py", (False, True)),
        ("actuators/response.py", (False, True)),
        ("actuators/presets/voice_coil.yaml", (False, True)),
        ("actuators/presets/hand.yaml", (False, True)),
        ("camera/kernel.py", (False, True)),
        ("gym/episode.py", (False, True)),
        ("gym/pictures.py", (False, True)),
        ("rig/thumbnails.py", (False, False)),
        ("measures/sd.py", (False, False)),
        ("searches/egs.py", (False, False)),
        ("report/page.py", (False, False)),
        ("errors.py", (False, False)),
        ("records.py", (False, False)),
    ],
)
def test_a_change_moves_the_digest_of_the_tracks_that_it_decides(changed, name, moves):
    found = changed(name, lambda text: text + b"\n# another\n")
    assert tuple(now != rig_code(track) for now, track in zip(found, TRACKS, strict=True)) == moves


@pytest.mark.parametrize("name", ["rig/counts.py", "actuators/presets/stepper.yaml"])
def test_how_lines_end_moves_nothing(changed, name):
    found = changed(name, lambda text: text.replace(b"\n", b"\r\n"))
    assert found == [rig_code(track) for track in TRACKS]


def test_a_module_that_the_rig_begins_to_import_is_of_it_without_being_listed(changed):
    changed("rig/_new.py", lambda _: b"HALF = 0.5\n")
    before = changed("rig/counts.py", lambda text: text + b"\nfrom saf_gen.rig import _new\n")
    after = changed("rig/_new.py", lambda _: b"HALF = 0.6\n")
    assert all(one != other for one, other in zip(before, after, strict=True))


def test_what_is_left_out_is_there_and_left_out_for_a_reason():
    for name, why in ELSEWHERE.items():
        place = PACKAGE.joinpath(*name.split("."))
        assert place.is_dir() or place.with_suffix(".py").is_file(), name
        assert why


def test_every_file_that_turns_a_command_into_a_picture_is_of_the_loop():
    for room in ("actuators", "camera"):
        for path in (PACKAGE / room).glob("*.py"):
            assert f"{room}/{path.name}" in names("closed_loop")
    presets = {f"actuators/presets/{p.name}" for p in (PACKAGE / "actuators" / "presets").iterdir()}
    assert presets <= names("closed_loop")


def test_it_is_worked_out_once_a_process(monkeypatch):
    rig_code.cache_clear()
    asked = []
    monkeypatch.setattr(module, "rig_files", lambda *given: asked.append(given) or [])
    assert rig_code("recorded") == rig_code("recorded")
    assert len(asked) == 1
    monkeypatch.undo()
    rig_code.cache_clear()


def test_records_carry_it_and_predictions_merge_with_methods_of_the_same_version(tmp_path):
    write_sweep(tmp_path / "a.h5", 300.0)
    (tmp_path / "p.jsonl").write_text('{"method": "my_net", "sequence": "a", "frame": 300}\n')
    ours = evaluate(tmp_path / "a.h5", methods=["sd_tfi+argmax"]).records
    theirs = evaluate(tmp_path / "a.h5", methods=[], predictions=tmp_path / "p.jsonl").records
    assert {r.rig for r in (*ours, *theirs)} == {rig_code("recorded")}
    assert len(merged({"ours": ours, "theirs": theirs})) == 2
