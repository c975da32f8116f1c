"""Drives as they are: where a lens with hysteresis, a lag or a drift by heat was, seen in the brightness of spikes."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from saf_gen.optics.actuators import get_actuator
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.scenes import glowing_panel
from studies.laws.theory import charge_of_rate, charge_per_radiance, off_axis
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

HYSTERESIS = 0.13
LATENCY_S, RESONANCE_HZ, DAMPING = 0.02, 30.0, 0.7
DRIFT = {"per_k": 0.003, "ambient_k": 5.0, "heating_k": 20.0, "time_s": 0.1}
SETTLED_S = 0.07
"""After this time the lens on a spring follows steadily."""
FOCAL_M, F_NUMBER, KNOTS = 0.025, 4.0, 129
ENDS_M = (1000.0, 2 * FOCAL_M)
COMMAND = 8
"""Readouts between commands: each is the place to be at when the next one comes."""


@dataclass(frozen=True)
class Case:
    """A drive, what it differs in from an ideal one, and the motion that it is told."""

    name: str
    changes: dict[str, Any]
    motion: dict[str, Any]


CASES = (
    Case("hysteresis", {"hysteresis": HYSTERESIS}, {"kind": "sweep_and_return"}),
    Case(
        "lag",
        {"latency_s": LATENCY_S, "resonance_hz": RESONANCE_HZ, "damping": DAMPING},
        {"kind": "sweep", "from": 0.1, "to": 0.9},
    ),
    Case("drift", {"drift": DRIFT}, {"kind": "sweep_and_return", "from": 0.1, "to": 0.8, "dwell_s": 0.1}),
)


def _check_log(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare where the lens was, from the light on the sensor, with models of its drive; and its log with commands."""
    rows, columns, groups, frames = (40, 60, 20, 4000) if quick else (80, 120, 20, 16_000)
    length = frames // 100  # of a window
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns)
    nearest, farthest = (FOCAL_M * u / (u - FOCAL_M) for u in ENDS_M)
    v = nearest + (farthest - nearest) * np.linspace(0, 1, KNOTS)
    x = off_axis((rows, columns), sensor.pitch_m)
    axis = charge_per_radiance(
        sensor, f_number=F_NUMBER, focal_length_m=FOCAL_M, image_distance_m=nearest, off_axis_m=0.0
    )
    radiance = float(charge_of_rate(0.8, sensor) / axis)
    lens = {"focal_length_mm": 1e3 * FOCAL_M, "f_number": F_NUMBER, "focus_range_m": list(ENDS_M)}
    panel = glowing_panel("panel_driven", radiance=radiance, depth_m=0.6, half_m=0.4, lens=lens)
    # Mean charge of the pixels at each rendered position; it falls along the travel and is linear between two.
    charge = np.array(
        [
            radiance
            * charge_per_radiance(
                sensor, f_number=F_NUMBER, focal_length_m=FOCAL_M, image_distance_m=one, off_axis_m=x
            ).mean()
            for one in v
        ]
    )
    firsts = range(frames // 16, frames - length, frames // 16)
    figures = 2 * len(CASES) * len(firsts) + 1
    comparisons: list[Comparison] = []
    curves: list[Curve] = []
    for case in CASES:
        actuator = replace(get_actuator("ideal", reads="motor", **case.changes), name=case.name)
        focus = {"positions": KNOTS, "motion": case.motion}
        dataset = maker.make(Workload((panel,), sensor, frames, focus=focus, actuator=actuator))
        told = _told(case.motion, frames, hz=sensor.readout_hz)
        where = {"hysteresis": _play, "lag": _behind, "drift": _warmed}[case.name](told, sensor.readout_hz)

        def seen_in(counts: np.ndarray, charge: np.ndarray = charge) -> np.ndarray:
            """Return the position by the light of every group of pixels, which are scattered over the sensor."""
            light = charge_of_rate(counts / length, sensor).ravel().reshape(-1, groups).mean(axis=0)
            return np.interp(-light, -charge, np.linspace(0, 1, KNOTS))

        seen, law = [], []
        with dataset.open() as stream:
            log, did = (np.asarray(one, np.float64) for one in (stream.focus_position, stream.truth.lens))
            for first in firsts:
                window = slice(first, first + length)
                found = seen_in(stream.counts(window.start, window.stop))
                if case.name != "lag" or first > SETTLED_S * sensor.readout_hz:
                    comparisons.append(
                        compare_mean(
                            f"{case.name}: position at frame {first + length // 2:,}",
                            found,
                            expected=float(where[window].mean()),
                            figures=figures,
                            model_error=2e-4,
                            unit="of the travel",
                        )
                    )
                seen.append(found)
                law.append(float(where[window].mean()))
                truth = float(did[window].mean())
                comparisons.append(
                    compare_mean(
                        f"{case.name}: position less /truth/lens at frame {first + length // 2:,}",
                        found - truth,
                        expected=0.0,
                        figures=figures,
                        model_error=2e-4,
                        unit="of the travel",
                    )
                )
        step = float(np.abs(np.diff(told)).max())
        comparisons.append(
            Comparison(
                f"{case.name}: largest distance of the log from what the drive was told",
                float(np.abs(log - told).max()),
                at_most=COMMAND * step + 1e-4 + (LATENCY_S * sensor.readout_hz * step if case.name == "lag" else 0.0),
                unit="of the travel",
            )
        )
        at = np.array([told[n : n + length].mean() for n in firsts])
        if case.name == "hysteresis":
            commanded = np.array([_commanded(told)[n : n + length].mean() for n in firsts])
            comparisons.append(_loop(np.array(seen), commanded, figures=figures))
        frame = tuple((np.array(firsts) + length / 2).tolist())
        curves += [
            Curve(f"law, {case.name}", frame, tuple((np.array(law) - at).tolist())),
            Curve(f"spikes, {case.name}", frame, tuple((np.mean(seen, axis=1) - at).tolist()), "points"),
        ]
    return Finding(tuple(comparisons), Plot("frame", "position less what it was told", tuple(curves)))


def _told(motion: dict[str, Any], frames: int, *, hz: float) -> np.ndarray:
    """Return what a drive is told in the middle of each readout, float64 (frame,)."""
    t, first, last = (np.arange(frames) + 0.5) / frames, motion.get("from", 0.0), motion.get("to", 1.0)
    if motion["kind"] == "sweep":
        return np.asarray(first + (last - first) * t)
    rest = motion.get("dwell_s", 0.0) * hz / frames
    arrival = (1 - rest) / 2
    return np.interp(t, [0, arrival, arrival + rest, 1], [first, last, last, first])


def _commanded(told: np.ndarray) -> np.ndarray:
    """Return the command in force in each readout."""
    last = np.minimum((np.arange(told.size) // COMMAND + 1) * COMMAND, told.size) - 1
    return np.asarray(told[last])


def _play(told: np.ndarray, hz: float, operators: int = 16) -> np.ndarray:
    """Return where a piezo is by the model of Prandtl and Ishlinskii, coming from the middle of its travel."""
    widths = (np.arange(operators) + 0.5) / operators
    state, found = np.clip(0.5, told[0] - widths / 2, told[0] + widths / 2), []
    for command in _commanded(told):
        state = np.clip(state, command - widths / 2, command + widths / 2)
        found.append((1 - 2 * HYSTERESIS) * command + 4 * HYSTERESIS / operators * state.sum() - HYSTERESIS)
    return np.array(found)


def _behind(told: np.ndarray, hz: float) -> np.ndarray:
    """Return where a lens on a spring is behind a steady sweep: late by the latency and by 2ζ/ω."""
    late = (LATENCY_S + 2 * DAMPING / (2 * np.pi * RESONANCE_HZ)) * hz
    steady = np.arange(told.size) - late + (COMMAND - 1) / 2  # commands are ahead by that on average
    return np.interp(steady, np.arange(told.size), told)


def _warmed(told: np.ndarray, hz: float) -> np.ndarray:
    """Return where a liquid lens is that its current warms: Newton's law of cooling, readout by readout."""
    warmth, found = told[0] ** 2, []
    decay = np.exp(-1 / (hz * DRIFT["time_s"]))
    for command in _commanded(told):
        after = command**2 + (warmth - command**2) * decay
        found.append(command + DRIFT["per_k"] * (DRIFT["ambient_k"] + DRIFT["heating_k"] * (warmth + after) / 2))
        warmth = after
    return np.array(found)


def _loop(seen: np.ndarray, told: np.ndarray, *, figures: int) -> Comparison:
    """Return the width of the loop halfway, from what was seen (window, group) of a sweep there and back."""
    turn = int(np.argmax(told))
    widths = [
        np.interp(0.5, told[turn:][::-1], group[turn:][::-1]) - np.interp(0.5, told[: turn + 1], group[: turn + 1])
        for group in seen.T
    ]
    return compare_mean(
        "hysteresis: width of the loop halfway",
        np.array(widths),
        expected=HYSTERESIS,
        figures=figures,
        model_error=HYSTERESIS / 100,  # chords between windows
        unit="of the travel",
    )


LAWS = (
    Law(
        "drive_log",
        "A lens is where its drive puts it, which the stream states as truth, and not where its log says it was sent: "
        "a piezo has hysteresis, a lens on a spring lags, and a liquid lens drifts as its current warms it.",
        "y = (1 − 2h)·u + (4h/16)·Σ P_d[u] − h; x(t) = u(t − t₀ − 2ζ/ω); x = u + k·(T + ΔT·q), q′ = (u² − q)/τ",
        "P. Krejčí, K. Kuhnen, 2001, doi:10.1049/ip-cta:20010375; K. Ogata, Modern Control Engineering, 2010; Newton's "
        "law of cooling",
        "An even field through a lens that moves from f to 2f and loses three quarters of its light on the way: "
        "positions follow from the charge in windows of 160 frames. Three drives: h = 0.13, sent there and back; 20 ms "
        "of latency and a spring of 30 Hz; a drift with a time of 0.1 s.",
        "The scatter between groups of pixels (one false alarm in 10,000 runs), and 0.0002 of the travel, for motion "
        "within a window; the log may differ from the motion by the steps of its commands and by their latency.",
        _check_log,
    ),
)
