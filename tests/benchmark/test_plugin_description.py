"""Descriptions of measures and searches on report pages: of methods that ran, and of records with the same code."""

from dataclasses import replace

import pytest
from handmade_records import change, record

from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.plugin_description import describe_plugins, describe_recorded

MEASURE = '''
from dataclasses import dataclass
from pathlib import Path

Path({mark!r}).write_text("ran")

@dataclass(frozen=True)
class Sum:
    """Σc."""
    degree = 1
    source = "nobody, doi:10.1000/182"

    def __call__(self, counts):
        return float(counts.sum())
'''


@pytest.fixture
def own_file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(MEASURE.format(mark=str(tmp_path / "mark")))
    return path


def test_a_method_is_described_by_what_it_states_and_by_the_files_that_it_is_made_of():
    measure, search = describe_plugins([parse_method("sd_code_tfi+egs_code:threshold=50@frame")])
    assert (measure.plugin_kind, measure.name) == ("measures", "sd_code_tfi")
    facts = dict(measure.facts)
    assert "Σ(c − ū)²/ū²" in facts["what"]
    assert "texture from intervals" in facts["what"]
    assert "doi:10.1109/CVPR52733.2024.02363" in facts["source"]
    assert [name for name, _ in measure.code] == ["sd_code.py", "_moments.py", "_counts.py"]
    assert "class SpikeDispersionCode" in measure.code[0][1]
    assert (search.plugin_kind, search.name) == ("searches", "egs_code:threshold=50")
    assert "threshold=50 (default:" in dict(search.facts)["options"]


def test_a_measure_or_search_that_methods_share_is_described_once():
    described = describe_plugins(map(parse_method, ("sd+argmax", "sd+egs_code", "cen+argmax", "sd+argmax:window=50")))
    assert [d.name for d in described] == ["sd", "cen", "argmax", "egs_code", "argmax:window=50"]


def test_recorded_methods_are_described_only_where_their_code_is_the_same():
    known, other = parse_method("sd+argmax"), parse_method("cen+argmax")
    records = [
        change(record("sd+argmax", "a", 0.0), code=known.code),
        change(record("cen+argmax", "a", 0.0), code=other.code[::-1]),
        record("my_net", "a", 0.0),
        record("sd+no_such_search", "a", 0.0),
        record("sd+argmax:no_such_option=1", "a", 0.0),
    ]
    assert [d.name for d in describe_recorded(records)] == ["sd", "argmax"]


def test_recorded_forms_of_measures_are_described(register):
    names = ("gradient_code_n+argmax", "sd_tfi+argmax", "gradient_code_n_tfi+argmax", "cen_no+argmax", "_n+argmax")
    known = {name: parse_method(name).code for name in names[:3]}
    records = [change(record(name, "a", 0.0), code=known.get(name, "x")) for name in names]
    described = [d.name for d in describe_recorded(records)]
    assert described == ["gradient_code_n", "sd_tfi", "gradient_code_n_tfi", "argmax"]
    register("measures", "sd_tfi", lambda counts: 0.0)  # somebody's own, by the full name
    assert "sd_tfi" not in [d.name for d in describe_recorded(records)]


def test_records_run_no_code_that_they_name(own_file):
    records = [
        record(name, "a", 0.0) for name in ("mine.py:Sum+argmax", "sd+mine.py:Sum", "@mine.py", "mine:Sum+argmax")
    ]
    assert describe_recorded(records) == ()
    assert not (own_file / "mark").exists()


def test_what_cannot_describe_itself_stops_no_evaluation():
    class Sulking:
        """Σc."""

        degree = 0

        @property
        def halves(self):
            raise RuntimeError("no")

    known = parse_method("sd+argmax")
    measure, search = describe_plugins([replace(known, measure=Sulking())])
    assert measure.facts == (("what", "it cannot be described: RuntimeError: no"),)
    assert search.name == "argmax"
