"""Lens motions, against closed forms and the differential equation that they solve."""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, pi, sqrt

import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy.integrate import solve_ivp
from scipy.stats import norm

from saf_gen import get_motion
from saf_gen.plugins import motions
from saf_gen.plugins.motions import lens_positions

HZ = 20_000.0
TABLE = "time_s,position\n0,0.2\n0.05,0.8\n0.1,0.5\n"


def lens(kind, *, frames=20_000, hz=HZ, **options):
    return lens_positions({"kind": kind, **options}, frames, readout_hz=hz)


def csv(text, path="lens.csv"):
    return {"path": path, "text": text}


def test_a_sweep_goes_at_constant_speed_either_way_and_through_part_of_the_travel():
    assert lens("sweep", frames=8) == pytest.approx((np.arange(8) + 0.5) / 8, abs=1e-7)
    back = lens("sweep", frames=1000, **{"from": 0.9, "to": 0.4})
    assert back == pytest.approx(0.9 - 0.5 * (np.arange(1000) + 0.5) / 1000, abs=1e-7)


def test_there_and_back_is_symmetric_in_time_and_rests_at_the_turn():
    there = lens("sweep_and_return", **{"from": 0.1, "to": 0.7, "dwell_s": 0.2})
    assert np.abs(there - there[::-1]).max() < 1e-6
    assert (there == there.max()).sum() == pytest.approx(0.2 * HZ, abs=2)
    assert there.max() == pytest.approx(0.7, abs=1e-7)
    speed = np.diff(there[:7000]) * HZ
    assert speed == pytest.approx(0.6 / 0.4, rel=2e-3)  # 0.6 of the travel in (1 s - 0.2 s)/2


@pytest.mark.parametrize("damping", [0.1, 0.999999, 1.0, 1.000001, 3.0])
def test_steps_solve_the_equation_of_a_mass_on_a_spring(damping):
    """Against a Runge-Kutta solution, with steps that begin before the previous one has settled."""
    options = {"from": 0.3, "to": 0.7, "count": 4, "natural_hz": 40.0, "damping": damping}
    duration, omega = 0.1, 2 * pi * 40.0
    times = (np.arange(2000) + 0.5) / HZ

    def command(t):
        return 0.3 + 0.1 * min(int(t / (duration / 5)), 4)

    state, found = [0.3, 0.0], []
    for step in range(5):
        begin, end = step * duration / 5, (step + 1) * duration / 5
        inside = times[(times >= begin) & (times < end)]
        target = command((begin + end) / 2)
        solved = solve_ivp(
            lambda t, x, c=target: [x[1], omega**2 * (c - x[0]) - 2 * damping * omega * x[1]],
            (begin, end),
            state,
            t_eval=[*inside, end],
            rtol=1e-9,
            atol=1e-12,
        )
        found.append(solved.y[0][:-1])
        state = solved.y[:, -1]
    assert lens("steps", frames=2000, **options) == pytest.approx(np.concatenate(found), abs=2e-7)


def test_a_step_overshoots_rings_and_decays_as_its_closed_form_says():
    damping, natural = 0.2, 50.0
    options = {"from": 0.2, "to": 0.6, "count": 1, "natural_hz": natural, "damping": damping, "dwell_s": 0.1}
    after = (lens("steps", frames=40_000, hz=1e5, **options)[10_000:] - 0.2) / 0.4  # from the step on
    peaks = [i for i in range(1, 20_000) if after[i - 1] < after[i] >= after[i + 1] and after[i] > 1.001]
    assert after[peaks[0]] - 1 == pytest.approx(exp(-pi * damping / sqrt(1 - damping**2)), rel=1e-3)
    period = np.diff(peaks) / 1e5
    assert period[:2] == pytest.approx(1 / (natural * sqrt(1 - damping**2)), rel=5e-3)
    decrement = np.log((after[peaks[0]] - 1) / (after[peaks[1]] - 1))
    assert decrement == pytest.approx(2 * pi * damping / sqrt(1 - damping**2), rel=1e-3)
    settled = int(4 / (damping * 2 * pi * natural) * 1e5)
    assert np.abs(after[settled:] - 1).max() < 0.021


