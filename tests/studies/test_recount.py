"""The recount by other code agrees with the leaderboard, and finds what is wrong in it."""

import csv
import json
import subprocess
import sys

import h5py
import numpy as np
import pytest
from handmade_evaluations import write_board
from handmade_records import failed, record
from planted_sweeps import write_three_sweeps

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import read_records
from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard import Leaderboard
from saf_gen.leaderboard.report import write_evaluation
from studies.ranking.recount import inside, main

LENS = (np.arange(801) - 400) / 800  # as in handmade records, whose truth is 0 and whose depth of focus is an eighth
SIZE = 40, 60
BOX = 5, 33, 6, 50


def write_stream(path, *, region, stratum, **more):
    """Write what a recount reads of a stream whose region has this stratum."""
    target, best = np.zeros(SIZE, bool), np.zeros(SIZE, np.float32)
    top, bottom, left, right = BOX
    target[top - 3 : bottom + 3, left - 3 : right + 3] = True
    if stratum == "60 to 80 %":
        target[20:, 29:] = False  # of 34 × 50 pixels, 16 × 24 less
    best[:, : left + 5] = 0.07 if stratum == "relief" else 0.0625
    held = {"position": 0.0, "depth_of_focus": (0.0625, -0.0625), "target": target, "best_position": best}
    held |= {"inside": BOX} if region == "inside" else {}
    with h5py.File(path, "w") as file:
        file["focus/position"] = LENS.astype(np.float32)
        for name, value in (held | more).items():
            file[f"truth/{name}"] = value


def write_both(folder, *, region="inside", scenes=20, methods=6, strata=("one depth", "relief")):
    """Write a dataset and an evaluation of methods whose rates are 0.95, 0.8, … down to 0.2."""
    random, records, listed = make_generator("test_recount", region, scenes), [], []
    for number in range(scenes):
        hard = random.random()
        for light in ("dim", "bright"):
            name, stratum = f"s{number:02d}-{light}", strata[number % len(strata)]
            write_stream(folder / f"{name}.h5", region=region, stratum=stratum)
            listed.append({"id": name, "file": f"{name}.h5"})
            known = {"scene": f"scene{number:02d}", "light": light, "region": region, "stratum": stratum}
            for m in range(methods):
                right = random.random() ** 2 + 0.3 * hard < 0.95 - 0.15 * m
                error = float(random.uniform(-0.9, 0.9) if right else random.choice([-1.5, 1.7, 3.0]))
                lost = min(abs(error) / 15, 1.0)
                more = known | {"sharpness_lost": lost}
                records.append(
                    failed(f"m{m}+s", name, "abstained", **known)
                    if random.random() < 0.05
                    else record(f"m{m}+s", name, error, **more)
                )
    (folder / "manifest.json").write_text(json.dumps({"sequences": listed}))
    write_board(folder / "out", records)
    return folder, folder / "out"


def change(evaluation, file, old, new):
    text = (evaluation / file).read_text()
    assert old in text
    (evaluation / file).write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("region", "scenes", "strata"),
    [
        ("inside", 20, ("one depth", "relief")),
        ("target", 9, ("80 % and more", "60 to 80 %")),
        ("inside", 2, ("relief",)),
    ],
)
def test_a_leaderboard_is_confirmed(tmp_path, region, scenes, strata, capsys):
    dataset, evaluation = write_both(tmp_path, region=region, scenes=scenes, strata=strata)
    assert main(dataset, evaluation) == 0, capsys.readouterr().out
    assert capsys.readouterr().out.startswith("differences: 0; ")


@pytest.mark.parametrize(
    "name",
    [
        *("answerable_1dof", "answerable_half_dof", "answerable_2dof", "answerable_lost_5"),
        *("answerable_1dof_low", "answerable_1dof_high", "level_with_best"),
    ],
)
def test_a_planted_difference_is_found(tmp_path, name, capsys):
    dataset, evaluation = write_both(tmp_path)
    path = evaluation / "leaderboard.csv"
    rows = list(csv.DictReader(path.read_text().splitlines()))
    last = rows[-1]
    planted = "True" if last[name] == "False" else str(float(last[name]) - 0.01)
    last[name] = planted
    with path.open("w") as file:
        writer = csv.DictWriter(file, last.keys())
        writer.writeheader()
        writer.writerows(rows)
    assert main(dataset, evaluation) == 1
    found = capsys.readouterr().out
    assert found.startswith(f"{last['method']}: {name} is {planted}, not ")
    assert "\ndifferences: 1; " in found


def test_a_wrong_stratum_and_a_wrong_rectangle_are_found(tmp_path, capsys):
    dataset, evaluation = write_both(tmp_path)
    change(evaluation, "records.jsonl", '"stratum": "relief"', '"stratum": "one depth"')
    write_stream(tmp_path / "s00-dim.h5", region="inside", stratum="one depth", inside=(5, 33, 7, 50))
    assert main(dataset, evaluation) == 1
    found = capsys.readouterr().out
    assert "stratum one depth, not relief" in found
    assert "s00-dim: /truth/inside is (5, 33, 7, 50), not (5, 33, 6, 50)" in found


def test_the_files_of_an_evaluation_are_read_as_they_are_written(tmp_path):
    """By its command, without saf_gen."""
    found = evaluate(write_three_sweeps(tmp_path), methods=["sd+argmax", "sd+middle", "er_count+argmax"])
    write_evaluation(tmp_path / "out", Leaderboard.of(found), title="three")
    assert read_records(tmp_path / "out")
    code = "import sys; from studies.ranking.recount import main; from pathlib import Path; "
    code += "sys.exit(main(*map(Path, sys.argv[1:])) or 'saf_gen' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code, tmp_path, tmp_path / "out"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "differences: 0; too close to compare: 0\n"), done.stderr


def test_the_largest_rectangle_against_all_of_them():
    """Every rectangle of 20 random masks of 33 × 36 pixels, half of them too small; seed below."""
    random = make_generator("test_recount", "rectangles")
    for _ in range(20):
        mask = np.ones((33, 36), bool)
        for row, column in random.integers(0, (33, 36), (int(random.integers(0, 3)), 2)):
            mask[row, column] = False
        best = (0, 0, 0, 0), (0, 0, 0, 0)  # erosion by 3 pixels moves each side of a rectangle by 3
        for top in range(34):
            for bottom in range(top + 30, 34):
                for left in range(37):
                    for right in range(left + 30, 37):
                        if mask[top:bottom, left:right].all():
                            rank = (bottom - top - 6) * (right - left - 6), -top, -left, bottom - top
                            best = max(best, (rank, (top + 3, bottom - 3, left + 3, right - 3)))
        assert inside(mask) == best[1]
