"""The picture of a thin section that a condenser lights: partially coherent imaging by Abbe's sum.

A thin section changes a wave that passes it by the factor

    T(X) = √(transmission)·exp(2πi/λ·path),

where path is the optical thickness (m) beyond that of the mounting medium. The condenser fills a disc of the aperture
with light whose points send plane waves that do not interfere with each other. The point s of this disc gives the
intensity

    I_s(X) = |Σ_ν T̂(ν)·P(ν + s)·exp(2πi·ν·X)|²,     P(ν) = exp(2πi/λ·W(a)) inside the aperture, 0 outside,

and the picture is their weighted sum. A wave of the frequency ν (cycles per metre, at the section) meets the lens at
a = λ·y·ν, y being the distance of the section. W is the wavefront of the lens plus that of defocus, a²/2·(1/y - 1/u).
All of this is paraxial, as the rays of this package are: the numerical aperture is R/y. Nothing is random.

**Coherence** S is the radius of the condenser's disc divided by that of the lens's aperture: 0 is a plane wave, and
from about 2 on, the picture is that of incoherent light. A clear section has the intensity 1 up to S = 1 and 1/S²
beyond it.

**Source points** lie on seven rings at the nodes of Gauss and Legendre in the squared radius, in pairs s and -s, so a
weak phase section has no contrast in focus. These 228 points give the transfer of weak sections within 0.02 of the
integral over the condenser, 0.01 rms; beyond S = 1 there are more. Far from focus the condenser averages away what is
fine, and so does the sum up to MAX_SWING radians of defocus from its middle to its edge; what is finer, of which 0.02
or less is left, is left out.

**Period.** Waves are summed over a period that is wider than the field by a guard band: how far defocus spreads a wave
at the ends of the travel, and FADE resolved widths λ·y/R more, in which the section fades to clear. Beyond its array a
section is clear. Intensities are sampled finely enough not to alias, and integrated over each pixel by their Fourier
series.

References
----------
M. Born and E. Wolf, "Principles of Optics" (1999), section 10.6.
H. H. Hopkins, "On the diffraction theory of optical images", Proc. R. Soc. A 217, 408 (1953),
doi:10.1098/rspa.1953.0071.
"""

import math
from functools import lru_cache

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.optics._drive import Drive
from saf_gen.optics.fitted_rays import FittedRays
from saf_gen.optics.texture_contrast import Imaging

FADE = 8.0  # resolved widths λ·y/R
RINGS = 7  # of the condenser within the aperture
POINTS = 7.0  # on the outermost ring, times the number of rings
MAX_SWING = 20.0
BATCH = 8  # source points at once
MAX_SIDE = 1 << 14
"""Most texels along a side of the period."""


@lru_cache(maxsize=32)
def source_points(coherence: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of the condenser in units of the aperture's radius, and their weights: x, y, w, float64 (point,).

    The sum of the weights is 1. Beyond the aperture there are rings of their own, so what passes is exactly 1/S².
    """
    inner = min(coherence, 1.0)
    rings = [_rings(0.0, inner, count=RINGS)]
    if coherence > 1:
        rings.append(_rings(inner, coherence, count=math.ceil(RINGS * (coherence - 1)) + 1))
    found = []
    for k, (radius, area) in enumerate(np.concatenate(rings)):
        count = 2 * math.ceil(POINTS * RINGS * radius / inner / 2)  # even: with each point its opposite
        angle = 2 * np.pi * (np.arange(count) + 0.618 * k) / count
        weight = np.full(count, area / (count * coherence**2))
        found.append((radius * np.cos(angle), radius * np.sin(angle), weight))
    x, y, weight = (np.concatenate(part) for part in zip(*found, strict=True))
    return x, y, weight


def _rings(inner: float, outer: float, *, count: int) -> np.ndarray:
    """Return radii and areas (over π) of rings that fill an annulus, float64 (ring, 2)."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = (outer**2 - inner**2) / 2
    return np.stack([np.sqrt(inner**2 + half * (nodes + 1)), half * weights], axis=1)


def check_lens(drive: Drive) -> None:
    """Raise BadInput if a lens differs over the field, which no single pupil describes."""
    for name, found in {"vignetting": drive.ring, "distortion": drive.distortion}.items():
        if found is not None:
            raise BadInput(
                f"a section is drawn by waves through one pupil, without {name}", hint=f"leave {name} out of scene.yaml"
            )
    if isinstance(drive.wavefront, FittedRays):
        raise BadInput(
            "a section is drawn by waves through one pupil, and the lens of the card is read from a file",
            allowed="a lens that the card describes",
        )
    if drive.wavefront is not None and drive.wavefront.varies_over_field:
        raise BadInput(
            "a section is drawn by waves through one pupil, but the aberrations of the lens vary over the field",
            allowed="spherical aberration alone",
            hint="leave coma, astigmatism and field_curvature out of scene.yaml, and focus.aberrations out of a recipe",
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

        radius = self._drive.aperture_radius_m / (self._wavelength_m * self._distance(position))
        sizes = [math.floor(2 * radius * period) + 2 for period in self._periods]  # lines across the aperture
        lengths = [
            max(size, _fast_length(math.ceil((2 * radius + finest) * period) + 1))
            for size, period in zip(sizes, self._periods, strict=True)
        ]
        total = np.zeros(lengths, np.float32)
        sources = list(zip(*source_points(coherence), strict=True))
        for first in range(0, len(sources), BATCH):
            blocks = [
                self._passed(position, (y * radius, x * radius), weight=weight, sizes=sizes)
                for x, y, weight in sources[first : first + BATCH]
            ]
            # Where a block lies among the frequencies changes the phase of its wave alone.
            waves = fft.ifft(np.stack(blocks), n=lengths[0], axis=1, norm="forward", workers=self._threads)
            waves = fft.ifft(waves, n=lengths[1], axis=2, norm="forward", workers=self._threads, overwrite_x=True)
            parts = waves.view(np.float32)
            np.multiply(parts, parts, out=parts)
            squares = parts.sum(axis=0)
            total += squares[:, 0::2]
            total += squares[:, 1::2]
        return total

    def _passed(self, position: float, source: tuple[float, float], *, weight: float, sizes: list[int]) -> np.ndarray:
        """Return T̂(ν)·P(ν + s) where P is not 0, times the root of the source's weight: complex64 (row, col)."""
        radius, to_lens = self._drive.aperture_radius_m, self._wavelength_m * self._distance(position)
        starts = [math.ceil((-radius / to_lens - s) * period) for s, period in zip(source, self._periods, strict=True)]
        down, across = (
            to_lens * ((start + np.arange(size)) / period + s)
            for start, size, period, s in zip(starts, sizes, self._periods, source, strict=True)
        )
        turn = 1j * np.pi / self._wavelength_m * float(self._drive.defocus(position, self._depth_m))
        rows, columns = (
            slice(start - low, start - low + size) for start, low, size in zip(starts, self._lowest, sizes, strict=True)
        )
        factor = (math.sqrt(weight) * np.exp(turn * down**2)).astype(np.complex64)
        block = self._spectrum[rows, columns] * factor[:, None] * np.exp(turn * across**2).astype(np.complex64)
        if self._drive.wavefront is not None:
            assert not isinstance(self._drive.wavefront, FittedRays)  # refused before
            path = self._drive.wavefront.path((across, down[:, None]), (0.0, 0.0))
            block *= np.exp(2j * np.pi / self._wavelength_m * path).astype(np.complex64)
        block *= (down**2)[:, None] + across**2 <= radius**2
        return block

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
