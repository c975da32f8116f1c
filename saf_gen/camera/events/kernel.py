"""Compiled inner loop of the event camera: the instants at which each pixel reports a change, solved and not sampled.

The light of a pixel is linear in each cell of time. Its photoreceptor is a logarithmic one, whose input node of charge
Q is driven by the photocurrent I, in electrons per second, against a transistor whose current is Y = exp(V):

    dV/dt = (I - Y)/Q        with u = 1/Y = exp(-V):        du/dt = (1/I - u)/(Q/I)

which is linear in u, so a step of the light has a closed form, and dim light is followed slowly (T. Delbruck and
C. A. Mead, ISCAS 1994, doi:10.1109/ISCAS.1994.409266). A second time constant, of the follower's bias, adds to Q/I. In
a cell 1/I is interpolated linearly and the time constant is that of the mean light; then

    u(t) = w + r·(t - τ) + (u₀ - w + r·τ)·exp(-t/τ)        w = 1/I at the beginning of the cell, r its slope

A pixel that stored V reports ON when u falls to exp(-V - θ_on), OFF when it rises to exp(-V + θ_off). No logarithm is
needed, and the exponential is our own, so that all machines agree in every bit.

An event asks for the bus when it happens, and is read when all those before it have been read. Until then its pixel
sees nothing, and its reset begins when it is read. So each event depends on those of all other pixels. As long as none
of them waits for longer than a microsecond, pixels are advanced one after the other (:func:`record_pixels`), and the
queue is only looked at; else their events are made one after the other (:func:`record_queue`).
"""

from heapq import heapify, heappop, heappush
from math import factorial
from typing import Any

import numpy as np
from numba import njit

from saf_gen.camera.encoder_kernel import mixed_word
from saf_gen.core.compiled import compiled_unchecked

U = np.uint64
INVERSE_LOG_2, LOG_2_HIGH, LOG_2_LOW = 1.4426950408889634, 0.6931471803691238, 1.9082149292705877e-10
FACTORS = tuple(1.0 / factorial(n) for n in range(14))  # of the series of exp
HALVES = 2.0 ** -np.arange(1023.0)
RECEPTOR, STORED, DEAD_UNTIL, PATIENCE, FIRED = range(5)  # rows of the state
ON_FACTOR, OFF_FACTOR, DRIFT = range(3)  # rows of the constants
LANES = 64  # pixels that are advanced together
EXPONENTIALS = 1 << 16
"""Entries of the table of exponential waiting times."""
TICK_S = 1e-6
"""What an event may wait for the bus, seconds, and still count as read when it happened: its time is told no finer."""


@njit(inline="always")
def _exp(x: Any) -> Any:
    """Return exp(x) of x ≤ 0 to a relative 1e-15, from sums and products alone; 1e-304 below -700."""
    x = max(x, -700.0)
    k = np.floor(x * INVERSE_LOG_2 + 0.5)
    r = x - k * LOG_2_HIGH - k * LOG_2_LOW
    series = FACTORS[13]
    for n in range(12, -1, -1):
        series = FACTORS[n] + r * series
    return series * HALVES[U(np.int32(-k))]


@njit(inline="always")
def _level(t: Any, w: Any, slope: Any, rest: Any, tau: Any) -> Any:
    """Return u a time t after the beginning of a cell."""
    return w + slope * (t - tau) + rest * _exp(-t / tau) if tau > 0.0 else 1.0 / (w + slope * t)


@njit(inline="always")
def _slope(t: Any, w: Any, slope: Any, rest: Any, tau: Any) -> Any:
    """Return du/dt; without a time constant ``w`` and ``slope`` are of the light, and u is its inverse."""
    if tau > 0.0:
        return slope - rest / tau * _exp(-t / tau)
    light = w + slope * t
    return -slope / (light * light)


@compiled_unchecked
def _turn(begin: Any, end: Any, w: Any, slope: Any, rest: Any, tau: Any) -> Any:
    """Return when u turns between two times at which its slopes differ in sign, by bisection to 0.1 ns."""
    rises = _slope(begin, w, slope, rest, tau) > 0.0
    while end - begin > 1e-10:
        middle = 0.5 * (begin + end)
        if (_slope(middle, w, slope, rest, tau) > 0.0) == rises:
            begin = middle
        else:
            end = middle
    return 0.5 * (begin + end)


