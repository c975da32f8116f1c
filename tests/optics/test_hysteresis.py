"""Hysteresis of piezos and drift of liquid lenses: loops, memory, inverse and cooling by their closed forms."""

from itertools import pairwise
from math import exp

import numpy as np
import pytest

from saf_gen.optics.actuators import ActuatedLens, get_actuator
from saf_gen.optics.actuators.actuated_lens import follow_commands

HZ = 20_000.0
SHARE = 0.13
STEPS = 640  # a multiple of twice the number of operators: every operator turns at a step
WIDTHS = (np.arange(16) + 0.5) / 16


def drive(share=SHARE, *, start=0.0, **changes):
    return ActuatedLens(get_actuator("ideal", hysteresis=share, **changes), start=start, readout_hz=HZ, seed=1)


def visit(moved, *turns, steps=STEPS):
    """Lead the drive from turn to turn in small steps; return the commands and the positions after each."""
    told = np.concatenate([np.linspace(a, b, max(round(abs(b - a) * steps), 1) + 1)[1:] for a, b in pairwise(turns)])
    did = []
    for to in told:
        moved.command(float(to))
        did.append(moved.run(1)[0])
    return told, np.array(did)


def last(moved, *turns, steps=STEPS):
    return visit(moved, moved.target, *turns, steps=steps)[1][-1]


def loop_area(told, did):
    return abs(np.sum((told + np.roll(told, 1)) / 2 * (did - np.roll(did, 1))))


# --- loops -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.0, 0.5, 1.0])
def test_a_drive_that_came_from_the_middle_starts_where_it_is_sent_at_the_middle_and_the_ends(start):
    assert drive(start=start).resting_position() == pytest.approx(start, abs=1e-12)


def test_the_loop_from_end_to_end_is_as_wide_in_the_middle_as_the_card_says():
    moved = drive()
    up, down = visit(moved, 0, 1)[1], visit(moved, 1, 0)[1]
    assert (up[-1], down[-1]) == pytest.approx((1, 0), abs=1e-6)
    assert down[STEPS // 2 - 1] - up[STEPS // 2 - 1] == pytest.approx(SHARE, abs=1e-6)
    assert np.max(down[-2::-1] - up[:-1]) == pytest.approx(SHARE, abs=1e-3)


@pytest.mark.parametrize(("low", "high"), [(0, 1), (0.25, 0.75), (0.5, 0.75), (0.125, 1)])
def test_the_area_of_a_loop_is_that_of_its_play_operators_and_grows_as_the_cube_of_the_stroke(low, high):
    """A play operator of the width d encloses d·(A - d) if the stroke A is larger; many of them 2h·A³/3."""
    moved, stroke = drive(), high - low
    visit(moved, 0, high, low)
    area = loop_area(*visit(moved, low, high, low))
    d = WIDTHS[stroke > WIDTHS]
    assert area == pytest.approx(4 * SHARE / 16 * np.sum(d * (stroke - d)), rel=1e-3)
    assert area == pytest.approx(2 / 3 * SHARE * stroke**3, rel=0.04)


# --- memory ------------------------------------------------------------------------------------------


def test_an_input_that_returns_to_a_turning_point_returns_the_output():
    moved = drive()
    before = last(moved, 0.85, 0.31)
    assert last(moved, 0.62, 0.44, 0.5, 0.31) == pytest.approx(before, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("between", [(0.2, 0.6), (0.7, 0.3, 0.6, 0.4), (0.05, 0.79, 0.1)])
def test_a_larger_turn_wipes_out_the_memory_of_smaller_ones(between):
    plain, wiped = drive(), drive()
    a, b = last(plain, 0.8, 0.0, 0.4), last(wiped, 0.8, *between, 0.0, 0.4)
    assert a == pytest.approx(b, abs=1e-9)


@pytest.mark.slow
def test_loops_between_the_same_inputs_are_congruent():
    shapes = []
    for history in ((0.3,), (1.0, 0.3), (0.9, 0.1, 0.3)):
        moved = drive()
        visit(moved, 0, *history, 0.65, 0.3)
        did = visit(moved, 0.3, 0.65, 0.3)[1]
        shapes.append(did)
    offsets = [shape[-1] for shape in shapes]
    assert np.ptp(offsets) > 0.02
    for shape, offset in zip(shapes, offsets, strict=True):
        assert shape - offset == pytest.approx(shapes[0] - offsets[0], abs=1e-9)


def test_the_path_does_not_depend_on_the_speed():
    """The same turns in steps and at once, by a motor without limits and by a slow one."""
    turns = (0.8, 0.35, 0.55, 0.1, 0.6)
    rests = []
    for steps, changes in ((STEPS, {}), (1, {}), (1, {"speed": 20, "acceleration": 2_000})):
        moved = drive(**changes)
        for turn in turns:
            visit(moved, moved.target, turn, steps=steps)
            moved.run(3_000)
        rests.append(moved.resting_position())
    assert rests[1:] == pytest.approx(rests[:1] * 2, abs=1e-9)


def test_the_published_inverse_brings_the_drive_where_it_is_wanted():
    """The inverse of such a drive is such a drive [P. Krejčí, K. Kuhnen, 2001, doi:10.1049/ip-cta:20010375]."""
    half, weight = WIDTHS / 2, np.full(16, SHARE / 4)
    slopes = 1 - 2 * SHARE + np.concatenate([[0], np.cumsum(weight)])
    inverse_half = (1 - 2 * SHARE) * half + np.array([np.sum(weight[:i] * (half[i] - half[:i])) for i in range(16)])
    inverse_weight = np.diff(1 / slopes)
    rng = np.random.default_rng(5)
    wanted = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise([0.5, *rng.uniform(0.05, 0.95, 8)])])
    moved, plays, got = drive(start=0.5), np.full(16, 0.0), []
    for y in wanted - 0.5:  # about the middle, from which the drive starts without memory
        plays = np.clip(plays, y - inverse_half, y + inverse_half)
        moved.command(0.5 + y / slopes[0] + inverse_weight @ plays)
        got.append(moved.run(1)[0])
    assert got == pytest.approx(wanted, abs=1e-6)


