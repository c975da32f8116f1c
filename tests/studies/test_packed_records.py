"""Records that are kept beside pages of results: packed, they lose their traces and nothing else."""

import lzma
import math
from pathlib import Path

import pytest
from handmade_records import change, failed, record

from saf_gen.benchmark.records import read_records, write_records
from studies.ranking.packed_records import main, read_packed_records, write_packed_records

KEPT = sorted(Path("studies/results").glob("*-records.xz"))


def records():
    """Answers with traces; one without truth, two without answer."""
    answers = [record("a+s", f"s{n}", math.sin(n), optimum=0.1 * n, trace=(1.0, 2.5)) for n in range(9)]
    return [*answers, record("a+s", "s9", None), failed("b+s", "s0", "failed"), failed("b+s", "s1", "abstained")]


def test_packed_records_come_back_bit_for_bit_but_for_their_traces(tmp_path):
    write_packed_records(tmp_path / "some.xz", records())
    found = read_packed_records(tmp_path / "some.xz")
    assert list(map(repr, found)) == [repr(change(one, trace=())) for one in records()]


def test_the_command_packs_records_and_writes_them_again_as_saf_gen_reads_them(tmp_path):
    plain, packed, again = (tmp_path / name for name in ("records.jsonl", "records.xz", "again.jsonl"))
    write_records(plain, [record("a+s", f"s{n}", 0.2 * n) for n in range(9)])
    assert main([str(plain), str(packed)]) == main([str(packed), str(again)]) == 0
    assert read_records(again) == read_records(plain)


def test_records_of_another_format_are_refused_in_one_line(tmp_path, capsys):
    old = tmp_path / "old.xz"
    old.write_bytes(lzma.compress(b'{"format":"saf-gen record 1"}\n'))
    assert main([str(old), str(tmp_path / "records.jsonl")]) == 2
    printed = capsys.readouterr().err
    assert "allowed: saf-gen record " in printed
    assert len(printed.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_records_beside_the_pages_can_be_read(path):
    assert len(read_packed_records(path)) >= 400
