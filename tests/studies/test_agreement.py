"""The study of agreement between rankings, of one evaluation and of several."""

import pytest
from handmade_records import change, record

from saf_gen.benchmark.records import write_records
from studies.ranking.agreement import agreement, main


def board(shift=0, **more):
    """Records of eight methods in twelve scenes; methods with higher numbers, from ``shift`` on, solve fewer."""
    return [
        record(
            f"m{m}+s",
            f"s{s}-{i}",
            0.5 if (7 * ((m + shift) % 8) + 5 * s + 3 * i) % 16 > (m + shift) % 8 else 5.0,
            scene=f"scene{s:02d}",
            **more,
        )
        for m in range(8)
        for s in range(12)
        for i in range(4)
    ]


@pytest.fixture
def write(tmp_path):
    """A function that writes records as an evaluation, and returns its folder."""

    def write_evaluation(name, records):
        (tmp_path / name).mkdir()
        write_records(tmp_path / name / "records.jsonl", records)
        return tmp_path / name

    return write_evaluation


def test_regions_of_one_evaluation_and_of_two_compare_alike(write):
    target, frame = board(), [change(r, region="frame") for r in board(2)]
    both = write("both", [*target, *(change(r, method=f"{r.who.method}@frame") for r in frame)])
    (one,) = agreement([both], by="region")
    (two,) = agreement([write("target", target), write("frame", frame)], by="region")
    assert one == two
    assert (one.first, one.second, one.methods) == ("target", "frame", 8)
    assert -1 < one.tau < 1


def test_two_sensors_are_printed_and_nonsense_is_one_line(write, tmp_path, capsys):
    nominal = write("nominal", board(sensor="vidar_400x250"))
    noisy = write("noisy", [change(r, data=f"noisy-{r.what.data}") for r in board(sensor="vidar_400x250_noisy")])
    assert main([str(nominal), str(noisy), "--by", "sensor"]) == 0
    shown = capsys.readouterr().out
    assert "vidar_400x250_noisy" in shown
    assert "1.00 to 1.00" in shown
    assert main([str(nominal), "--by", "light"]) == 1
    assert "nothing to compare: one bin" in capsys.readouterr().err
    for arguments, message in (
        ([str(nominal), "--by", "sensr"], "did you mean 'sensor'"),
        ([str(tmp_path / "nowhere")], "there is no records.jsonl"),
    ):
        assert main(arguments) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert message in line
