"""Somebody's own measure and search, from a file or a package that is installed nowhere."""

import pytest
from own_plugins import PARTS
from planted_sweeps import write_sweep
from refusals import assert_says, refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.errors import BadInput
from saf_gen.measures import get_measure


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "parts_of_a_test.py"
    path.write_text(PARTS)
    write_sweep(tmp_path / "a.h5", 300.0)
    return path


def test_parts_of_a_file_run_beside_the_others(own):
    spec = f"{own}:Range:power=2+{own}:Middle"
    records = evaluate(own.parent / "a.h5", methods=[spec, f"{own}:Range_n+argmax", "sd+argmax"]).records
    assert [r.frame for r in records][:1] == [399.5]
    assert records[0].method == spec
    assert abs(records[1].frame - 300) < 100
    assert records[0].code != parse_method(f"{own}:Range+{own}:Middle").code


def test_parts_of_a_package_are_found_by_python(own, monkeypatch):
    monkeypatch.syspath_prepend(own.parent)
    assert type(get_measure("parts_of_a_test:Range")).__name__ == "Range"


def test_a_change_in_the_file_changes_the_code_of_the_method(own, tmp_path):
    other = tmp_path / "other.py"
    other.write_text(PARTS.replace("np.ptp", "np.var"))
    assert parse_method(f"{own}:Range+argmax").code != parse_method(f"{other}:Range+argmax").code


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("{own}:Rnge", "cannot be loaded: AttributeError.*'Rnge'.*allowed: package.module:Class"),
        ("{own}:NoPart", "is not a plug-in; allowed: a frozen dataclass"),
        ("nowhere.py:Range", "cannot be loaded: FileNotFoundError"),
        ("no_such.package:Range", "cannot be loaded: ModuleNotFoundError"),
        ("{own}:Range:powr=2", "unknown key.*'powr'.*did you mean 'power'"),
    ],
)
def test_what_cannot_be_loaded_is_told_in_one_line(own, name, message):
    with pytest.raises(BadInput, match=message) as caught:
        parse_method(f"{name.format(own=own)}+argmax")
    assert "\n" not in str(caught.value)


def test_a_file_that_breaks_is_told_and_can_be_mended(tmp_path):
    path = tmp_path / "broken.py"
    path.write_text("1 / 0\n")
    assert_says(refusal(get_measure, f"{path}:Range"), "ZeroDivisionError: division by zero")
    path.write_text(PARTS)
    assert get_measure(f"{path}:Range")
