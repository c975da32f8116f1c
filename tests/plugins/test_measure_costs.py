"""The cost that each measure states, against its code run on numbers that count operations."""

import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from saf_gen import get_measure
from saf_gen.core.config import registry
from saf_gen.core.seeds import make_generator
from saf_gen.parts import wants_halves
from saf_gen.plugins.measures import _filters, _spectrum, fine_structure, gradient_code, measure_names

OWN = sorted(registry._builtin_names("measures"))
BEYOND = {"cen", "mid_band_power", "entropy", "change_rate"}
"""Measures whose operations these numbers do not count: Fourier transforms (computed below), a table of levels (one
addition per pixel), and a product of an integer and a fraction."""


class Tally:
    """The number of additions, subtractions, multiplications and roots so far."""

    done = 0


numbers = {}
"""int and float, each with its counting subclass."""


def counting(kind):
    """A subclass of int or float whose sums and products are counted, and are counting numbers again."""

    def counted(name):
        operation = getattr(kind, name)

        def method(self, other):
            plain = operation(self, kind(other) if isinstance(other, np.generic) else other)
            if plain is NotImplemented:
                return plain
            Tally.done += 1
            return numbers[type(plain)](plain)

        return method

    def free(name):  # a quotient is computed once per window or tile
        return lambda self, *other: numbers[float](getattr(float, name)(float(self), *map(float, other)))

    members = {name: counted(name) for name in ("__add__", "__radd__", "__sub__", "__rsub__", "__mul__", "__rmul__")}
    members |= {name: free(name) for name in ("__truediv__", "__rtruediv__")}
    members["__abs__"] = lambda self: type(self)(kind.__abs__(self))
    members["item"] = lambda self: self
    return type(f"Counting{kind.__name__}", (kind,), members)


numbers |= {kind: counting(kind) for kind in (int, float)}


class Kept(np.ndarray):
    """An array of counting numbers that a measure cannot convert to plain numbers."""

    def astype(self, *_, **__):
        return self


def counts_of(shape, kind):
    """Counts below 60 as counting numbers, in any shape."""
    values = make_generator("test_measure_costs").integers(1, 60, shape)
    out = np.empty(shape, dtype=object)
    out.flat = [numbers[kind](kind(v)) for v in values.flat]
    return out.view(Kept)


def correlated(image, down, across, stride, of=_filters.correlate_separable.py_func):
    return of(image, down.astype(object), across.astype(object), stride)  # numpy's floats would bypass ours


def root(value):
    Tally.done += 1
    return numbers[float](math.sqrt(value))


@pytest.fixture
def bare(monkeypatch):
    """Let the measures accept arrays unchanged, and run their kernels as plain Python."""
    for name, module in list(sys.modules.items()):
        if name.startswith("saf_gen.plugins.measures."):
            for checked in ("as_integers", "as_floats"):
                if hasattr(module, checked):
                    monkeypatch.setattr(module, checked, lambda counts, halves=False: counts)
            if hasattr(module, "correlate_separable"):
                monkeypatch.setattr(module, "correlate_separable", correlated)

    def zeros(shape):
        return np.full(shape, numbers[float](0.0), dtype=object)

    monkeypatch.setattr(_filters, "np", SimpleNamespace(zeros=zeros, empty=zeros))
    for module, kernel in ((fine_structure, "block_structure"), (gradient_code, "_magnitudes")):
        monkeypatch.setattr(module, kernel, getattr(module, kernel).py_func)
    monkeypatch.setattr(gradient_code, "math", SimpleNamespace(sqrt=root))


def operations(measure, shape, kind):
    Tally.done = 0
    measure(counts_of((2, *shape) if wants_halves(measure) else shape, kind))
    return Tally.done


def per_pixel(measure, kind=int):
    """Operations per pixel from four sizes, without those at borders and those done once per window."""
    rows, cols = 24, 32
    sizes = {(i, j): operations(measure, (i * rows, j * cols), kind) for i in (1, 2) for j in (1, 2)}
    return (sizes[2, 2] - sizes[1, 2] - sizes[2, 1] + sizes[1, 1]) / (rows * cols)


KERNELS = {"gradient_code", "gaussian_derivative", "wavelet_ratio", "dct_energy_ratio"}
"""Measures that compute in floating point; the others compute exactly in integers."""
OPTIONS = [
    *((name, {}) for name in OWN if name not in BEYOND),
    ("gaussian_derivative", {"sigma_px": 0.5}),
    ("dct_energy_ratio", {"highest_order": 2}),
    ("wavelet_ratio", {"levels": 2}),
]


@pytest.mark.parametrize(("name", "options"), OPTIONS, ids=lambda value: value if value else "")
def test_a_measure_costs_what_it_states(bare, name, options):
    """Exact, except for tiles: in each of them a sum of n numbers has n - 1 additions."""
    measure = get_measure(name, **options)
    found = per_pixel(measure, float if name in KERNELS else int)
    assert found == pytest.approx(measure.cost, rel=0.02 if name == "dct_energy_ratio" else 1e-12)


@pytest.mark.parametrize(("name", "each"), [("cen", 7), ("mid_band_power", 5)])
def test_a_spectrum_costs_its_transform_the_mean_and_what_is_done_with_the_frequencies_kept(name, each):
    """A real transform of N numbers takes 2.5 N log2 N operations.

    In addition the mean is computed and subtracted, and each frequency kept has its power (3), a weight and sums.
    """
    measure, shape = get_measure(name), (250, 400)
    weight, _ = _spectrum._band(shape, getattr(measure, "lowest", 0.0), highest=measure.highest)
    worked_out = 2.5 * math.log2(250 * 400) + 2 + each * weight.size / (250 * 400)
    assert measure.cost == pytest.approx(worked_out, abs=0.3)


@pytest.mark.parametrize("name", [name for name in measure_names() if name.endswith("_n")])
def test_a_normalised_measure_costs_the_sum_of_the_counts_more(bare, monkeypatch, name):
    monkeypatch.setattr("saf_gen.plugins.measures.as_integers", lambda counts, halves=False: counts)
    measure, normalised = get_measure(name.removesuffix("_n")), get_measure(name)
    assert normalised.cost == measure.cost + 1
    if name.removesuffix("_n") not in BEYOND | KERNELS:
        assert per_pixel(normalised) == normalised.cost


def test_a_texture_costs_what_its_measure_does():
    assert get_measure("gaussian_derivative_tfi", sigma_px=2.0).cost == 8 * 13 + 4
    assert get_measure("tenengrad_n_tfi").cost == get_measure("tenengrad_n").cost
