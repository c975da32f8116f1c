"""The comparison of cameras: which recordings count, what is best, and how far it is ahead."""

import lzma
from pathlib import Path

import numpy as np
import pytest
from handmade_records import change, failed, record

from saf_gen.benchmark.records import write_records
from studies.ranking.cameras import bits_per_pixel, interval, main
from studies.ranking.packed_records import write_packed_records

MEMBERS = 12


def answers(method, wrong, *, without=()):
    """Records of 24 recordings of 12 members; the numbers of those that are wrong, and of those without an answer."""
    for number in range(2 * MEMBERS):
        name = f"m{number // 2}-{'constant' if number % 2 else 'dim'}"
        obstacle = "focus not reached" if number in without else None
        yield record(method, name, 3.0 if number in wrong else 0.2, obstacle=obstacle)


@pytest.fixture
def write(tmp_path):
    def write_evaluation(name, *records):
        (tmp_path / name).mkdir()
        write_records(tmp_path / name / "records.jsonl", [one for part in records for one in part])
        return f"{name}={tmp_path / name}"

    return write_evaluation


def test_the_best_of_each_camera_is_compared_over_the_recordings_of_all(write, capsys):
    spikes = write("spikes", answers("a+s", {0}), answers("b+s", {0, 1, 2}))
    photons = write("photons", answers("a+s", {4, 5, 6, 7, 8}), answers("c+s", set(range(12))))
    events = write("events", answers("d+s", {0}, without={20, 21}))
    assert main([spikes, photons, events]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "22 recordings of 11 members have an answer with every camera."
    assert any(line.startswith("| spikes | `a+s` | 95% | 95% |") for line in lines)
    assert any(line.startswith("| photons: `a+s` | +18 |") for line in lines)
    assert any(line.startswith("| events: `d+s` | +0 | +0 to +0 |") for line in lines)
    assert [line.split(" | ")[6:8] for line in lines if line.startswith("| events | ")] == [["2 of 2", "0.79"]]


def test_recordings_that_another_camera_lacks_are_no_false_answers(write, capsys):
    """23 right of 24, but for 2 that cannot be answered, of which the others have seen none."""
    spikes = write("spikes", answers("a+s", {0}, without={22, 23}))
    photons = write("photons", list(answers("a+s", {0}))[:22])
    assert main([spikes, photons]) == 0
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if "`a+s`" in line]
    assert [row[6:8] for row in rows[:2]] == [["0 of 0", "0.95"]] * 2


def test_in_one_packed_file_sensors_tell_cameras_apart(tmp_path, capsys):
    records = [change(one, sensor="vidar_128x128") for one in answers("a+s", {0})]
    records += [change(one, sensor="imx273") for one in answers("a+s", {0, 1, 2})]
    packed = tmp_path / "both.xz"
    write_packed_records(packed, records)
    assert main([str(packed)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("| vidar_128x128 | `a+s` | 96% | 96% |") for line in lines)
    assert any(line.startswith("| imx273: `a+s` | +8 |") for line in lines)


@pytest.mark.parametrize("content", [None, b"", b"{}", lzma.compress(b"{}\n")[:-9], lzma.compress(b"{}\n")])
def test_a_packed_file_that_holds_no_records_is_one_line(tmp_path, content, capsys):
    packed = tmp_path / "records.xz"
    if content is not None:
        packed.write_bytes(content)
    assert main([str(packed)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1


def test_a_recording_that_a_method_failed_on_is_not_one_that_it_solved(write, capsys):
    spikes = write("spikes", answers("a+s", set()))
    photons = write("photons", answers("a+s", set(range(24))), [failed("b+s", "m0-dim", "failed")])
    assert main([spikes, photons]) == 0
    assert "| photons | `b+s` | 0% | 0% |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("sensor", "bits"),
    [
        ("vidar_128x128", 300),
        ("qvga_spad", 300),
        ("imx273", 3600),
        ("imx273#88a75e", 3600),  # a preset that was changed
        ("davis346", 0.01 * 300 * 64),
    ],
)
def test_bits_leave_the_chip_as_the_kind_of_the_sensor_says(sensor, bits):
    seen = change(record("a+s", "m0-dim", 0.2), sensor=sensor, frames_seen=300, mean_rate=0.01)
    assert bits_per_pixel(seen) == pytest.approx(bits)


def test_bits_of_an_unknown_sensor_are_unknown():
    assert np.isnan(bits_per_pixel(change(record("a+s", "m0-dim", 0.2), sensor=None)))


@pytest.mark.slow
def test_an_interval_holds_the_mean_of_members_as_often_as_it_says():
    """200 draws of 40 members, seed 5: 95 % intervals miss the mean 4 to 22 times but once in 500 tests."""
    random, missed = np.random.default_rng(5), 0
    for _ in range(200):
        member = random.random(40) < 0.7
        values = (np.repeat(member, 2) ^ (random.random(80) < 0.1)).astype(float)
        _, low, high = interval(values, [f"m{number // 2}" for number in range(80)])
        missed += not low <= 0.7 * 0.9 + 0.3 * 0.1 <= high
    assert 4 <= missed <= 22


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{spikes}"], "1 camera is given"),
        (["spikes", "{spikes}"], "NAME=EVALUATION"),
        (["{spikes}", "photons=missing"], "missing"),
        (["{spikes}", "{other}"], "no recording has an answer in all"),
    ],
)
def test_what_cannot_be_compared_is_one_line(write, arguments, words, capsys):
    given = {"spikes": write("spikes", answers("a+s", set())), "other": write("other", [record("a+s", "x-dim", 0.1)])}
    assert main([argument.format(**given) for argument in arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
    assert words in printed.err
    assert Path("missing").exists() is False
