"""A rock as pictures over its section: what each layer lets through, and what the upper one throws back."""

from __future__ import annotations

import numpy as np
from crystals import sheets
from minerals import MINERALS, NAMES, SHAPE, TEXEL_UM, Fabric, fabric
from optics import LEAK, PARALLEL, SINGLE, interference
from rasters import fractal, noise, sampled, soft, splat, strokes
from scipy.ndimage import gaussian_filter


def layers(params: dict, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Transmittance of both sheets, and the share that the upper one reflects; row 0 at the bottom."""
    rock = Rock(params, random)
    light, clear = rock.light(), rock.clear()
    upper = light * clear
    fine = noise(SHAPE, 2.4, random)
    rough = rock.by_mineral(2) * (0.6 * fine + 0.5 * noise(SHAPE, 5, random))  # the ground face of what has relief
    upper *= 1 + 0.26 * rough + 0.05 * fine
    marks = _polish(random)
    upper *= 1 - marks
    lower = _below(clear, random)
    back = rock.by_mineral(4) * (1 + 0.9 * (1 - clear) * (rock.by_mineral(1) > 0) + 0.3 * rough + marks)
    return upper.clip(0, 1), lower.clip(0, 1), back.clip(0.01, 0.5)


class Rock:
    """The grains with their own random crystals."""

    def __init__(self, params: dict, random: np.random.Generator) -> None:
        self.random, self.params = random, params
        self.fabric: Fabric = fabric(params["rock"], params["grain_um"], random)
        self.sheets = sheets(random)
        growth = self.fabric.growth
        self.mineral = self.fabric.mineral
        self.edge = growth.edge * np.float32(TEXEL_UM)
        self.edge[growth.first > 40] = 9.0
        row, column = np.ogrid[: SHAPE[0], : SHAPE[1]]
        each, count = self.fabric.each, len(self.fabric.kind)
        c, s = each(np.cos(self.fabric.along)), each(np.sin(self.fabric.along))
        x, y = column - each(self.fabric.column), row - each(self.fabric.row)
        self.u, self.v = c * x + s * y, c * y - s * x  # along each crystal and across it, texels
        self.shift = each(random.uniform(0, 700, count)), each(random.uniform(0, 700, count))
        self.count = count
        pair = (growth.owner * 7919 + growth.other * 7919) % 1021
        self.slant = random.gamma(1.6, 3.2, 1021).astype(np.float32)[pair]  # µm over which a boundary slopes

    def is_(self, *names: str) -> np.ndarray:
        """Where these minerals are."""
        return np.isin(np.arange(len(NAMES)), [NAMES.index(name) for name in names])[self.mineral]

    def by_mineral(self, index: int) -> np.ndarray:
        """A property at every texel."""
        return np.array([MINERALS[name][index] for name in NAMES], dtype=np.float32)[self.mineral]

    def own(
        self, sheet: np.ndarray, where: np.ndarray, *, scale: np.ndarray | float = 1.0, turn: float = 0.0
    ) -> np.ndarray:
        """What the crystals chosen by a mask see of a sheet, 0 elsewhere."""
        made = np.zeros(SHAPE, dtype=np.float32)
        there = np.nonzero(where)
        u, v = self.u[there], self.v[there]
        by = scale[there] if isinstance(scale, np.ndarray) else scale
        c, s = np.float32(np.cos(turn)), np.float32(np.sin(turn))
        rows, columns = ((c * v - s * u) * by + self.shift[0][there], (c * u + s * v) * by + self.shift[1][there])
        made[there] = sampled(sheet, rows, columns)
        return made

    def chance(self, share: float) -> np.ndarray:
        """Whether a grain is one of a share of all, at every texel."""
        return (self.random.random(self.count) < share)[self.fabric.growth.owner]

    def between(self, low: float, high: float) -> np.ndarray:
        """A number of every grain, even between two, at every texel."""
        return self.fabric.each(self.random.uniform(low, high, self.count))

    def light(self) -> np.ndarray:
        """What passes the polariser, the crystals and the analyser, without what they absorb."""
        if self.params["polars"] == "plane":
            return np.full(SHAPE, SINGLE, dtype=np.float32)
        random = self.random
        # A random axis stands at an angle with a uniform cosine to the light; birefringence goes as sin².
        seen = 1 - self.between(-0.93, 0.93) ** 2
        gamma = seen * self.by_mineral(0) * np.float32(self.params["thickness_um"] * 1e3)
        gamma *= 1 + 0.05 * noise(SHAPE, 330, random) + 0.012 * noise(SHAPE, 40, random)  # the section is a wedge
        gamma *= 0.42 + 0.58 * np.clip(self.edge / (self.slant + 0.8), 0, 1)  # a sloping boundary is one too
        first, second, share = self._vibration()
        gamma = self._altered(gamma)
        share_of_wave = interference(gamma)
        stage = np.float32(np.radians(self.params["stage_deg"]))
        light = (1 - share) * np.sin(2 * (first + stage)) ** 2 + share * np.sin(2 * (second + stage)) ** 2
        return LEAK + PARALLEL * light * share_of_wave

    def _vibration(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Direction of vibration (rad) of both individuals of a twin, and the share of the second."""
        along = self.fabric.each(self.fabric.along)
        own = self.sheets
        plagioclase, quartz, calcite = self.is_("plagioclase"), self.is_("quartz"), self.is_("calcite")
        tilt = np.where(plagioclase, self.between(0.12, 0.55), self.between(-0.8, 0.8))
        biotite = self.is_("biotite")
        tilt[biotite] *= 0.06  # vibrates along its cleavage
        age = self.fabric.growth.first - self.fabric.each(self.fabric.start)
        zones = np.sin(age * self.between(16, 44) + 2.0 * np.sin(5 * age)) * self.between(0, 1) - 2.2 * age**2
        tilt += np.where(plagioclase | self.is_("augite"), 0.07 * self.between(0.0, 1.4) * zones, 0)
        strain = self.own(own.strain, quartz | self.is_("microcline", "calcite", "plagioclase"))
        tilt += strain * np.where(quartz, 0.26, 0.05)
        tilt += 0.13 * self.own(own.subgrains, quartz & self.chance(0.5))
        tilt += 0.14 * self.own(own.speckle, biotite) + 0.05 * self.own(own.strain, biotite)
        wide = self.between(0.5, 1.9)
        twins = self.own(own.twins, plagioclase & self.chance(0.93), scale=wide)
        half = self.v > 0.2 * self.own(own.strain, plagioclase)  # a Carlsbad twin halves the crystal
        tilt = np.where(plagioclase & half & self.chance(0.4), np.float32(0.75) - tilt, tilt)
        crossing = self.own(own.spindles, plagioclase & self.chance(0.2), scale=0.6, turn=1.48)
        twins = np.maximum(twins, crossing * np.clip(2.5 * strain - 0.3, 0, 1))
        simple = self.is_("augite") & self.chance(0.25) & (self.v > 0)
        second = np.where(plagioclase, -tilt, tilt + 0.9)
        warp, weft = (self.own(own.spindles, self.is_("microcline") & self.chance(0.85), turn=a) for a in (0.1, 1.66))
        patches = np.clip(0.6 + strain, 0, 1)
        tilt += 0.30 * (warp + weft - 1) * patches * self.is_("microcline")
        thin = np.zeros(SHAPE, dtype=np.float32)
        for turn, share in ((0.35, 0.8), (1.6, 0.35), (2.5, 0.12)):
            lines = self.own(own.cleavage, calcite & self.chance(share), scale=self.between(0.5, 1.3), turn=turn)
            thin = np.maximum(thin, soft(lines - 0.35, 0.25))
        share = np.where(plagioclase, twins, np.where(calcite, thin, simple)).astype(np.float32)
        return along + tilt, along + second, share

    def _altered(self, gamma: np.ndarray) -> np.ndarray:
        """Flecks of mica in feldspar, stringers of another feldspar, fibres along cracks of olivine."""
        random, own = self.random, self.sheets
        feldspar = self.is_("plagioclase", "microcline")
        cloud = fractal(SHAPE, 70, 3, random) + self.between(-1.3, 0.35) + 0.2 * (self.edge > 14)
        flecks = soft(self.own(own.speckle, feldspar, scale=1.2) - 0.45, 0.5) * soft(cloud, 0.5)
        gamma = gamma + (120 + 130 * noise(SHAPE, 3, random)) * flecks
        stringers = self.own(own.stringers, self.is_("microcline") & self.chance(0.6))
        gamma *= 1 + 0.5 * stringers
        lamellae = self.own(own.stringers, self.is_("augite") & self.chance(0.35), scale=1.7)
        gamma *= 1 - 0.25 * lamellae
        gamma += 45 * self.is_("glass") * fractal(SHAPE, 5, 2, random).clip(0)  # crystallites
        self.cracks = self._cracks()
        serpentine = np.exp(-self.cracks / 3.5) * self.is_("olivine")
        fibres = 1 + 0.6 * self.own(own.speckle, self.is_("olivine"))
        return gamma + serpentine * (170 * fibres - gamma)

    def _cracks(self) -> np.ndarray:
        """Distance (µm) from the nearest crack; far where there are none."""
        cracked = self.is_("olivine", "augite", "quartz", "zircon")
        by = np.where(self.is_("olivine"), np.float32(1.15), np.float32(0.6))
        distance = np.float32(TEXEL_UM) * self.own(self.sheets.cracks, cracked, scale=by) / by
        return np.where(cracked, distance, np.float32(60)) + self.between(0, 0.5)

    def clear(self) -> np.ndarray:
        """What crystals, cleavages, cracks, boundaries and inclusions leave of the light."""
        random, own = self.random, self.sheets
        if self.params["polars"] == "plane":
            self.cracks = self._cracks()
        stage = np.radians(self.params["stage_deg"])
        clear = self.by_mineral(1)
        biotite, olivine = self.is_("biotite"), self.is_("olivine")
        brown = np.cos(self.fabric.each(self.fabric.along) + np.float32(stage)) ** 2  # darkest along the polariser
        clear *= np.where(biotite, 1 - 0.75 * brown * (1 + 0.12 * self.own(own.speckle, biotite)), 1)
        lines = np.zeros(SHAPE, dtype=np.float32)
        for turn, names, share in (
            (0.0, ("biotite",), 1.0),
            (0.52, ("augite",), 0.9),
            (2.07, ("augite",), 0.55),
            (0.9, ("calcite",), 0.75),
            (2.2, ("calcite",), 0.6),
            (0.0, ("plagioclase", "microcline"), 0.6),
        ):
            drawn = self.own(
                own.cleavage, self.is_(*names) & self.chance(share), scale=self.between(0.55, 1.1), turn=turn
            )
            lines = np.maximum(lines, drawn * self.between(0.4, 1.0))
        clear *= 1 - 0.85 * lines * self.by_mineral(3)
        width = 0.9 + 0.5 * noise(SHAPE, 25, random)
        dark = soft(width - self.cracks, 1.2) * (0.85 * olivine + 0.5 * self.is_("augite") + 0.12 * self.is_("quartz"))
        clear *= 1 - dark
        clear *= 1 - 0.35 * np.exp(-self.cracks / 4.0) * olivine * (1 + 0.6 * noise(SHAPE, 4, random))
        rim = np.exp(-self.edge / 5.0) * olivine  # altered from its edge, too
        clear *= 1 - 0.45 * rim * (0.7 + 0.6 * noise(SHAPE, 6, random))
        cloud = soft(fractal(SHAPE, 55, 4, random) + self.between(-0.9, 0.5), 0.9) * self.is_(
            "plagioclase", "microcline"
        )
        clear *= 1 - 0.3 * cloud * (1 + 0.8 * noise(SHAPE, 3.4, random))
        return clear * self._boundaries() * self._inclusions()

    def _boundaries(self) -> np.ndarray:
        """Dark lines where the relief differs, with a bright line inside the crystal of higher index."""
        relief = self.by_mineral(2)
        table = np.array([MINERALS[name].relief for name in NAMES], dtype=np.float32)
        step = relief - table[self.fabric.kind[self.fabric.growth.other]]
        strength = 0.14 + 0.6 * np.abs(step) + 0.2 * relief
        strength *= 1 + 0.5 * noise(SHAPE, 30, self.random)
        line = np.exp(-((self.edge / (0.9 + 0.12 * self.slant)) ** 2))
        bright = np.exp(-(((self.edge - 3.4) / 1.4) ** 2)) * np.clip(step, 0, 1)
        return np.clip(1 - strength * line + 0.16 * bright, 0, 1.2)

    def _inclusions(self) -> np.ndarray:
        """Trails of bubbles in quartz, dust in feldspar, haloes round zircons in biotite."""
        random = self.random
        n = 70
        rows, columns, which = strokes(
            random.uniform(0, 1, (n, 2)) * SHAPE, random.uniform(0, np.pi, n), random.uniform(60, 260, n)
        )
        kept = random.random(rows.size) < random.uniform(0.05, 0.28, n)[which]
        rows, columns = (a[kept] + random.normal(0, 2.2, kept.sum()) for a in (rows, columns))
        dots = splat(SHAPE, rows, columns, random.uniform(0.5, 2.2, rows.size), blur=0.65) * self.is_(
            "quartz", "calcite"
        )
        rows, columns = (random.uniform(0, m - 1, 9000) for m in SHAPE)
        weight = random.exponential(0.7, 9000)
        dust = splat(SHAPE, rows, columns, weight, blur=0.7) * self.is_("plagioclase", "microcline", "augite", "glass")
        dust *= (0.5 + fractal(SHAPE, 60, 2, random) + self.between(-0.6, 0.6)).clip(0, 1.4)
        clear = 1 - np.clip(0.55 * dots, 0, 0.85)
        clear *= 1 - np.clip(0.45 * dust, 0, 0.7)
        zircon = gaussian_filter(self.is_("zircon").astype(np.float32), 6)
        return clear * (1 - np.clip(9 * zircon, 0, 0.55) * self.is_("biotite"))


def _polish(random: np.random.Generator) -> np.ndarray:
    """Scratches, nearly parallel in bundles, and pits; the share of light that they take."""
    n = 240
    bundle = random.uniform(0, np.pi, 5)
    angle = bundle[random.integers(0, 5, n)] + random.normal(0, 0.05, n)
    rows, columns, which = strokes(
        random.uniform(0, 1, (n, 2)) * SHAPE,
        angle,
        np.exp(random.normal(4.9, 0.8, n)).clip(20, 1500),
        bend=random.normal(0, 0.0005, n),
    )
    depth = random.exponential(0.1, n)[which] * random.uniform(0.5, 1, rows.size)
    lines = splat(SHAPE, rows, columns, depth, blur=0.7)
    rows, columns = (random.uniform(0, m - 1, 700) for m in SHAPE)
    pits = splat(SHAPE, rows, columns, random.exponential(1.6, 700), blur=1.1)
    return np.clip(lines + 0.5 * pits, 0, 0.8)


def _below(clear: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """What lies under the section: shadows of sloping boundaries, dust, bubbles in the cement."""
    beside = np.roll(clear, tuple(random.integers(-5, 6, 2)), (0, 1))
    lower = 0.97 * (1 - 0.35 * (1 - gaussian_filter(beside, 2.0)))
    rows, columns = (random.uniform(0, m - 1, 260) for m in SHAPE)
    lower *= 1 - np.clip(splat(SHAPE, rows, columns, random.exponential(9, 260), blur=2.2), 0, 0.7)
    n = 9
    starts = random.uniform(0, 1, (n, 2)) * SHAPE
    r, c, which = strokes(
        starts, random.uniform(0, np.pi, n), random.uniform(30, 160, n), bend=random.normal(0, 0.01, n)
    )
    lower *= 1 - np.clip(splat(SHAPE, r, c, random.uniform(0.1, 0.5, n)[which], blur=1.3), 0, 0.6)
    row, column = np.ogrid[: SHAPE[0], : SHAPE[1]]
    for _ in range(random.integers(2, 9)):
        at, radius = random.uniform(0, 1, 2) * SHAPE, np.exp(random.normal(2.4, 0.55)).clip(5, 40)
        flat = random.uniform(0.9, 1.1)
        away = np.hypot((row - at[0]) * flat, (column - at[1]) / flat).astype(np.float32) / np.float32(radius)
        rim = soft(1.03 - away, 0.08) * soft(away - 0.62, 0.42)
        lower *= 1 - 0.8 * rim
    return lower
