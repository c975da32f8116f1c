"""The picture of a thin section that a condenser lights: partially coherent imaging by a sum of coherent modes.

A thin section changes a wave that passes it by the factor

    T(X) = √(transmission)·exp(2πi/λ·path),

where path is the optical thickness (m) beyond that of the mounting medium. The condenser fills a disc of the aperture
with light whose points send plane waves that do not interfere with each other. The point s of this disc gives the
intensity

    I_s(X) = |Σ_ν T̂(ν)·P(ν + s)·exp(2πi·ν·X)|²,     P(ν) = exp(2πi/λ·W(a)) inside the aperture, 0 outside,

and the picture is their mean over the condenser (Abbe). A wave of the frequency ν (cycles per metre, at the section)
meets the lens at a = λ·y·ν, y being the distance of the section. W is the wavefront of the lens plus that of defocus,
a²/2·(1/y - 1/u). All of this is paraxial, as the rays of this package are: the numerical aperture is R/y. Nothing is
random.

**Coherence** S is the radius of the condenser's disc divided by that of the lens's aperture: 0 is a plane wave, and
from about 2 on, the picture is that of incoherent light. A clear section has the intensity 1 up to S = 1 and 1/S²
beyond it.

**Modes.** The mean over s is a sum over modes n that are coherent in themselves, |Σ_ν T̂(ν)·φ_n(ν)·exp(2πi·ν·X)|²
(Gamo). Condenser and lens are round, so φ = f(|ν|)·exp(±i·m·angle of ν), and the integral over the angle of s gives the
m-th Fourier coefficient of P on a ring of the condenser. Rings lie at the nodes of Gauss and Legendre in the squared
radius. Of each m, those mixtures of rings come first that bring most light of this section. Modes are summed until at
most MAX_LEFT_OUT of the light is left out, or until there are MAX_MODES of them, each with m > 0 standing for two; what
is left out is added as an even light. In focus few are needed, far from it as many as the square of the defocus.

Far from focus the condenser averages away what is fine: beyond MAX_SWING radians of defocus from its middle to its
edge 0.02 or less is left of a frequency, which is left out.

**Period.** Waves are summed over a period that is wider than the field by a guard band: how far defocus spreads a wave
at the ends of the travel, and FADE resolved widths λ·y/R more, in which the section fades to clear. Beyond its array a
section is clear. Intensities are sampled finely enough that only what is averaged away aliases, and integrated over
each pixel by their Fourier series.

References
----------
M. Born and E. Wolf, "Principles of Optics" (1999), section 10.6.
H. H. Hopkins, "On the diffraction theory of optical images", Proc. R. Soc. A 217, 408 (1953),
doi:10.1098/rspa.1953.0071.
H. Gamo, "Matrix treatment of partial coherence", Progress in Optics 3, 187 (1964), doi:10.1016/S0079-6638(08)70574-X.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.fitted_rays import FittedRays
from saf_gen.optics.texture_contrast import Imaging

FADE = 8.0  # resolved widths λ·y/R
MAX_LEFT_OUT, MAX_MODES = 2e-4, 128  # share of the light that modes may leave out; their largest number up to S = 1
RADII, FINER = 1024, 16  # at which the profile of a mode is computed; steps between them at which it is interpolated
MAX_SWING = 20.0
MAX_SIDE = 1 << 14
"""Most texels along a side of the period."""


def check_lens(drive: Drive) -> None:
    """Raise BadInput if a lens differs over the field, which no single pupil describes."""
    wavefront = drive.wavefront
    varies = wavefront is not None and (isinstance(wavefront, FittedRays) or wavefront.varies_over_field)
    if varies or drive.ring or drive.distortion:
        raise BadInput(
            "a section is drawn by waves through one pupil, and its lens differs over the field",
            allowed="a lens that the card describes, with spherical aberration alone",
            hint="leave other aberrations, and vignetting, out of scene.yaml, and focus.aberrations out of a recipe",
        )


def samples_per_pixel(imaging: Imaging) -> float:
    """Return the number of points per pixel at which intensities are summed in focus, whatever the condenser."""
    return (4 * imaging.radius_m * imaging.pitch_m / (imaging.wavelength_m * imaging.image_distance_m)) ** 2


class SectionImages:
    """The pictures of a thin section, position by position.

    Parameters
    ----------
    amplitude : ndarray of complex, shape (row, col)
        T at points texel_m apart, as the upright picture shows them: the first row at the top.
    texel_m : float
        Distance between neighbouring points, metres.
    drive : Drive
        Lens and focus drive.
    rows, columns : int
        Size of the sensor, pixels.
    pitch_m : float
        Pitch of its pixels, metres.
    depth_m : float
        Depth of the section, metres, in the frame of the scene card.
    wavelength_m : float
        Wavelength of the light, metres.
    coherence : float
        Largest S of the pictures.
    threads : int, default 1
        Number of threads.

    Raises
    ------
    BadInput
        If the lens runs into the section, its aberrations vary over the field, or texels are too coarse or too many.
    """

    def __init__(
        self,
        amplitude: np.ndarray,
        texel_m: float,
        *,
        drive: Drive,
        rows: int,
        columns: int,
        pitch_m: float,
        depth_m: float,
        wavelength_m: float,
        coherence: float,
        threads: int = 1,
    ) -> None:
        check_lens(drive)
        self._drive, self._depth_m, self._wavelength_m, self._threads = drive, depth_m, wavelength_m, threads
        self._shape, self._pitch_m = (rows, columns), pitch_m
        ends = np.array([0.0, 1.0])
        distance, radius = depth_m - drive.shift(ends), drive.aperture_radius_m
        if not distance.min() > 0:
            raise BadInput(
                f"the stage runs the section into the lens: it is {depth_m:.6g} m in front of it",
                allowed=f"more than the travel's end, {float(drive.shift(ends).max()):g} m (travel_m in scene.yaml)",
                hint="shorten the travel, or lower the section",
            )
        resolved = wavelength_m * distance / radius
        finest = float(resolved.min()) / (2 * (1 + coherence))
        if texel_m > finest:
            raise BadInput(
                f"texels of {texel_m * 1e6:.3g} µm cannot hold the detail of a section that the lens resolves",
                allowed=f"at most {finest * 1e6:.3g} µm",
                hint="draw the section with more texels",
            )
        reach = float((radius * distance * np.abs(drive.defocus(ends, depth_m))).max())
        scale = float((distance / drive.image_distance(ends)).max())
        fade = FADE * float(resolved.max())
        self.guard_m = reach + fade
        spans = [2 * self.guard_m + count * pitch_m * scale for count in self._shape]
        if max(spans) > MAX_SIDE * texel_m:
            raise BadInput(
                f"the field and its guard band are {max(spans) * 1e6:,.0f} µm wide, {max(spans) / texel_m:,.0f} texels",
                allowed=f"at most {MAX_SIDE:,} texels",
                hint="draw the section with coarser texels, choose a smaller sensor, or shorten travel_m",
            )
        texels = [_fast_length(math.ceil(span / texel_m)) for span in spans]
        self._periods = [count * texel_m for count in texels]
        # Of the window that is a period, the middle of the array is the middle of the field.
        before = [(count - size) // 2 for count, size in zip(texels, amplitude.shape, strict=True)]
        self._middles = [(n + (size - 1) / 2) * texel_m for n, size in zip(before, amplitude.shape, strict=True)]
        seen = _place(amplitude, texels, before=before)
        seen *= np.outer(*(_fade_at_ends(count, fade / texel_m) for count in texels))
        seen += 1
        most = [math.ceil((1 + coherence) / float(resolved.min()) * period) + 3 for period in self._periods]
        self._lowest = [-line for line in most]
        self._spectrum = _low_frequencies(seen, most, threads=threads)

    def picture(self, position: float, *, coherence: float) -> np.ndarray:
        """Return the mean intensity over each pixel at a focus position, float32 (row, col).

        Parameters
        ----------
        position : float
            Position of the drive, 0 to 1.
        coherence : float
            S, above 0 and at most that of the constructor.
        """
        finest = self._finest(position, coherence)
        intensity = self._intensity(position, coherence, finest=finest)
        rows, columns = (
            self._integrate(axis, position, length=intensity.shape[axis], finest=finest) for axis in (0, 1)
        )
        seen: np.ndarray = rows @ intensity @ columns.T
        return seen

    def _finest(self, position: float, coherence: float) -> float:
        """Return the finest frequency (cycles per metre of the section) of a picture."""
        radius, y = self._drive.aperture_radius_m, self._distance(position)
        # By so much, from the middle of the condenser to its edge, W differs between points of the lens λ·y·ν apart.
        swing = 2 * np.pi * coherence * radius * y * abs(float(self._drive.defocus(position, self._depth_m)))
        finest = 2 * radius / (self._wavelength_m * y)
        return finest if swing * finest <= MAX_SWING else MAX_SWING / swing

    def _distance(self, position: float) -> float:
        return self._depth_m - float(self._drive.shift(position))

    def _intensity(self, position: float, coherence: float, *, finest: float) -> np.ndarray:
        """Return the intensity at evenly spaced points of the period, float32 (row, col)."""
        from scipy import fft  # takes 50 ms and is needed for sections only

        to_lens = self._wavelength_m * self._distance(position) / self._drive.aperture_radius_m
        # Nearly all that is finer than 2·finest is averaged away.
        band = min(2 / to_lens + finest, 3 * finest)
        lengths = [_fast_length(math.ceil(band * period) + 1) for period in self._periods]
        # Frequencies in units of the aperture's radius; what is beyond 1 + S passes at no point of the condenser.
        most = [
            min(-low, math.floor((1 + coherence) / to_lens * period))
            for low, period in zip(self._lowest, self._periods, strict=True)
        ]
        down, across = (
            np.arange(-line, line + 1, dtype=np.float32) * np.float32(to_lens / period)
            for line, period in zip(most, self._periods, strict=True)
        )
        block = (slice(-low - line, line - low + 1) for low, line in zip(self._lowest, most, strict=True))
        wave = self._spectrum[tuple(block)]
        radius = np.sqrt(down[:, None] ** 2 + across**2)
        along = (across + 1j * down[:, None]) / np.maximum(radius, np.float32(1e-12))
        node = np.rint(radius * np.float32(FINER * (RADII - 1) / (1 + coherence))).astype(np.int32)
        np.minimum(node, FINER * (RADII - 1), out=node)
        coarse = (node.ravel() + FINER // 2) // FINER
        power = np.bincount(coarse, (wave.real**2 + wave.imag**2).ravel(), minlength=RADII)
        turn = np.pi / self._wavelength_m * float(self._drive.defocus(position, self._depth_m))
        turn *= self._drive.aperture_radius_m**2
        modes, left_out = coherent_modes(coherence, turn=turn, aberration=self._aberration, power=power)
        wave = wave * np.exp(1j * turn * down[:, None] ** 2).astype(np.complex64)
        wave *= np.exp(1j * turn * across**2).astype(np.complex64)
        total = np.full(lengths, left_out, np.float32)
        turned, order = np.ones_like(along), 0
        for mode in modes:
            while order < mode.order:
                turned, order = turned * along, order + 1
            sides = wave * mode.profile[node]
            for part in (sides * turned, sides * turned.conj())[: 2 if mode.order else 1]:
                # Where a block lies among the frequencies changes the phase of its wave alone.
                for axis in (0, 1):
                    part = _fold(part, lengths[axis], axis=axis)
                    part = fft.ifft(part, n=lengths[axis], axis=axis, norm="forward", workers=self._threads)
                squares = part.view(np.float32)
                np.multiply(squares, squares, out=squares)
                total += squares[:, 0::2]
                total += squares[:, 1::2]
        return total

    def _aberration(self, radius: np.ndarray) -> np.ndarray:
        """Return the phase (radians) by which the lens delays light at radii in units of the aperture's."""
        wavefront = self._drive.wavefront
        if wavefront is None:
            return np.zeros_like(radius)
        assert not isinstance(wavefront, FittedRays)  # refused before
        path = wavefront.path((radius * self._drive.aperture_radius_m, 0.0), (0.0, 0.0))
        return np.asarray(2 * np.pi / self._wavelength_m * path)

    def _integrate(self, axis: int, position: float, *, length: int, finest: float) -> np.ndarray:
        """Return the weight of each evenly spaced point of a period in each pixel, float32 (pixel, point).

        They integrate the Fourier series through the values at these points over the width of the pixel.
        """
        footprint = self._pitch_m * self._distance(position) / float(self._drive.image_distance(position))
        count, period = self._shape[axis], self._periods[axis]
        places = self._middles[axis] + (np.arange(count) - (count - 1) / 2) * footprint
        most = min(math.floor(finest * period), (length - 1) // 2)
        lines = np.arange(-most, most + 1)
        series = np.zeros((count, length), complex)
        series[:, lines % length] = np.sinc(lines / period * footprint) * np.exp(
            2j * np.pi * lines / period * places[:, None]
        )
        return (np.fft.fft(series, axis=1).real / length).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Mode:
    """A part of the condenser's light that is coherent in itself: profile(|ν|)·exp(±i·order·angle of ν), both signs.

    ``profile`` is complex64, at RADII radii from 0 to 1 + S in units of the aperture's radius.
    """

    order: int
    profile: np.ndarray


def coherent_modes(
    coherence: float, *, turn: float, aberration: Callable[[np.ndarray], np.ndarray], power: np.ndarray
) -> tuple[list[Mode], float]:
    """Return the modes that bring the most light of a section, by their order, and the intensity left out.

    Parameters
    ----------
    coherence : float
        S.
    turn : float
        Phase of defocus at the edge of the aperture, radians. Modes are without exp(i·turn·|ν|²), which all share.
    aberration : callable
        Phase (radians) of the rest of the wavefront at radii in units of the aperture's.
    power : ndarray of float, shape (RADII,)
        Sum of |T̂|² round each radius.
    """
    from scipy import fft  # takes 50 ms and is needed for sections only

    edge = np.asarray(aberration(np.linspace(0, 1, 65)))
    swing = 2 * abs(turn) * min(coherence, 1.0) + np.abs(np.diff(edge)).sum()
    orders, rings = (min(base + math.ceil(rate * swing), most) for base, rate, most in ((48, 1.2, 256), (14, 0.3, 64)))
    edges = [0.0, min(coherence, 1.0), *([coherence] if coherence > 1 else [])]
    sources = np.concatenate([_rings(a, b, count=rings) for a, b in pairwise(edges)])
    radius = np.linspace(0, 1 + coherence, RADII, dtype=np.float32)[:, None]
    step = np.pi / (2 * orders)
    cos = np.cos((np.arange(2 * orders, dtype=np.float32) + 0.5) * step)
    found, total = np.empty((orders, len(sources), RADII), np.complex64), 0.0
    for k, (source, area) in enumerate(sources.astype(np.float32)):
        # A point ν + s is inside the aperture beyond this angle between the two; a cell at its border counts in part.
        limit = np.arccos(np.clip((1 - radius**2 - source**2) / np.maximum(2 * radius * source, 1e-12), -1, 1))
        inside = np.clip(np.arange(1, 2 * orders + 1, dtype=np.float32) - limit / step, 0, 1)
        between = 2 * source * radius * cos
        phase = turn * (between + source**2)
        if edge.any():
            phase += aberration(np.sqrt(np.maximum(radius**2 + source**2 + between, 0)))
        share = float(area) / coherence**2
        total += share * float(power @ (inside**2).mean(axis=1))
        for part, of in ((np.cos(phase), found.real), (np.sin(phase), found.imag)):
            of[:, k] = math.sqrt(share) / (4 * orders) * fft.dct(inside * part, axis=1)[:, :orders].T
    # Products as small as these are made by one thread: two would wait for each other.
    seen = (found * np.sqrt(power).astype(np.float32)).reshape(orders, len(sources), -1, 64).swapaxes(1, 2)
    light, mixture = np.linalg.eigh((seen.conj() @ seen.swapaxes(2, 3)).sum(axis=1, dtype=complex))
    light *= np.where(np.arange(orders) == 0, 1, 2)[:, None]
    order, ring = np.unravel_index(np.argsort(-light, axis=None), light.shape)
    kept = int((np.cumsum(light[order, ring]) < total * (1 - MAX_LEFT_OUT)).sum()) + 1
    kept = min(kept, math.ceil(MAX_MODES * max(1.0, coherence) ** 2))
    fine = np.arange(FINER * (RADII - 1) + 1) / FINER
    modes = []
    for m, q in zip(order[:kept], ring[:kept], strict=True):
        profile = np.interp(fine, np.arange(RADII), np.einsum("k,kr->r", mixture[m, :, q], found[m]))
        modes.append(Mode(int(m), profile.astype(np.complex64)))
    modes.sort(key=lambda mode: mode.order)
    return modes, max(total - float(light[order[:kept], ring[:kept]].sum()), 0.0)


def _rings(inner: float, outer: float, *, count: int) -> np.ndarray:
    """Return radii and areas (over π) of rings that fill an annulus, float64 (ring, 2)."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = (outer**2 - inner**2) / 2
    return np.stack([np.sqrt(inner**2 + half * (nodes + 1)), half * weights], axis=1)


def _fold(wave: np.ndarray, length: int, *, axis: int) -> np.ndarray:
    """Return a spectrum of at most ``length`` lines along an axis; its wave is the same at ``length`` even points."""
    if wave.shape[axis] <= length:
        return wave
    head, *tails = np.split(wave, range(length, wave.shape[axis], length), axis=axis)
    head = head.copy()
    for tail in tails:
        np.moveaxis(head, axis, 0)[: tail.shape[axis]] += np.moveaxis(tail, axis, 0)
    return head


def _fast_length(least: int) -> int:
    from scipy import fft  # takes 50 ms and is needed for sections only

    return int(fft.next_fast_len(least))


def _place(amplitude: np.ndarray, shape: list[int], *, before: list[int]) -> np.ndarray:
    """Return T - 1 in a window of this shape that begins ``before`` texels before the array, complex128 (row, col)."""
    window = np.zeros(shape, complex)
    here, there = [], []
    for count, size, first in zip(shape, amplitude.shape, before, strict=True):
        here.append(slice(max(first, 0), min(first + size, count)))
        there.append(slice(max(-first, 0), min(count - first, size)))
    window[tuple(here)] = amplitude[tuple(there)] - 1
    return window


def _fade_at_ends(count: int, width: float) -> np.ndarray:
    """Return factors that rise from 0 to 1 over ``width`` texels at either end of a window."""
    from_end = np.minimum(np.arange(count), np.arange(count)[::-1])
    return np.sin(np.pi / 2 * np.clip(from_end / width, 0, 1)) ** 2


def _low_frequencies(amplitude: np.ndarray, most: list[int], *, threads: int) -> np.ndarray:
    """Return T̂ from -most to most lines along each axis; beyond the finest of the texels it is 0."""
    from scipy import fft  # takes 50 ms and is needed for sections only

    spectrum = fft.fft2(amplitude, norm="forward", workers=threads)
    rows, columns = (np.arange(-line, line + 1) for line in most)
    block = spectrum[np.ix_(rows % spectrum.shape[0], columns % spectrum.shape[1])]
    block *= np.outer(2 * np.abs(rows) < spectrum.shape[0], 2 * np.abs(columns) < spectrum.shape[1])
    return block.astype(np.complex64)