def test_an_overshoot_is_cut_off_at_the_end_of_the_travel_and_nowhere_else():
    rings = {"count": 5, "natural_hz": 60.0, "damping": 0.1}
    up, down = lens("steps", **rings), lens("steps", **rings, **{"from": 1.0, "to": 0.0})
    assert up.max() == 1.0
    assert down == pytest.approx(1 - up, abs=2e-7)
    inside = lens("steps", **rings, **{"from": 0.1, "to": 0.8})
    assert inside.max() > 0.88  # steps of 0.14, overshot by 73 %


def test_steps_share_the_recording_evenly_unless_their_rest_is_given():
    stiff = {"count": 4, "natural_hz": 5000.0, "damping": 1.0}
    shared = lens("steps", **stiff)
    assert shared[3990] == pytest.approx(0, abs=1e-6)
    assert shared[np.array([7990, 11_990, 15_990, 19_990])] == pytest.approx([0.25, 0.5, 0.75, 1], abs=1e-6)
    quick = lens("steps", **stiff, dwell_s=0.05)
    assert quick[np.array([990, 1990, 3990])] == pytest.approx([0, 0.25, 0.75], abs=1e-6)
    assert (quick[5000:] == 1).all()


def speeds(seed, *, seconds=2.0, **options):
    """Speed over its mean, at 2 kHz, in the middle of the travel, so that no end cuts anything off."""
    ends = {"from": 0.2, "to": 0.8, "seed": seed}
    position = get_motion("hand", **ends, **options).positions(np.arange(2000 * seconds + 1) / 2000, seconds)
    return np.diff(position) * 2000 * seconds / 0.6


def test_a_hand_goes_from_one_end_to_the_other_and_by_default_never_back():
    for seed in range(40):
        position = lens("hand", frames=4000, hz=4000.0, seed=seed, irregularity=1.0, bandwidth_hz=12.0)
        assert (np.diff(position) >= 0).all()
        assert position[0] == pytest.approx(0, abs=2e-3)
        assert position[-1] == pytest.approx(1, abs=2e-3)


def test_a_hand_with_reversals_goes_back_for_the_stated_fraction_of_time():
    """Φ(-1/σ) = 0.106 at σ = 0.8: 200 seeds of 40 waves each, sd of their mean 0.0009 (measured); 4 sd."""
    back = np.mean([(speeds(s, reversals=True, irregularity=0.8, bandwidth_hz=20.0) < 0).mean() for s in range(200)])
    assert back == pytest.approx(norm.cdf(-1 / 0.8), abs=0.004)


@pytest.mark.parametrize("sigma", [0.2, 1.0])
def test_the_irregularity_is_the_standard_deviation_of_the_speed(sigma):
    exact = speeds(3, reversals=True, irregularity=sigma, bandwidth_hz=20.0)
    assert exact.mean() == pytest.approx(1, rel=1e-9)
    assert exact.std() == pytest.approx(sigma, rel=0.01)
    drawn = [speeds(seed, irregularity=sigma, bandwidth_hz=40.0).std() for seed in range(60)]
    assert np.mean(drawn) == pytest.approx(sigma, rel=0.03)  # 60 seeds: sd of the mean below 0.8 %; 4 sd


@pytest.mark.parametrize("reversals", [False, True])
def test_the_speed_of_a_hand_holds_no_frequency_above_its_band(reversals):
    speed = speeds(5, reversals=reversals, irregularity=0.7, bandwidth_hz=10.0)
    power = np.abs(np.fft.rfft(speed - speed.mean())) ** 2
    hz = np.fft.rfftfreq(speed.size, 1 / 2000)
    assert power[hz > 10.25].sum() < 1e-6 * power.sum()  # straight lines between 32 points per wave
    assert power[(hz > 5) & (hz <= 10.25)].sum() > 1e-3 * power.sum()


