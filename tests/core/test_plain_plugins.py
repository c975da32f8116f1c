"""Plain functions and classes as plug-ins: their parameters are options; missing statements are found or assumed."""

import os
import subprocess
import sys

import numpy as np
import pytest
from planted_sweeps import write_sweep
from refusals import assert_says, refusal

import saf_gen
from saf_gen.benchmark.conformance import check_by_name
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.plugins.measures import get_measure

PLAIN = '''
import numpy as np

import saf_gen
from saf_gen.parts import Answer


def spread(counts, power=1, *, scale=2.0):
    """Standard deviation."""
    return scale * np.std(counts.astype(float)) ** power


def highest(counts):
    return int(counts.max())


class Contrast:
    """Relative standard deviation."""

    source = "nobody"

    def __init__(self, power=1):
        self.exponent = power

    def __call__(self, counts):
        mean = counts.mean()
        return (counts.astype(float).std() / mean) ** self.exponent if mean else 0.0


class Middle:
    """The middle of the first frames."""

    def __init__(self, frames):
        self.frames = frames

    def __call__(self, view):
        return Answer((min(self.frames, view.frames) - 1) / 2)


def last(view):
    """The last frame."""
    return Answer(view.frames - 1)


def needs(counts, exponent):
    return float(counts.max()) ** exponent


class Stopped:
    def __init__(self):
        raise RuntimeError("no camera")

    def __call__(self, counts):
        return 0.0
'''
COUNTS = np.random.default_rng(4).integers(1, 50, (20, 30)).astype(np.uint32)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    path = tmp_path_factory.mktemp("plain") / "plain_code.py"
    path.write_text(PLAIN)
    return path


def test_the_parameters_of_a_function_after_the_first_and_of_a_class_are_options(plain):
    assert get_measure(f"{plain}:spread")(COUNTS) == 2 * COUNTS.std()
    measure = get_measure(f"{plain}:spread", power=3, scale=0.5)
    assert measure(COUNTS) == 0.5 * COUNTS.std() ** 3
    assert repr(measure) == "spread(power=3, scale=0.5)"
    assert type(get_measure(f"{plain}:highest")(COUNTS)) is float
    assert get_measure(f"{plain}:spread_n", scale=1)(COUNTS) == pytest.approx(COUNTS.std() / COUNTS.mean())
    assert get_measure(f"{plain}:Contrast", power=2)(COUNTS) == pytest.approx((COUNTS.std() / COUNTS.mean()) ** 2)
    assert "does not grow with brightness" in refusal(get_measure, f"{plain}:Contrast_n").problem


@pytest.mark.parametrize(
    ("name", "options", "degree"),
    [("spread", {"power": 2}, 2), ("spread", {"power": 0.5}, 0), ("highest", {}, 1), ("Contrast", {}, 0)],
)
def test_a_degree_that_is_not_stated_is_found_by_trying(plain, name, options, degree):
    assert get_measure(f"{plain}:{name}", **options).degree == degree


@pytest.mark.slow
def test_plain_code_runs_and_its_options_are_part_of_its_digest(plain, tmp_path):
    write_sweep(tmp_path / "a.h5", 300.0)
    methods = [f"{plain}:spread:power=2+argmax", f"{plain}:Contrast+{plain}:Middle:frames=51", f"sd+{plain}:last"]
    records = evaluate(tmp_path / "a.h5", methods=methods).records
    assert [r.judgement.status for r in records] == ["answered"] * 3
    assert abs(records[0].judgement.frame - 300) < 100
    assert [r.judgement.frame for r in records[1:]] == [25.0, records[2].what.frames - 1]
    assert records[0].who.parameters.startswith("spread(power=2, scale=2.0) + ")
    codes = {parse_method(f"{plain}:spread:power={power}+argmax").code for power in (1, 2)}
    assert len(codes) == 2


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("spread:powr=1", "unknown key | 'powr' | did you mean 'power'?"),
        ("needs", "missing 1 required"),
        ("Stopped", "RuntimeError: no camera"),
    ],
)
def test_bad_options_of_plain_code_are_refused_in_one_line(plain, name, message):
    assert_says(refusal(parse_method, f"{plain}:{name}+argmax"), message)


def test_plain_code_without_a_source_is_warned_of_and_passes(plain):
    for name, part in (("spread", "measure"), ("last", "search"), ("Middle:frames=9", "search")):
        found = {r.check: r for r in check_by_name(f"{plain}:{name}") if r.check in ("described", "stated")}
        assert {r.part for r in found.values()} == {part}
        assert (found["described"].level, found["stated"].level) == ("warning", "ok")
    described = next(r for r in check_by_name(f"{plain}:Contrast") if r.check == "described")
    assert (described.level, described.text) == ("ok", "plain code with a docstring; source: nobody")


DECORATED = '''
import sys
from pathlib import Path

import numpy as np
from planted_sweeps import write_sweep

import saf_gen
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.plugins.measures import get_measure, measure_names

COUNTS = np.random.default_rng(4).integers(1, 50, (20, 30)).astype(np.uint32)


@saf_gen.measure
def brightest(counts, power=1):
    """Largest count."""
    return float(counts.max()) ** power


@saf_gen.measure(degree=0, source="nobody", halves=True)
def agreement(counts):
    return float((counts[0] == counts[1]).mean())


assert brightest(COUNTS) == COUNTS.max()
assert get_measure("brightest", power=2)(COUNTS) == float(COUNTS.max()) ** 2
assert {"brightest", "brightest_n", "agreement"} <= set(measure_names())
assert (get_measure("agreement").halves, get_measure("agreement").source) == (True, "nobody")
write_sweep(Path("a.h5"), 300.0)
records = evaluate("a.h5", methods=["brightest+argmax", "agreement+argmax"]).records
assert [r.judgement.status for r in records] == ["answered"] * 2


@saf_gen.measure
def brightest(counts):  # as if a notebook cell were run again
    return 7.0


assert get_measure("brightest")(COUNTS) == 7.0
'''


@pytest.mark.slow
def test_a_decorated_function_has_a_registered_name_and_remains_a_function(tmp_path):
    """In a script of its own, because the names stay registered until the process ends."""
    (tmp_path / "decorated.py").write_text(DECORATED)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "decorated.py"]
    run = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")


def test_functions_and_statements_that_cannot_be_registered_are_refused():
    def sd(counts):
        return 0.0

    assert_says(refusal(saf_gen.measure, sd), "there is a focus measure 'sd' already")
    assert_says(refusal(saf_gen.measure, lambda counts: 0.0), "cannot be called '<lambda>'")
    assert_says(refusal(saf_gen.measure, degre=1), "unknown statement of a measure: 'degre' | did you mean 'degree'?")
