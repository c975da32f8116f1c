"""The laws of studies/laws, each at its small size and at full size, and how their figures are judged."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from saf_gen.camera import counting_law
from saf_gen.errors import SafGenError
from studies.laws import page, run
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, Skipped, compare_chi_squared, compare_mean
from studies.laws.page import make_figure
from studies.laws.run import LAWS, check_laws, choose_laws, main
from studies.laws.theory import autocovariance, count_variance
from studies.laws.workload import DatasetMaker


@pytest.fixture(scope="module")
def maker(tmp_path_factory):
    """Datasets that several laws share."""
    return DatasetMaker(tmp_path_factory.mktemp("laws"))


def assert_holds(law, maker, *, quick):
    try:
        found = law.check(maker, quick)
    except Skipped as reason:
        pytest.skip(str(reason))
    assert found.outcome == "passed", [one for one in found.comparisons if not one.passed]


@pytest.mark.daily(3)
@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_a_law_holds_at_its_small_size(maker, name):
    """Tolerances follow from the statistics of the workloads; seeds are fixed."""
    assert_holds(LAWS[name], maker, quick=True)


@pytest.mark.long
@pytest.mark.parametrize("name", LAWS)
def test_a_law_holds_at_full_size(maker, name, worker_processes):
    assert_holds(LAWS[name], maker, quick=False)


# Runs: failures are reported, stopped runs resume, errors are one line.

PLOT = Plot("x", "y", (Curve("law", (1.0, 2.0), (1.0, 2.0)), Curve("seen", (1.0,), (1.1,), "points", (0.1,))))


def make_law(name, measured=1.0, *, calls=None, error=None):
    """Return the law that a measured figure is 1 within 0.1."""

    def check(maker, quick):
        if calls is not None:
            calls.append(name)
        if error is not None:
            raise error
        ends = measured - 0.05, measured + 0.05
        return Finding((Comparison("the figure", measured, 1.0, 0.9, 1.1, *ends, "m"),), PLOT, ("said",))

    return Law(name, f"The figure of {name} is one.", "x = 1", "nowhere", "Nothing.", "A tenth.", check)


@pytest.fixture
def planted(monkeypatch):
    """A function that replaces the real laws."""
    return lambda *laws: monkeypatch.setattr(run, "LAWS", {law.name: law for law in laws})


@pytest.mark.slow
def test_a_law_that_fails_is_named_with_its_figure_on_the_page_too(planted, tmp_path, capsys):
    planted(make_law("noise_right", 1.04), make_law("noise_wrong", 1.2))
    assert main(["--out", str(tmp_path)]) == 1
    shown = capsys.readouterr().out
    assert "1 of 1 figures, 0.40 of the tolerance used" in shown
    assert "the figure: 1.2, allowed 0.9 to 1.1" in shown
    page = (tmp_path / "validation.md").read_text()
    assert "1 of 2 checks passed; 1 of 2 checks failed" in page
    assert "| the figure | 1.20 m (1.15 to 1.25) | 1.00 | 0.90 to 1.10 | **fails** |" in page
    assert (tmp_path / "pictures/validation-noise-wrong.png").stat().st_size < 30_000


def test_a_law_that_cannot_be_checked_is_neither_passed_nor_kept(planted, tmp_path, capsys):
    skipped = make_law("outside_referee", error=Skipped("the package emva1288 is not installed"))
    planted(skipped, make_law("noise_broken", error=SafGenError("no light")), make_law("noise_right"))
    assert main(["--out", str(tmp_path)]) == 1
    shown = capsys.readouterr().out
    assert "broken   no light" in shown
    assert "skipped  the package emva1288 is not installed" in shown
    assert "Not completed: no light" in (tmp_path / "validation.md").read_text()
    assert [p.name for p in tmp_path.glob(".validation/*/*.json")] == ["noise_right.json"]
    planted(skipped)
    assert main(["--out", str(tmp_path)]) == 0


def test_a_stopped_run_goes_on_unless_size_or_code_changed(tmp_path, monkeypatch):
    calls = []
    first, stop = make_law("noise_first", calls=calls), make_law("noise_second", error=KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        check_laws([first, stop], tmp_path)
    second = make_law("noise_second", calls=calls)
    found = check_laws([first, second], tmp_path)
    assert calls == ["noise_first", "noise_second"]
    assert found["noise_first"] == found["noise_second"]
    check_laws([first], tmp_path, quick=True)
    assert len(calls) == 3
    monkeypatch.setattr(run, "fingerprint", lambda: "0" * 64)
    check_laws([first], tmp_path)
    assert len(calls) == 4
    assert [p.name for p in (tmp_path / run.KEPT).iterdir()] == ["000000000000-whole"]


@pytest.mark.slow
def test_a_law_checked_alone_leaves_the_sections_of_others_as_they_are(planted, tmp_path):
    others = make_law("noise_first"), make_law("light_second"), make_law("light_third")
    planted(*others)
    assert main(["--out", str(tmp_path)]) == 0
    before = (tmp_path / "validation.md").read_text()
    planted(others[0], make_law("light_new", 1.2), make_law("light_never"), *others[1:])
    assert main(["--out", str(tmp_path), "--only", "light_new"]) == 1
    after = (tmp_path / "validation.md").read_text()
    assert "3 of 4 checks passed; 1 of 4 checks failed" in after
    assert after.partition("### light_second")[2] == before.partition("### light_second")[2]
    assert after.index("### noise_first") < after.index("### light_new") < after.index("### light_second")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--only", "noise_interval"), "did you mean 'noise_intervals'?"),
        (("--only", "nonsense"), "unknown law 'nonsense'"),
        (("--only", "noise", "--out", "file/below"), "file/below"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    assert main([*arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_subject_stands_for_its_laws():
    assert [law.name for law in choose_laws([])] == list(LAWS)
    assert [law.name for law in choose_laws(["noise"])] == [n for n in LAWS if n.startswith("noise_")]


# Statistics: the tolerances and closed forms of the laws.


@pytest.mark.parametrize("value", [0.0, 1.0, 0.95, 1.05, 1.1])
def test_a_figure_passes_inside_its_range_alone(value):
    one = Comparison("x", value, 1.0, 0.95, 1.05)
    assert one.passed == (0.95 <= value <= 1.05)
    assert one.tolerance_used == pytest.approx(abs(value - 1) / 0.05)


def test_nothing_passes_without_a_figure_or_with_nan():
    assert Finding(()).outcome == "failed"
    assert not Comparison("x", math.nan, 1.0, 0.9, 1.1).passed
    assert Comparison("x", math.nan, 1.0, 0.9, 1.1).tolerance_used == math.inf
    assert Comparison("x", 3.0, at_most=4.0).tolerance_used == 0.75


@pytest.mark.slow
def test_right_samples_fail_as_rarely_as_promised_and_wrong_ones_are_found():
    """Of 1,000 laws of ten means of 50, 0.1 fail on average (P(≥ 3) = 2·10⁻⁴); all off by 1.5 sd fail. Seed 1."""
    samples = np.random.default_rng(1).normal(size=(1000, 10, 50))
    failed = sum(not all(compare_mean("m", one, expected=0.0, figures=10).passed for one in law) for law in samples)
    assert failed < 3
    assert not any(compare_mean("m", one, expected=1.5, figures=10).passed for one in samples[:100, 0])


def test_chi_squared_is_refused_at_both_ends():
    middle, low, high = 20.0, *stats.chi2.ppf([1e-6, 1 - 1e-6], 20)
    passed = [compare_chi_squared("c", x, freedom=20, figures=1).passed for x in (low, middle, high)]
    assert passed == [False, True, False]


@pytest.mark.parametrize("per_spike", [1e-4, 1e-3, 0.02])
def test_the_variance_of_counts_is_that_of_the_package_and_of_the_probabilities(per_spike):
    means = np.array([0.01, 0.5, 1.0, 7.25, 40.0, 613.0])
    found = count_variance(means, means * per_spike)
    np.testing.assert_allclose(found, counting_law.count_variance(means, means * per_spike), rtol=1e-9, atol=1e-12)
    for mean, variance in zip(means.tolist(), found.tolist(), strict=True):
        numbers, probabilities = counting_law.count_probabilities(mean, mean * per_spike)
        assert variance == pytest.approx(float((probabilities * (numbers - mean) ** 2).sum()), rel=1e-6)


def test_covariances_of_windows_add_up_to_the_variance_of_the_long_window():
    """Var of 50 windows together is Σ (50 − |j|)·γ(j) over all lags j."""
    lags, per_spike = np.arange(50), 1e-3
    covariance = autocovariance(40, lags, rate=0.2, per_spike=per_spike)
    total = float((np.where(lags == 0, 1, 2) * (50 - lags) * covariance).sum())
    assert total == pytest.approx(float(counting_law.count_variance(400.0, 400.0 * per_spike)), rel=1e-9)


def draw(*curves, **options):
    return make_figure(Plot("x", "y", curves, **options), "a law").axes[0]


def test_scenes_are_named_on_the_axis_and_no_line_joins_them():
    x = (0.0, 1.0)
    axes = draw(
        Curve("sensor", x, (2.0, 2.0), "marks"), Curve("grain", x, (1.0, 0.5), "points"), names=("fan", "camel")
    )
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["fan", "camel"]
    assert list(axes.get_xticks()) == [0, 1]
    assert axes.get_xlim() == (-0.5, 1.5)
    assert {line.get_linestyle() for line in axes.lines} == {"None"}
    assert axes.get_title(loc="left") == "a law"


def test_a_law_at_single_places_is_not_joined_and_a_law_between_them_is():
    axes = draw(Curve("law", (1.0, 2.0), (1.0, 2.0), "marks"), Curve("smooth", (1.0, 2.0), (1.0, 2.0)))
    assert [line.get_linestyle() for line in axes.lines] == ["None", "-"]


def test_what_was_measured_has_the_colour_of_its_law_and_each_law_its_own():
    x = (1.0, 2.0)
    law, seen = Curve("law, a", x, x), Curve("seen, a", x, x, "points")
    for curves in ((law, seen, law, seen), (seen, law, seen, law)):
        first, second, third, fourth = (line.get_color() for line in draw(*curves).lines)
        assert first == second != third == fourth
    assert len({line.get_color() for line in draw(law, law, law).lines}) == 3


def test_no_law_writes_the_names_of_scenes_into_the_label_of_an_axis():
    """The axis names them instead, so that no scene has a number."""
    for source in sorted((Path(page.__file__).parent).glob("*.py")):
        assert 'Plot(f"' not in source.read_text(encoding="utf-8"), source.name
