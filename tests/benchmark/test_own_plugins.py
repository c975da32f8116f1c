"""A user's measure and search, from a file or from a package that is not installed."""

import re

import pytest
from own_plugins import PARTS
from refusals import assert_says, refusal

from saf_gen.benchmark.admission import admit_method, read_methods
from saf_gen.benchmark.method_spec import TunedMethod, format_tuned, parse_method
from saf_gen.errors import BadInput
from saf_gen.plugins.measures import get_measure
from saf_gen.plugins.searches import get_search


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "parts_of_a_test.py"
    path.write_text(PARTS)
    return path


def test_parts_of_a_package_are_found_by_python(own, monkeypatch):
    monkeypatch.syspath_prepend(own.parent)
    assert type(get_measure("parts_of_a_test:Range")).__name__ == "Range"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("{own}:Rnge", "parts_of_a_test.py has no 'Rnge'; allowed: .*did you mean 'Range'"),
        ("{own}:NoPart", "is not a plug-in; allowed: a function or a class"),
        ("nowhere.py:Range", "cannot be loaded: FileNotFoundError"),
        ("no_such.package:Range", "cannot be loaded: ModuleNotFoundError"),
        ("{own}:Range:powr=2", "unknown key.*'powr'.*did you mean 'power'"),
    ],
)
def test_a_plug_in_that_cannot_be_loaded_is_refused_in_one_line(own, name, message):
    with pytest.raises(BadInput, match=message) as caught:
        parse_method(f"{name.format(own=own)}+argmax")
    assert "\n" not in str(caught.value)


def test_a_file_that_raises_is_refused_and_can_be_mended(tmp_path):
    path = tmp_path / "broken.py"
    path.write_text("1 / 0\n")
    assert_says(refusal(get_measure, f"{path}:Range"), "ZeroDivisionError: division by zero")
    path.write_text(PARTS)
    assert get_measure(f"{path}:Range")


RUNS = """\
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

with suppress(OSError):  # a guest is shut in
    Path({trace!r}).write_text("run")

@dataclass(frozen=True)
class Part:
    degree = 1

    def __call__(self, counts):
        return float(counts.sum())
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "kind"),
    [
        ("{code}+argmax", "tuned file"),
        ("{code}_n+argmax", "list"),
        ("sd+{code}", "list"),
        ("sd+coarse_to_fine:far={code}", "tuned file"),
        ("module", "list"),
    ],
)
def test_a_file_runs_no_code_that_the_command_line_does_not_name(tmp_path, monkeypatch, form, kind):
    """Tuned files and lists of methods may be untrusted, and come with the code that they name."""
    path, trace = tmp_path / f"package_{kind[:4]}" / "parts.py", tmp_path / "trace"
    path.parent.mkdir()
    path.write_text(RUNS.format(trace=str(trace)))
    monkeypatch.syspath_prepend(tmp_path)
    method = f"{path.parent.name}.parts:Part+argmax" if form == "module" else form.format(code=f"{path}:Part")
    file = tmp_path / "theirs"
    if kind == "list":
        file.write_text(f"sd+argmax\n{method}\n")
    else:
        file.write_text(format_tuned(TunedMethod(method, "d", "train", "recorded", "", "target", 1, "0", "0", ())))

    def read():
        return read_methods(file) if kind == "list" else admit_method(f"@{file}")

    error = refusal(read)
    assert_says(error, "names the code | registered names in files | name it in a separate --method")
    assert not trace.exists()
    if form.startswith("{code}") or form == "module":  # code that the command line has named before may be used
        get_measure(method.split("+")[0].removesuffix("_n"))
        assert trace.exists()
        assert read()


LONG = """\
from dataclasses import dataclass

@dataclass(frozen=True)
class Network:
    \"\"\"A network whose weights are constants.\"\"\"

    window: int = 3
    weights: str = "{sign}" * {count}

    def __call__(self, counts):
        return float(counts.sum())
"""


@pytest.mark.slow
def test_a_record_states_long_constants_by_their_length_and_digest(tmp_path):
    stated = {}
    for name, sign, count in (("short", "a", 400), ("long", "a", 1_000_000), ("other", "b", 1_000_000)):
        path = tmp_path / f"{name}.py"
        path.write_text(LONG.format(sign=sign, count=count))
        stated[name] = parse_method(f"{path}:Network+argmax").parameters
    assert stated["short"] == f"Network(window=3, weights='{'a' * 400}') + {get_search('argmax')!r}"
    assert re.match(r"Network\(window=3, weights=<1,000,002 characters, [0-9a-f]{12}>\) \+ Argmax\(", stated["long"])
    assert stated["other"] not in (stated["long"], stated["short"])
    assert admit_method(f"{tmp_path / 'long.py'}:Network+argmax").parameters == stated["long"]