# --- drift -------------------------------------------------------------------------------------------

WARM = {"per_k": 0.004, "ambient_k": 5.0, "heating_k": 20.0, "time_s": 0.25}


def test_a_lens_drifts_exponentially_to_the_offset_of_its_new_temperature():
    moved = ActuatedLens(get_actuator("ideal", drift=WARM), start=0.2, readout_hz=HZ, seed=1)
    assert moved.run(400) == pytest.approx(np.full(400, 0.2 + 0.004 * (5 + 20 * 0.04)), abs=1e-9)  # it is in balance
    moved.command(0.6)
    seconds = (np.arange(20_000) + 0.5) / HZ
    warmth = 0.36 - (0.36 - 0.04) * np.exp(-seconds / 0.25)
    assert moved.run(20_000)[8:] == pytest.approx((0.6 + 0.004 * (5 + 20 * warmth))[8:], abs=1e-5)
    assert moved.resting_position() == pytest.approx(0.6 + 0.004 * (5 + 20 * (0.36 - 0.32 * exp(-4))), abs=1e-5)


def test_a_drift_is_the_same_whatever_the_camera():
    ends = []
    for hz in (5_000.0, 40_000.0):
        moved = ActuatedLens(get_actuator("ideal", drift=WARM), start=0.2, readout_hz=hz, seed=1)
        for to in (0.9, 0.1, 0.7):
            moved.command(to)
            ends.append(moved.run(round(0.2 * hz))[-1])
    assert ends[:3] == pytest.approx(ends[3:], abs=2e-5)


def test_a_lens_that_drifts_stays_in_its_travel():
    moved = ActuatedLens(get_actuator("ideal", drift={**WARM, "ambient_k": 50}), start=0.99, readout_hz=HZ, seed=1)
    assert (moved.run(100) == 1).all()


# --- what the drive is told, and what it does --------------------------------------------------------


@pytest.mark.parametrize(("name", "off"), [("piezo", SHARE / 2), ("liquid_lens_warm", 0.015)])
def test_a_sensor_at_the_motor_sees_neither_hysteresis_nor_drift(name, off):
    told = (np.arange(8_000) + 0.5) / 8_000
    did, read = follow_commands(get_actuator(name), told, readout_hz=HZ, seed=1)
    perfect, same = follow_commands(get_actuator(name, hysteresis=0, drift=None), told, readout_hz=HZ, seed=1)
    assert read == pytest.approx(told, abs=3e-3)
    assert (read == same).all()
    assert np.abs(did - perfect).max() == pytest.approx(off, rel=0.05)


def test_a_piezo_sent_back_from_a_sweep_does_not_return():
    """It passed 0.5 on the way up when it was told 0.5 + s; told the same on the way down, it is above 0.5."""
    moved = drive()
    told, did = visit(moved, 0, 1)
    again = last(moved, float(np.interp(0.5, did, told)))
    assert again - 0.5 == pytest.approx(SHARE, rel=0.05)