@compiled_unchecked
def _crossing(
    begin: Any, end: Any, w: Any, slope: Any, rest: Any, tau: Any, bound: Any, drift: Any, side: Any
) -> Any:  # fmt: skip
    """Return when u crosses ``bound·(1 + drift·t)`` between two times: a Newton iteration that stays bracketed.

    ``side`` is 1 if u minus the bound changes from below to above, -1 from above to below.
    """
    t = 0.5 * (begin + end)
    for _ in range(60):
        short = side * (_level(t, w, slope, rest, tau) - bound * (1.0 + drift * t))
        if short >= 0.0:
            end = t
        else:
            begin = t
        steep = side * (_slope(t, w, slope, rest, tau) - bound * drift)
        step = t - short / steep if steep > 0.0 else begin
        fresh = step if begin < step < end else 0.5 * (begin + end)
        if abs(fresh - t) < 1e-11 or end - begin < 1e-11:
            return fresh
        t = fresh
    return t


@njit(inline="always")
def _add_light(
    light: Any, dark: Any, stack: Any, base: Any, width: Any, knot: Any, fraction: Any, gain: Any
) -> Any:  # fmt: skip
    """Set the light of the pixels of a block at an edge of a cell."""
    after = min(knot + 1, stack.shape[1] - 1)
    for i in range(width):
        light[i] = dark
    for g in range(stack.shape[0]):
        for i in range(width):
            a, b = np.float64(stack[g, knot, base + i]), np.float64(stack[g, after, base + i])
            light[i] += gain[g] * (a + fraction * (b - a))


@compiled_unchecked
def _fire(
    start: Any, span: Any, u: Any, after: Any, w: Any, slope: Any, rest: Any, tau: Any, stored: Any, on: Any, off: Any,
    drift: Any, dead: Any, patience: Any, fired: Any, hazard: Any, refractory_s: Any, drawn: Any, pixel_key: Any,
    waits: Any, pixel: Any, when: Any, where: Any, rises: Any, written: Any, single: Any
) -> Any:  # fmt: skip
    """Write the events of a pixel in a cell; return its stored level, reset, waiting time, draws, and all events.

    If ``single``, stop after the first one, and return when in the cell it was, else -1: go on from there.
    """
    begin, steady = max(fired, 0.0), True
    if tau > 0.0:
        steady = (_slope(0.0, w, slope, rest, tau) > 0.0) == (_slope(span, w, slope, rest, tau) > 0.0)
    turn = span if steady else _turn(0.0, span, w, slope, rest, tau)
    while True:
        if dead >= 0.0:  # in reset: nothing is compared, and the level at its end is stored
            if dead >= start + span:
                break
            begin = max(dead - start, 0.0)
            stored, dead = _level(begin, w, slope, rest, tau) / (1.0 + drift * begin), -1.0
        end = turn if begin < turn else span
        reached = u if begin == 0.0 else _level(begin, w, slope, rest, tau)
        at, rising = np.inf, False
        if reached <= stored * on * (1.0 + drift * begin):  # a jump of the light
            at, rising = begin, True
        elif reached >= stored * off * (1.0 + drift * begin):
            at = begin
        else:
            level = after if end == span else _level(end, w, slope, rest, tau)
            if level <= stored * on * (1.0 + drift * end):
                at = _crossing(begin, end, w, slope, rest, tau, stored * on, drift, -1.0)
                rising = True
            elif level >= stored * off * (1.0 + drift * end):
                at = _crossing(begin, end, w, slope, rest, tau, stored * off, drift, 1.0)
        until = min(at, end)
        if hazard * (until - begin) >= patience and hazard > 0.0:
            at = begin + patience / hazard
            word = mixed_word(pixel_key + drawn * U(0xD1342543DE82EF95))
            drawn += U(1)
            rising = (word & U(1)) == U(0)
            patience = waits[(word >> U(1)) & U(EXPONENTIALS - 1)]
        else:
            patience -= hazard * (until - begin)
        if at == np.inf:
            begin = end
            if end == span:
                break
            continue
        if written < when.shape[0]:
            when[written], where[written], rises[written] = start + at, pixel, rising
        written += 1
        if refractory_s > 0.0:
            dead = start + at + refractory_s
            if single:
                return stored, dead, patience, at, drawn, written
            continue
        # Without a reset, a jump of the light passes several thresholds at one instant.
        drifted = stored * (1.0 + drift * at)
        jumped = at == begin and not drifted * on < reached < drifted * off
        crossed = on if rising else off
        stored = stored * crossed if jumped else _level(at, w, slope, rest, tau) / (1.0 + drift * at)
        if single:
            return stored, dead, patience, at, drawn, written
        begin = at
    return stored, dead, patience, -1.0, drawn, written


