"""Colour: the focus and the charge under lamps of different spectra, by own sums over wavelengths."""

from functools import cache
from pathlib import Path

import numpy as np
from scipy.constants import c, h, k

import saf_gen
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.lenses import stop_windows
from studies.laws.pupils import FINEST, disc_transfer, find_peak, texture_dispersion
from studies.laws.radiometry import SETTLED, rounding_error
from studies.laws.scenes import glowing_texture
from studies.laws.theory import charge_of_rate, charge_per_radiance, sweep_mean
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

REFERENCE_NM, SECONDARY = 555.0, 2000.0
"""Wavelength of light without a spectrum; focal length of the achromat divided by its secondary spectrum."""
NM = np.arange(380, 1100) + 0.5
TABLES = Path(saf_gen.__file__).parent / "core/spectrum"
SELLMEIER = {
    "N-BK7": ((1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653)),
    "F2": ((1.34533359, 0.209073176, 0.937357162), (0.00997743871, 0.0470450767, 111.886764)),
}
"""Coefficients B and C (µm²) of n² − 1 = Σ B·λ²/(λ² − C): Schott, optical glass data sheets, 2017."""


@cache
def table(name: str) -> np.ndarray:
    """Return a published table of the package, such as ``silicon``: wavelengths (nm) and values, float64 (2, row)."""
    return np.loadtxt(TABLES / f"{name}.csv", delimiter=",", comments="#", skiprows=_heading(name)).T