def test_a_seed_names_the_motion_of_a_hand_at_any_readout_rate():
    fast = lens("hand", seed=4)
    assert np.abs(lens("hand", frames=4000, hz=4000.0, seed=4) - fast.reshape(-1, 5)[:, 2]).max() < 1e-6
    assert np.abs(lens("hand", seed=5) - fast).max() > 0.01


def test_a_table_is_followed_in_straight_lines():
    found = lens("from_csv", frames=2000, file=csv(TABLE))
    times = (np.arange(2000) + 0.5) / HZ
    assert found == pytest.approx(np.interp(times, [0, 0.05, 0.1], [0.2, 0.8, 0.5]), abs=1e-7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,position\n0,0\n", "lens.csv:1 | the columns are 'time,position' | time_s,position"),
        ("time_s,position\n0,0\n0,1\n", "lens.csv:3 | time_s goes from 0 to 0 | a column that rises"),
        ("time_s,position\n0,0\n1,far\n", "lens.csv:3 | position is 'far' | a finite number"),
        ("time_s,position\n0,0\n0.1,1.2\n", "lens.csv | position is 1.2 at 0.1 s | 0 to 1"),
        ("time_s,position\n0,0\n0.01,1\n", "time_s goes from 0 to 0.01 | 0.1 s | 0.099975 s"),
        ("time_s,position\n0.01,0\n1,1\n", "covers | add rows"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_in_one_line(text, message):
    assert_says(refusal(lens, "from_csv", frames=2000, file=csv(text)), message)


STEP = {"count": 4, "natural_hz": 50, "damping": 0.3}


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("sweep", {"to": 1.2}, "to is 1.2 | 0 to 1"),
        ("sweep_and_return", {"dwell_s": -1}, "dwell_s is -1 | 0 or more"),
        ("sweep", {"from": 0.5, "to": 0.5}, "does not move: from and to are both 0.5 | kind: hold"),
        ("sweep_and_return", {"dwell_s": 2}, "dwell_s is 2 in a recording of 1 s | record more frames"),
        ("hold", {}, "lens motion 'hold' | missing | 'position' | position"),
        ("steps", STEP | {"count": 2.5}, "count is 2.5 | a whole number | choice: [4, 8]"),
        ("steps", STEP | {"natural_hz": 0}, "natural_hz is 0 | above 0, at most 100000 Hz"),
        ("steps", STEP | {"dwell_s": 0.25}, "4 steps | 0.25 s | in a recording of 1 s | below 0.25"),
        ("hand", {"irregularity": 1.5}, "irregularity is 1.5 | at most 1"),
        ("hand", {"bandwidth_hz": 1}, "bandwidth_hz is 1 in a recording of 1 s | at least 2"),
        ("hand", {"reversals": "some"}, "reversals is 'some' | true, false"),
        ("hand", {"seed": -1}, "seed is -1 | 0 or more"),
        ("from_csv", {"file": "lens.csv"}, "file is 'lens.csv' | CSV file"),
    ],
)
def test_a_motion_that_does_not_fit_is_refused_in_one_line(kind, options, message):
    assert_says(refusal(lens, kind, **options), message)


@dataclass(frozen=True)
class Given:
    """A third-party motion that computes its positions by a function."""

    of: Callable[[np.ndarray], np.ndarray]

    def positions(self, seconds, duration_s):
        return self.of(seconds / duration_s)


@pytest.mark.parametrize(
    ("of", "message"),
    [
        (lambda t: 1.5 * t, "moves the lens over | to 1.5 | 0 to 1 of the travel"),
        (lambda t: t[:5], "Given | (5,) | one number per time"),
        (lambda t: 1 / 0, "ZeroDiv"),
    ],
)
def test_a_motion_that_fails_or_leaves_the_travel_is_refused_in_one_line(of, message):
    assert_says(refusal(lens_positions, Given(of), 2000, readout_hz=HZ), message)


@pytest.mark.parametrize("kind", ["sweep_and_return", "hand"])
def test_positions_do_not_depend_on_the_block_size(monkeypatch, kind):
    expected = lens(kind)
    monkeypatch.setattr(motions, "BLOCK_FRAMES", 777)
    assert np.array_equal(lens(kind), expected)