@compiled_unchecked
def record_pixels(
    first: Any, stop: Any, stack: Any, seconds: Any, index: Any, fraction: Any, gain: Any, dark: Any, receptor_e: Any,
    receptor_s: Any, refractory_s: Any, shot_hz: Any, shot_half: Any, constants: Any, state: Any, draws: Any, key: Any,
    waits: Any, when: Any, where: Any, rises: Any, single: Any
) -> Any:  # fmt: skip
    """Advance pixels from ``first`` on through all cells, in place, and return how far it came.

    It returns the pixel after the last one done, the number of events written, and the number that the next pixel
    makes, if they did not fit: call it again from there, with more room.

    Parameters
    ----------
    first, stop : int
        First pixel, and the one after the last.
    stack : ndarray of float32, shape (G, K, P)
        Light of each group at each knot at gain 1, electrons per second.
    seconds : ndarray of float64, shape (n + 1,)
        Edges of the cells.
    index, fraction : ndarray of int64, float64, shape (n + 1,)
        Knot before the position of the lens at each edge, and the fraction of the way to the next.
    gain : ndarray of float64, shape (n, 2, G)
        Gain of each group at the beginning and at the end of each cell.
    dark : float
        Dark current, electrons per second, above 0.
    receptor_e, receptor_s : float
        Charge and smallest time constant of the photoreceptor; both 0 if it follows at once.
    refractory_s : float
        Time in reset after an event, seconds.
    shot_hz, shot_half : float
        Rate of random events in the dark, and the light that halves it.
    constants : ndarray of float64, shape (3, P)
        exp(-θ_on), exp(θ_off), and the relative drift of the stored level, 1/s.
    state : ndarray of float64, shape (5, P)
        u, the stored level, the end of the reset (-1 if there is none), how much of a unit exponential waiting time is
        left until the next random event, and when in the cell the pixel fired, if the rest of the cell is still to come
        (else -1). u is negative before the first call.
    draws : ndarray of uint64, shape (P,)
        Random numbers that each pixel has used.
    key : uint64
        Key of the random numbers.
    waits : ndarray of float64, shape (EXPONENTIALS,)
        Table of unit exponential waiting times.
    when, where, rises : ndarray of float64, int64, bool, shape (room,)
        Receive the instant, pixel and polarity of each event.
    single : bool
        There is one cell, in which a pixel stops after an event: call it again, after setting the end of its reset.
    """
    cells = seconds.shape[0] - 1
    room, written = when.shape[0], 0
    follows = receptor_e > 0.0 or receptor_s > 0.0
    light0, light1 = np.empty(LANES), np.empty(LANES)
    level, slope, rest = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    tau, after, hazard = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    calm = np.empty(LANES, np.bool_)
    drawn = np.empty(LANES, np.uint64)
    u, stored, dead, patience = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
    fired = np.empty(LANES)
    on, off, drift = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for block in range(first, stop, LANES):
        base, width, before = U(block), U(min(LANES, stop - block)), written
        for i in range(width):
            pixel = base + i
            u[i], stored[i], drawn[i] = state[RECEPTOR, pixel], state[STORED, pixel], draws[pixel]
            dead[i], patience[i], fired[i] = state[DEAD_UNTIL, pixel], state[PATIENCE, pixel], state[FIRED, pixel]
            on[i], off[i], drift[i] = constants[ON_FACTOR, pixel], constants[OFF_FACTOR, pixel], constants[DRIFT, pixel]
        for cell in range(cells):
            start = seconds[cell]
            span = seconds[cell + 1] - start
            _add_light(light0, dark, stack, base, width, index[cell], fraction[cell], gain[cell, 0])
            _add_light(light1, dark, stack, base, width, index[cell + 1], fraction[cell + 1], gain[cell, 1])
            if u[0] < 0.0:  # settled, and just reset, when the recording begins
                for i in range(width):
                    stored[i] /= light0[i]
                    u[i] = 1.0 / light0[i]
            if follows:
                for i in range(width):
                    mean = 0.5 * (light0[i] + light1[i])
                    tau[i] = receptor_s + receptor_e / mean
                    level[i] = 1.0 / light0[i]
                    slope[i] = (1.0 / light1[i] - level[i]) / span
                    rest[i] = u[i] - level[i] + slope[i] * tau[i]
                    decay = _exp(-span / tau[i])
                    after[i] = level[i] + slope[i] * (span - tau[i]) + rest[i] * decay
                    hazard[i] = shot_hz * shot_half / (shot_half + mean)
                    steep = rest[i] / tau[i]
                    calm[i] = (slope[i] > steep) == (slope[i] > steep * decay)
            else:
                for i in range(width):
                    tau[i], rest[i] = 0.0, 0.0
                    level[i] = light0[i]
                    slope[i] = (light1[i] - light0[i]) / span
                    u[i], after[i] = 1.0 / light0[i], 1.0 / light1[i]  # the light may have jumped
                    hazard[i] = shot_hz * shot_half / (shot_half + 0.5 * (light0[i] + light1[i]))
                    calm[i] = True
            for i in range(width):
                drifted = 1.0 + drift[i] * span
                low, high = stored[i] * on[i], stored[i] * off[i]
                calm[i] = (
                    calm[i]
                    & (dead[i] < 0.0)
                    & (fired[i] < 0.0)
                    & (u[i] > low)
                    & (u[i] < high)
                    & (after[i] > low * drifted)
                    & (after[i] < high * drifted)
                    & ((hazard[i] * span < patience[i]) | (hazard[i] <= 0.0))
                )
            for i in range(width):
                if calm[i]:
                    patience[i] -= hazard[i] * span
                    continue
                if dead[i] >= start + span:  # in reset, or waiting for the bus, throughout
                    fired[i] = -1.0
                    continue
                pixel = base + i
                stored[i], dead[i], patience[i], fired[i], drawn[i], written = _fire(
                    start, span, u[i], after[i], level[i], slope[i], rest[i], tau[i], stored[i], on[i], off[i],
                    drift[i], dead[i], patience[i], fired[i], hazard[i], refractory_s, drawn[i],
                    mixed_word(key + pixel * U(0x9E3779B97F4A7C15)), waits, pixel, when, where, rises, written, single,
                )  # fmt: skip
            for i in range(width):
                if fired[i] < 0.0:
                    u[i] = after[i]
                    stored[i] *= 1.0 + drift[i] * span * (1.0 + 0.5 * drift[i] * span)
        if written > room:  # these pixels do not fit: forget them, and say so
            return block, before, written - before
        for i in range(width):
            pixel = base + i
            state[RECEPTOR, pixel], state[STORED, pixel], draws[pixel] = u[i], stored[i], drawn[i]
            state[DEAD_UNTIL, pixel], state[PATIENCE, pixel], state[FIRED, pixel] = dead[i], patience[i], fired[i]
    return stop, written, 0


