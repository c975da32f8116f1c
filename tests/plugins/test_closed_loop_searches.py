"""Searches that command the lens, against an ideal camera with a planted peak."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from ideal_camera import IdealCamera, bell_curve
from refusals import refusal

from saf_gen import get_search
from saf_gen.benchmark import method_spec
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.core.config.source_digest import class_source_digests
from saf_gen.plugins.searches._lens_commanding import divide_interval

RATIO = (math.sqrt(5) - 1) / 2
PROMISES = {
    "golden_section": RATIO * RATIO**10,  # of the last bracket, after 10 steps
    "fibonacci": 1 / 233,
    "hill_climb": 0.01,
    "rule_based": 0.005,
    "coarse_to_fine": 0.01,
}
"""How far the answer may be from a single peak with default options, as each docstring states."""
PEAKS = [0.0, 0.03, 0.31, 0.77, 1.0]
SENSOR = 1e-4  # rms of one reading; samples average a hundred


def camera(peak, **more):
    return IdealCamera(bell_curve(peak), sensor=SENSOR, others={"sd": bell_curve(peak, width=0.25)}, **more)


@pytest.mark.parametrize("name", PROMISES)
@pytest.mark.parametrize("peak", PEAKS)
def test_a_single_peak_is_found_from_any_start(name, peak):
    for start in (0.0, 0.4, 1.0):
        answer = get_search(name)(camera(peak, start=start))
        assert abs(answer.position - peak) <= PROMISES[name] + 4 * SENSOR
        assert answer.frame is None
        assert answer.position in answer.trace


@pytest.mark.parametrize("name", PROMISES)
def test_noise_of_the_score_moves_the_answer_little(name):
    """Noise of 0.003, seeded: within 0.0055 of its quadratic top the curve falls by that; twice that is allowed."""
    for peak in (0.31, 0.5, 0.77):
        start = peak - 0.12 if name == "hill_climb" else 0.0  # it may get stuck on a flat part, as it states
        answer = get_search(name)(camera(peak, start=start, noise=0.003))
        assert abs(answer.position - peak) <= PROMISES[name] + 0.011


def search_from_the_left(name, peak=0.4, **options):
    view = camera(peak, start=0.2)
    answer = get_search(name, **options)(view)
    return view, answer


@pytest.mark.parametrize("tolerance", [0.3, 0.01])
def test_golden_section_takes_the_samples_that_theory_says(tolerance):
    steps = math.ceil(math.log(tolerance) / math.log(RATIO))
    for peak in PEAKS:
        view, answer = search_from_the_left("golden_section", peak, tolerance=tolerance)
        assert len(view.scored) == steps + 1
        assert RATIO**steps <= tolerance < RATIO ** (steps - 1)
        assert abs(answer.position - peak) <= RATIO ** (steps + 1) + 4 * SENSOR


@pytest.mark.parametrize(("tolerance", "parts", "count"), [(0.5, 5, 3), (0.1, 21, 6), (0.01, 233, 11)])
def test_fibonacci_samples_parts_of_the_travel_and_never_twice(tolerance, parts, count):
    for peak in PEAKS:
        view, answer = search_from_the_left("fibonacci", peak, tolerance=tolerance)
        at = np.array(view.commands) * parts
        assert at == pytest.approx(np.round(at), abs=1e-9)
        assert len(set(np.round(at))) == count == len(view.scored)
        assert abs(answer.position - peak) <= 1 / parts + 4 * SENSOR


def test_hill_climb_near_the_focus_does_not_cross_the_travel():
    view = camera(0.6, start=0.55)
    answer = get_search("hill_climb")(view)
    assert abs(answer.position - 0.6) <= 0.01
    assert 0.3 < min(view.positions) < max(view.positions) < 0.9
    assert len(view.scored) <= 16


def test_without_a_peak_hill_climb_stays_and_rule_based_says_so():
    answer = get_search("hill_climb")(IdealCamera(lambda p: 0.0, start=0.3))
    assert answer.position == pytest.approx(0.3, abs=1e-3)
    assert get_search("rule_based")(IdealCamera(lambda p: 1.0)).note == "no steep climb"


def test_hill_climb_crosses_a_dip_of_one_coarse_step():
    def dented(p):
        return bell_curve(0.8)(p) - (0.2 if 0.35 < p < 0.45 else 0.0)

    view = IdealCamera(dented, start=0.3)
    assert abs(get_search("hill_climb")(view).position - 0.8) <= 0.01
    assert abs(get_search("hill_climb", falls=1)(IdealCamera(dented, start=0.3)).position - 0.8) > 0.3


def test_rule_based_goes_in_one_direction_in_steps_that_its_rules_choose():
    view = camera(0.6, start=0.1)
    answer = get_search("rule_based")(view)
    assert answer.note == ""
    steps = np.diff(view.commands)
    assert (steps > 0).all()  # fine steps over the top leave no gap to fill
    assert set(np.round(steps, 6)) <= {0.08, 0.03, 0.01}
    assert steps[0] == pytest.approx(0.08)
    near = [step for step, at in zip(steps, view.commands[1:], strict=True) if abs(at - 0.6) < 0.05]
    assert near == pytest.approx([0.01] * len(near))
    assert max(view.commands) < 0.75  # it stops once the score has fallen to half the climb


def test_rule_based_goes_back_over_a_gap_that_holds_the_peak():
    """The peak is narrower than a coarse step: the rules notice it after it has passed."""
    view = IdealCamera(bell_curve(0.52, width=0.02), start=0.0, sensor=0.0)
    assert abs(get_search("rule_based", gentle=4.0)(view).position - 0.52) <= 0.005
    assert (np.diff(view.commands) < 0).any()


def test_coarse_to_fine_looks_with_the_broad_measure_first():
    def narrow(p):
        return math.exp(-(((p - 0.53) / 0.03) ** 2))

    view = IdealCamera(narrow, others={"variance": bell_curve(0.5, width=0.3)}, start=0.9, sensor=0.0)
    answer = get_search("coarse_to_fine", far="variance")(view)
    assert abs(answer.position - 0.53) <= 0.01 + 1e-9
    far = [stop - first for first, stop, name in view.scored if name == "variance"]
    near = [stop - first for first, stop, name in view.scored if name is None]
    assert (len(far), len(near)) == (11, 11)
    assert (set(far), set(near)) == ({50}, {100})
    assert all(b < a for a, b in pairwise(view.commands[:11]))
    assert all(b > a for a, b in pairwise(view.commands[11:]))


def test_coarse_to_fine_may_use_the_method_s_own_measure_alone():
    search = get_search("coarse_to_fine", far="own")
    assert search.measures == ()
    assert get_search("coarse_to_fine").measures == ("sd",)
    view = IdealCamera(bell_curve(0.3))
    assert abs(search(view).position - 0.3) <= 0.01
    assert {name for _, _, name in view.scored} == {None}


@pytest.mark.parametrize("name", PROMISES)
def test_a_search_stops_at_its_budget_with_the_best_so_far(name):
    full = camera(0.7, start=0.1)
    get_search(name)(full)
    for frames in np.linspace(0, full.now, 9, dtype=int)[1:-1:2]:
        view = camera(0.7, start=0.1, frames=int(frames))
        answer = get_search(name)(view)
        assert view.now <= view.frames
        assert answer.note.startswith("out of frames")
        assert view.scored == full.scored[: len(view.scored)]
        assert (answer.position is None) == (not view.scored)


@pytest.mark.parametrize("name", PROMISES)
def test_without_time_for_a_sample_it_abstains(name):
    answer = get_search(name)(camera(0.5, frames=120))
    assert answer == type(answer)(None, (), "out of frames before the first look")


@pytest.mark.parametrize("name", PROMISES)
def test_a_sample_is_taken_where_the_lens_rests(name):
    """No window holds a lens that is moving, whatever the speed of the drive."""
    for speed in (0.5, 1000.0):
        view = camera(0.35, start=1.0, speed=speed, noise=0.001)
        get_search(name)(view)
        for first, stop, _ in view.scored:
            assert np.ptp(view.positions[first:stop]) <= 0.002


def test_without_a_position_sensor_time_alone_settles_the_lens():
    view = camera(0.5, blind=True, start=0.2)
    answer = get_search("golden_section", timeout_s=0.3)(view)
    assert abs(answer.position - 0.5) <= PROMISES["golden_section"]
    gaps = [later[0] - earlier[1] for earlier, later in pairwise(view.scored)]
    assert min(gaps) >= 0.3 * view.readout_hz


def test_noise_of_the_sensor_does_not_keep_a_search_waiting():
    """The noise is 0.005 per reading; means over a millisecond differ by no more than the noise explains."""
    quiet, loud = (IdealCamera(bell_curve(0.5), sensor=rms, start=0.2, frames=10**6) for rms in (0.0, 0.005))
    for view in (quiet, loud):
        assert abs(get_search("golden_section")(view).position - 0.5) < 0.01
    assert loud.now < 1.2 * quiet.now


def test_unseen_ringing_is_waited_for_by_the_length_of_the_move():
    quick, slow = (IdealCamera(bell_curve(0.5), speed=1e4, sensor=0.0) for _ in range(2))
    get_search("golden_section", lag_s=0.0)(quick)
    get_search("golden_section", lag_s=0.02)(slow)
    moves = [1.0, *np.abs(np.diff(slow.commands))]  # the first move may have been through the full travel
    waited = sum(0.02 * math.log(move / 0.002) for move in moves)
    assert (slow.now - quick.now) / 20_000 == pytest.approx(waited, abs=len(moves) * 8 / 20_000)


def test_the_measure_of_a_search_is_checked_and_in_the_code_digest(monkeypatch):
    error = refusal(parse_method, "sd+coarse_to_fine:far=tenengrat")
    assert "sd+coarse_to_fine:far=tenengrat" in error.where + error.problem
    assert "tenengrad" in str(error)
    read = []
    monkeypatch.setattr(
        method_spec, "class_source_digests", lambda classes: read.extend(class_source_digests(classes)) or read
    )
    parse_method("sd_code+coarse_to_fine:far=brenner_n_tfi")
    files = {Path(name).stem for name, _ in read}
    assert {"brenner", "sd_code", "_moments", "coarse_to_fine", "_lens_commanding"} <= files


def test_two_samples_at_the_end_of_the_travel_that_differ_by_rounding_leave_no_gap():
    """Steps of 0.08, 0.03, 0.03, 0.03, ten of 0.08 and one of 0.03 add up to 1 − 10⁻¹⁶: one more step follows."""

    def curve(p):
        slope = 2.0 * (min(p, 0.14) + max(p - 0.89, 0.0))
        return math.exp(slope)

    view = IdealCamera(curve, start=0.0)
    answer = get_search("rule_based")(view)
    assert view.commands[-2:] == pytest.approx([1.0, 1.0], abs=1e-12)
    assert view.commands[-2] != view.commands[-1]
    assert answer.position == pytest.approx(1.0, abs=1e-6)
    assert divide_interval(1 - 1e-16, 1.0, step=0.01) == pytest.approx([1.0, 1.0])
    assert divide_interval(0.0, 0.02, step=0.01) == [0.0, 0.01, 0.02]
