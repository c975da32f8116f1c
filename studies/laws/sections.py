"""Thin sections by waves: the transfer of weak absorption and weak phase under condensers of three apertures."""

import numpy as np

from studies.laws.law import Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.pupils import section_transfer as own_transfer
from studies.laws.pupils import seidel
from studies.laws.scenes import gratings
from studies.laws.theory import sweep_mean
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

FOCAL_M, MAGNIFICATION, APERTURE, WAVE_M = 8e-3, 25.0, 0.374, 550e-9
IN_FOCUS_M, IMAGE_M = FOCAL_M * (1 + 1 / MAGNIFICATION), FOCAL_M * (1 + MAGNIFICATION)
RADIUS_M = APERTURE * IN_FOCUS_M
FRACTIONS = np.array([0.25, 0.55, 0.85, 1.2])
"""Frequencies of the gratings, of the cut-off of the aperture, NA/λ."""
COHERENCES = (0.3, 0.6, 1.0)
SMALL = 0.02
"""Amplitude of each grating: what is quadratic in it is 2 % of its contrast."""
REACH_M, KNOTS = 6e-6, 7


def _check_transfer(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the contrast of weak gratings, in and out of focus, with a sum over points of the condenser."""
    rows, columns, groups, frames = 48, 160, 12, 10_000 if quick else 20_000
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns, pitch_m=10e-6)
    lens = {
        "drive": "stage",
        "focal_length_mm": 1e3 * FOCAL_M,
        "f_number": FOCAL_M / (2 * RADIUS_M),
        "magnification": MAGNIFICATION,
        "travel_m": [-REACH_M, REACH_M],
    }
    per_m = FRACTIONS * APERTURE / WAVE_M
    condensers = {f"stop_{n}": coherence for n, coherence in enumerate(COHERENCES)}
    scenes = {
        kind: gratings(
            f"gratings_{kind}",
            phase=kind == "phase",
            per_m=per_m.tolist(),
            amplitude=SMALL,
            wave_m=WAVE_M,
            condensers=condensers,
            depth_m=IN_FOCUS_M,
            lens=lens,
        )
        for kind in ("absorption", "phase")
    }
    lights = {
        lit: {name: {"kind": "constant", "level": len(condensers) * float(name == lit)} for name in condensers}
        for lit in condensers
    }
    focus = {"positions": KNOTS, "motion": {"kind": "sweep"}}
    dataset = maker.make(
        Workload(tuple(scenes.values()), sensor, frames, lights, exposure={"mean_rate": 0.4}, focus=focus)
    )
    knots = np.linspace(-REACH_M, REACH_M, KNOTS)
    stops = (-4e-6, 0.0, 4e-6)
    figures = len(scenes) * len(condensers) * len(stops) * len(FRACTIONS)
    fine = np.linspace(0.02, 1.95, 60)
    comparisons: list[Comparison] = []
    curves: list[Curve] = []
    for name, coherence in condensers.items():
        by_knot = np.array([own_transfer(FRACTIONS, coherence=coherence, waves=_waves(z)) for z in knots])
        shown = own_transfer(fine, coherence=coherence, waves=_waves(stops[2]), across=200)
        for k, kind in enumerate(scenes):
            found = np.zeros(0)
            with dataset.open(scene=scenes[kind].id, light=name) as stream:
                for stop in stops:
                    middle = round((stop / REACH_M + 1) / 2 * frames)
                    window = range(middle - frames // 50, middle + frames // 50)
                    counts = stream.counts(window.start, window.stop).astype(np.float64)
                    lines = counts.reshape(groups, -1, columns).mean(axis=1)
                    law = sweep_mean(by_knot[:, k], window, frames=frames)
                    found = _contrast(lines, per_m, pixel_m=sensor.pitch_m * (IN_FOCUS_M - stop) / IMAGE_M) / (
                        2 * SMALL
                    )
                    for n, fraction in enumerate(FRACTIONS):
                        comparisons.append(
                            compare_mean(
                                f"{kind}, S = {coherence:g}, {1e6 * stop:g} µm, {fraction:g} of NA/λ",
                                found[:, n],
                                expected=float(law[n]),
                                figures=figures,
                                model_error=0.02,
                            )
                        )
            curves += [
                Curve(f"law, {kind}, S = {coherence:g}", tuple(fine.tolist()), tuple(shown[k].tolist())),
                Curve(
                    f"stream, {kind}, S = {coherence:g}",
                    tuple(FRACTIONS.tolist()),
                    tuple(found.mean(axis=0).tolist()),
                    "points",
                ),
            ]
    return Finding(tuple(comparisons), Plot("frequency, of NA/λ, 4 µm out of focus", "transfer", tuple(curves)))


def _waves(z_m: float):  # type: ignore[no-untyped-def]
    """Return the wavefront over the pupil of a section that is z nearer to the lens than in focus."""
    return seidel(defocus=RADIUS_M**2 / 2 * (1 / (IN_FOCUS_M - z_m) - 1 / IN_FOCUS_M) / WAVE_M)


def _contrast(lines: np.ndarray, per_m: np.ndarray, *, pixel_m: float) -> np.ndarray:
    """Return the amplitude of each grating in each line, over the mean, with the loss by the width of a pixel undone.

    ``pixel_m`` is the width of a pixel on the section.
    """
    x = (np.arange(lines.shape[1]) - (lines.shape[1] - 1) / 2) * pixel_m
    phases = 2 * np.pi * np.outer(x, per_m)
    basis = np.hstack([np.ones((x.size, 1)), np.cos(phases), np.sin(phases)])
    found = np.linalg.lstsq(basis, lines.T, rcond=None)[0]
    return np.asarray((found[1 : 1 + per_m.size] / found[0]).T / np.sinc(per_m * pixel_m))


LAWS = (
    Law(
        "section_transfer",
        "A weak thin section shows its absorption and its phase as the sum over the condenser says; phase does not "
        "show in focus.",
        "T(ν) = mean over the condenser of (P(s + ν)·P*(s) ± P(s − ν)·P*(s))/2, S = aperture of condenser over lens",
        "H. H. Hopkins, 1953, doi:10.1098/rspa.1953.0071; M. Born, E. Wolf, Principles of Optics, section 10.6",
        "Gratings of 0.25 to 1.2 times NA/λ at NA 0.374, which absorb or delay light by 2 % of a radian, lit by "
        "condensers of S = 0.3, 0.6 and 1 in turn, swept from −6 to 6 µm.",
        "The scatter between groups of rows (one false alarm in 10,000 runs), and 0.02, for what is quadratic in the "
        "amplitude and for the grid of the condenser.",
        _check_transfer,
    ),
)