@compiled_unchecked
def read_out(when: Any, pause: Any, bus_free: Any) -> Any:
    """Return when each of the requests for the bus, in their order, is served, and when the bus is free after them."""
    read = np.empty(when.shape[0])
    for n in range(when.shape[0]):
        read[n] = max(when[n], bus_free)
        bus_free = read[n] + pause
    return read, bus_free


@compiled_unchecked
def record_queue(
    stack: Any, seconds: Any, index: Any, fraction: Any, gain: Any, dark: Any, receptor_e: Any, receptor_s: Any,
    refractory_s: Any, shot_hz: Any, shot_half: Any, constants: Any, state: Any, draws: Any, key: Any, waits: Any,
    pause: Any, bus_free: Any
) -> Any:  # fmt: skip
    """Advance all pixels through all cells as :func:`record_pixels` does, while events wait for each other.

    The bus has read all earlier events at ``bus_free``, in seconds, and then needs ``pause`` for each.

    Returns
    -------
    when, read, where, rises : ndarray of float64, float64, int64, bool, shape (n,)
        When each event happened and was read, its pixel and polarity, in the order in which they are read.
    bus_free : float
        When the bus has read all of them.
    """
    pixels, count, room = stack.shape[2], 0, 1 << 16
    asked, of, rising = np.empty(pixels), np.empty(pixels, np.int64), np.empty(pixels, np.bool_)
    when, read, where, rises = np.empty(room), np.empty(room), np.empty(room, np.int64), np.empty(room, np.bool_)
    for cell in range(seconds.shape[0] - 1):
        edges = slice(cell, cell + 2)
        cut = seconds[edges], index[edges], fraction[edges], gain[cell : cell + 1]
        _, requests, _ = record_pixels(
            0, pixels, stack, *cut, dark, receptor_e, receptor_s, refractory_s, shot_hz, shot_half,
            constants, state, draws, key, waits, asked, of, rising, True,
        )  # fmt: skip
        queue = [(asked[n], of[n], rising[n]) for n in range(requests)]
        heapify(queue)
        while len(queue) > 0:
            at, pixel, rise = heappop(queue)
            if count == room:
                room *= 2
                when, read = np.append(when, np.empty(count)), np.append(read, np.empty(count))
                where, rises = np.append(where, np.empty_like(where)), np.append(rises, np.empty_like(rises))
            when[count], read[count], where[count], rises[count] = at, max(at, bus_free), pixel, rise
            bus_free = read[count] + pause
            if read[count] - at > TICK_S:
                state[DEAD_UNTIL, pixel] = read[count] + refractory_s
            count += 1
            _, requests, _ = record_pixels(
                pixel, pixel + 1, stack, *cut, dark, receptor_e, receptor_s, refractory_s, shot_hz, shot_half,
                constants, state, draws, key, waits, asked, of, rising, True,
            )  # fmt: skip
            if requests > 0:
                heappush(queue, (asked[0], of[0], rising[0]))
    return when[:count], read[:count], where[:count], rises[:count], bus_free