def _heading(name: str) -> int:
    lines = (TABLES / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    return next(n for n, line in enumerate(lines) if line.startswith("wavelength")) + 1


def _interpolated(name: str, nm: np.ndarray) -> np.ndarray:
    """Return a published table at wavelengths (nm), 0 outside."""
    known, values = table(name)
    return np.interp(nm, known, values, left=0.0, right=0.0)


def electrons_per_nm(lamp: str, nm: np.ndarray, *, cut: bool) -> np.ndarray:
    """Return the electrons that a lamp gives per nanometre, for as much light to the eye as the reference gives one.

    The lamp is ``tungsten``, a black body of 2856 K (CIE illuminant A), or ``led``, CIE illuminant LED-B3; ``cut`` says
    whether there is an IR cut.
    """

    def power(nm: np.ndarray) -> np.ndarray:
        if lamp == "tungsten":
            return np.asarray(nm**-5.0 / np.expm1(h * c / (1e-9 * nm * k * 2856)))
        return _interpolated("led", nm)

    fine = np.arange(380, 1100.5, 0.5)
    light = float(np.sum(power(fine) * _interpolated("luminous_efficiency", fine)) * 0.5)
    silicon = _interpolated("silicon", nm) * nm
    seen = power(nm) / light * silicon / (_interpolated("silicon", np.array(REFERENCE_NM)) * REFERENCE_NM)
    return np.asarray(seen * _interpolated("ir_cut", nm) if cut else seen)


def achromat_power(nm: np.ndarray) -> np.ndarray:
    """Return by how much the power of an achromat of N-BK7 and F2 is larger than at REFERENCE_NM, relative to it.

    Both glasses together have no colour between the lines F and C; the line d comes to focus nearer by the focal length
    over SECONDARY. Source: R. Kingslake, R. B. Johnson, Lens Design Fundamentals, 2010, chapter 5.
    """

    def excess(glass: str, nm: np.ndarray) -> np.ndarray:
        squared = (nm / 1e3) ** 2
        n = np.sqrt(1 + sum(b * squared / (squared - c) for b, c in zip(*SELLMEIER[glass], strict=True)))
        return np.asarray(n - 1)

    lines = np.array([587.5618, 486.1327, 656.2725])
    d, f, red = (np.array([excess(glass, lines)[n] for glass in SELLMEIER]) for n in range(3))
    abbe = d / (f - red)
    shares = abbe * np.array([1, -1]) / (abbe[0] - abbe[1])  # of the power at d

    def curve(nm: np.ndarray) -> np.ndarray:
        return np.asarray(
            sum(share * excess(glass, nm) / at for share, glass, at in zip(shares, SELLMEIER, d, strict=True))
        )

    def power(nm: np.ndarray) -> np.ndarray:
        return np.asarray(1 - (curve(nm) - 1) / (curve(lines[1:2])[0] - 1) / SECONDARY)

    return np.asarray(power(nm) / power(np.array([REFERENCE_NM])) - 1)


DEPTH_M, FOCAL_M, F_NUMBER, HALF_DEPTHS, KNOTS = 0.65, 0.05, 2.0, 5.5, 65
IMAGE_M = 1 / (1 / FOCAL_M - 1 / DEPTH_M)
RADIUS_M = FOCAL_M / (2 * F_NUMBER)


def _check_focus(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare where SD peaks under tungsten and LED, and their charge, with sums over wavelengths."""
    rows, columns, repeats, frames = (32, 48, 6, 12_800) if quick else (64, 96, 12, 20_480)
    pitch_m = 20e-6
    half = pitch_m / (2 * RADIUS_M * IMAGE_M)
    ends = [1 / (1 / DEPTH_M + sign * HALF_DEPTHS * half) for sign in (-1, 1)]
    lens = {
        "drive": "focal_length",
        "image_distance_mm": 1e3 * IMAGE_M,
        "f_number": IMAGE_M / (2 * RADIUS_M),
        "focus_range_m": ends,
        "axial_colour": {"achromat": SECONDARY},
    }
    field_m = (columns * pitch_m * DEPTH_M / IMAGE_M, rows * pitch_m * DEPTH_M / IMAGE_M)
    scene = glowing_texture("colour", rows=rows, columns=columns, field_m=field_m, depth_m=DEPTH_M, lens=lens)
    lamps = {"tungsten": "tungsten", "led": "led"}
    knots = 1 / ends[0] + (1 / ends[1] - 1 / ends[0]) * np.linspace(0, 1, KNOTS)  # 1/u of reference light
    shift = achromat_power(NM) / IMAGE_M  # the power of the lens focused at infinity
    cycles = np.linspace(0, FINEST, 31)
    diameter = 2 * RADIUS_M * IMAGE_M * (1 / DEPTH_M - knots[:, None] - shift) / pitch_m
    transfers = disc_transfer(diameter[..., None], cycles)  # (position, wavelength, frequency)
    windows = stop_windows(KNOTS, frames)
    measure = saf_gen.get_measure("sd")
    step = 2 * HALF_DEPTHS / (KNOTS - 1)
    comparisons: list[Comparison] = []
    curves: list[Curve] = []
    zero = (KNOTS - 1) / 2 - 1  # the first window is at the second position
    x = tuple(((np.arange(len(windows)) - zero) * step).tolist())
    render = {"samples": 64 if quick else 256, "max_depth": 2, "diffraction": False}
    for cut in (False, True):
        sensor = sensor_with_noise(
            "shot", "threshold_noise", rows=rows, columns=columns, pitch_m=pitch_m, filter="ir_cut" if cut else "none"
        )
        electrons = {name: float(electrons_per_nm(name, NM, cut=cut).sum()) for name in lamps}
        charge = charge_per_radiance(
            sensor, f_number=F_NUMBER, focal_length_m=FOCAL_M, image_distance_m=IMAGE_M, off_axis_m=0.0
        )
        level = float(charge_of_rate(0.6, sensor) / charge) / max(electrons.values())
        lights = {name: {"kind": "constant", "level": level, "spectrum": lamp} for name, lamp in lamps.items()}
        dataset = maker.make(
            Workload(
                (scene,),
                sensor,
                frames,
                lights,
                focus={"positions": KNOTS, "motion": {"kind": "sweep"}},
                render=render,
                split={"repeats": repeats},
            )
        )
        for name in lamps:
            weights = electrons_per_nm(name, NM, cut=cut)
            by_knot = np.tensordot(transfers, weights / weights.sum(), (1, 0))
            mixed = np.array([sweep_mean(by_knot, window, frames=frames) for window in windows])
            own = texture_dispersion(rows, columns, cycles=cycles, transfers=mixed)
            peaks, rates, seen = [], [], []
            for repeat in range(repeats):
                with dataset.open(light=name, repeat=repeat) as stream:
                    seen.append([measure(stream.counts(w.start, w.stop)) for w in windows])
                    rate = stream.counts(SETTLED, frames) / (frames - SETTLED)
                peaks.append(find_peak(np.array(seen[-1]), around=10))
                rates.append(float(charge_of_rate(rate, sensor).mean()))
            with_cut = ", IR cut" if cut else ""
            comparisons += [
                compare_mean(
                    f"{name}{with_cut}: SD peaks at",
                    (np.array(peaks) - zero) * step,
                    expected=(find_peak(own, around=10) - zero) * step,
                    figures=8,
                    model_error=0.05,
                    unit="half depths",
                ),
                compare_mean(
                    f"{name}{with_cut}: electrons per lux, of those at 555 nm",
                    np.array(rates) / float(charge * level),
                    expected=electrons[name],
                    figures=8,
                    model_error=electrons[name] * (0.003 + rounding_error(0.1)),
                ),
            ]
            curves += [
                Curve(f"law, {name}{with_cut}", x, tuple((own / own.max()).tolist())),
                Curve(
                    f"stream, {name}{with_cut}",
                    x,
                    tuple((np.mean(seen, axis=0) / np.mean(seen, axis=0).max()).tolist()),
                    "points",
                ),
            ]
    return Finding(tuple(comparisons), Plot("position, half depths of focus", "SD / largest", tuple(curves)))


LAWS = (
    Law(
        "colour_focus",
        "Under lamps of different spectra, SD of a texture behind an achromat peaks where a sum over wavelengths says, "
        "and lux give the electrons that silicon makes of them.",
        "T(ν) = Σ w(λ)·2J₁(πcν)/(πcν), c = 2R·v·|1/d − 1/u − δ(λ)|; electrons per lux ∝ ∫ P·λ·QE·T dλ / ∫ P·V dλ",
        "Glasses: Schott, 2017; achromat: Kingslake and Johnson, 2010; lamps: CIE 015:2018; V(λ): CIE 018:2019; "
        "silicon: M. A. Green, 2008, doi:10.1016/j.solmat.2008.06.009",
        "A texture at 0.65 m through an achromat of 50 mm at f/2 whose secondary spectrum is f/2000, swept over ±5.5 "
        "half depths of focus (a blur of one pixel) under tungsten and a white LED, with and without an IR cut; each "
        "recorded with twelve draws of noise.",
        "The scatter between recordings (one false alarm in 10,000 runs), 0.05 half depths of focus, and 0.3 % of the "
        "electrons for tables in steps of 10 nm.",
        _check_focus,
    ),
)
