"""Refractive index of the media in a lens: catalogue glasses, glasses known by index and Abbe number, and air.

All indices are relative to air, as catalogues and lens files state them.

References
----------
W. Sellmeier, Ann. Phys. 219, 272 (1871), doi:10.1002/andp.18712190612, for the formula of most catalogues.
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput, closest

D_UM, F_UM, C_UM = 0.5875618, 0.4861327, 0.6562725  # the lines of helium and hydrogen that define Abbe's number
CATALOGUE = Path(__file__).parent / "glasses.csv"
USUAL_INDEX, USUAL_ABBE = (1.2, 2.6), (10.0, 120.0)


@dataclass(frozen=True)
class Glass:
    """A medium and the law of its refractive index.

    Attributes
    ----------
    name : str
        Name, as the file gives it.
    law : {'constant', 'cauchy', 'sellmeier', 'polynomial'}
        n; A + B/λ²; n² = 1 + Σ b·λ²/(λ² - c); or Schott's older n² = a0 + a1·λ² + a2/λ² + a3/λ⁴ + ... (λ in µm).
    numbers : tuple of float
        Coefficients of the law: n; A, B; b and c in turn; a0, a1, a2, ...
    range_um : tuple of float
        Shortest and longest wavelength for which the law holds, µm.
    """

    name: str
    law: str
    numbers: tuple[float, ...]
    range_um: tuple[float, float] = (0.2, 3.0)

    def index(self, wavelength_um: float) -> float:
        """Return the refractive index; raise BadInput outside the range of the law."""
        low, high = self.range_um
        if not low <= wavelength_um <= high:
            raise BadInput(
                f"the index of {self.name} is not known at {1e3 * wavelength_um:g} nm",
                allowed=f"{1e3 * low:g} to {1e3 * high:g} nm",
            )
        square = wavelength_um**2
        if self.law == "constant":
            return self.numbers[0]
        if self.law == "cauchy":
            return self.numbers[0] + self.numbers[1] / square
        if self.law == "sellmeier":
            squared = 1 + sum(
                b * square / (square - c) for b, c in zip(self.numbers[::2], self.numbers[1::2], strict=True)
            )
        else:
            a0, a1, *others = self.numbers
            squared = a0 + a1 * square + sum(a / square ** (n + 1) for n, a in enumerate(others))
        if not squared > 1:
            raise BadInput(f"the formula of {self.name} gives no index at {1e3 * wavelength_um:g} nm")
        return float(np.sqrt(squared))


AIR = Glass("air", "constant", (1.0,))


def model_glass(index: float, abbe: float, *, name: str = "") -> Glass:
    """Return a glass known by its index n at 587.6 nm and Abbe's number V = (n - 1)/(n_F - n_C), with n = A + B/λ²."""
    name = name or f"{index:g}/{abbe:g}"
    for value, (low, high), what in ((index, USUAL_INDEX, "index"), (abbe, USUAL_ABBE, "Abbe number")):
        if not low <= value <= high:
            raise BadInput(f"glass {name}: the {what} is {value:g}", allowed=f"{low:g} to {high:g}")
    b = (index - 1) / abbe / (F_UM**-2 - C_UM**-2)
    return Glass(name, "cauchy", (index - b / D_UM**2, b))


@cache
def catalogue() -> dict[str, Glass]:
    """Return the glasses of the shipped catalogue, by their names in capitals."""
    lines = [line for line in CATALOGUE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    found = {}
    for row in csv.DictReader(lines):
        numbers = tuple(float(row[f"{letter}{n}"]) for n in (1, 2, 3) for letter in "bc")
        found[row["glass"]] = Glass(row["glass"], "sellmeier", numbers, (float(row["from_um"]), float(row["to_um"])))
    return found


def find_glass(name: str, more: Mapping[str, Glass], *, where: str) -> Glass:
    """Return the glass of this name, of ``more`` (by names in capitals) or of the catalogue.

    Raises
    ------
    BadInput
        If the name is unknown, with the nearest name and how to state the glass.
    """
    key = name.strip().upper()
    for table in (more, catalogue()):
        if key in table:
            return table[key]
    raise BadInput(
        f"{where} is of the unknown glass {name!r}",
        allowed=f"one of {len(catalogue())} glasses of Schott and Ohara",
        nearest=closest(key, [*more, *catalogue()]),
        hint=f"state it, --glass {name}=INDEX/ABBE, or give its maker's catalogue, --catalogue FILE.agf",
    )


def read_agf(text: str, *, where: str) -> dict[str, Glass]:
    """Return the glasses of a catalogue in Zemax's format (AGF), by their names in capitals.

    Glasses whose formula is another than Schott's (1), Sellmeier's with three (2) or four terms (6) are left out.
    """
    found: dict[str, Glass] = {}
    name, formula, numbers = "", 0, tuple[float, ...]()
    for line in text.splitlines():
        words = line.split()
        try:
            if words[:1] == ["NM"]:
                name, formula, numbers = words[1].upper(), int(float(words[2])), ()
            elif words[:1] == ["CD"] and name:
                numbers = tuple(float(word) for word in words[1:])
            elif words[:1] == ["LD"] and name and numbers:
                law = {1: "polynomial", 2: "sellmeier", 6: "sellmeier"}.get(formula)
                size = {1: 6, 2: 6, 6: 8}.get(formula, 0)
                if law and len(numbers) >= size:
                    found[name] = Glass(name, law, numbers[:size], (float(words[1]), float(words[2])))
        except (ValueError, IndexError):
            raise BadInput(f"{where} is damaged: {line.strip()[:60]!r}", allowed="a glass catalogue (.agf)") from None
    if not found:
        raise BadInput(f"{where} has no glasses", allowed="a glass catalogue (.agf) with lines NM, CD and LD")
    return found
