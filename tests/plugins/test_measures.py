"""Focus measures: guarantees of all of them, names and forms; those of the paper against references of scipy.

The formulas of the literature are tested in test_measure_forms.py, measures of two halves in
test_half_window_measures.py.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from refusals import assert_says, refusal
from scipy.ndimage import gaussian_filter, sobel
from scipy.signal import convolve2d

from saf_gen import get_measure
from saf_gen.core.config import registry
from saf_gen.core.seeds import make_generator
from saf_gen.parts import cite_source, wants_halves, wants_intervals
from saf_gen.plugins.measures import BrightnessNormalised, IntervalTexture, measure_names

SHAPES = [(64, 64), (37, 51), (4, 4), (3, 5), (1, 1)]
OF_IMAGES = [name for name in measure_names() if not wants_halves(get_measure(name))]
PROMISE = "never rises when a periodic scene is blurred"
PROMISING = [name for name in OF_IMAGES if PROMISE in " ".join(get_measure(name).__doc__.split())]
KERNEL = np.outer([1, 1, -1, -1], [1, 1, -1, -1])


def counts_of(shape, *, highest=60):
    return make_generator("test_measures", *shape).integers(0, highest, shape, dtype=np.uint32)


@pytest.mark.parametrize("shape", SHAPES)
def test_sd_is_variance_over_squared_mean_and_sd_code_is_n_times_that(shape):
    c = counts_of(shape).astype(float)
    expected = c.var() / c.mean() ** 2
    assert get_measure("sd")(c) == pytest.approx(expected, rel=1e-12)
    assert get_measure("sd")(c.astype(np.uint32)) == pytest.approx(expected, rel=1e-12)
    assert get_measure("sd_code")(c.astype(np.uint32)) == pytest.approx(c.size * expected, rel=1e-12)


def test_event_rates_are_the_sums_of_counts_and_of_their_squares():
    c = np.array([[1, 2, 3], [4, 5, 6]], dtype=np.uint8)
    assert get_measure("er_count")(c) == 21.0
    assert get_measure("er_sumsq")(c) == 91.0


def test_sums_beyond_int64_are_still_right():
    c = np.full((20, 30), 2**32 - 1, dtype=np.uint32)
    assert get_measure("er_sumsq")(c) == pytest.approx(600 * (2**32 - 1) ** 2, rel=1e-12)
    assert get_measure("sd")(c) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_gradient_is_the_sum_of_sobel_magnitudes_with_replicated_borders(shape):
    c = counts_of(shape).astype(float)
    expected = np.hypot(sobel(c, axis=0, mode="nearest"), sobel(c, axis=1, mode="nearest")).sum()
    assert get_measure("gradient_code")(c.astype(np.uint16)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_mfdct_code_convolves_each_complete_tile_separately_and_in_full(shape):
    c = counts_of(shape).astype(np.int64)
    tiles = [c[y : y + 4, x : x + 4] for y in range(0, shape[0] // 4 * 4, 4) for x in range(0, shape[1] // 4 * 4, 4)]
    expected = sum(int((convolve2d(tile, KERNEL, mode="full") ** 2).sum()) for tile in tiles)
    assert get_measure("mfdct_code")(c) == expected


@pytest.mark.parametrize("shape", SHAPES)
def test_mfdct_lee_convolves_the_image_where_the_kernel_fits(shape):
    c = counts_of(shape).astype(np.int64)
    fits = min(shape) >= 4
    expected = ((sliding_window_view(c, (4, 4)) * KERNEL).sum(axis=(2, 3)) ** 2).sum() if fits else 0
    assert get_measure("mfdct_lee")(c) == expected


def scene():
    """A periodic, sharp image: patches of seven pixels with random counts."""
    patches = make_generator("test_measures", "scene").integers(5, 60, (14, 16))
    return np.kron(patches, np.ones((7, 7)))


@pytest.mark.parametrize("name", PROMISING)
def test_a_measure_that_promises_it_falls_with_every_further_blur(name):
    measure = get_measure(name)
    blurs = [0, 0.4, 0.7, 1, 1.5, 2, 3, 4, 6, 9, 14]
    scores = [measure(gaussian_filter(scene(), blur, mode="wrap") if blur else scene()) for blur in blurs]
    assert all(sharper > softer for sharper, softer in pairwise(scores)), scores


def test_every_measure_that_grows_with_brightness_is_listed_normalised_too_and_no_other():
    names = measure_names()
    for name in [n for n in names if not n.endswith("_n")]:
        assert (f"{name}_n" in names) == (get_measure(name).degree > 0)
    assert not [name for name in registry.names("measures") if name.endswith("_n")]  # none has a file


@dataclass(frozen=True)
class Power:
    """The mean count to a power that is an option, so that its degree is no class attribute."""

    power: int = 2

    @property
    def degree(self):
        return self.power

    def __call__(self, counts):
        return float(counts.mean()) ** self.power


def test_a_measure_whose_degree_is_an_option_is_listed_by_its_default(register):
    register("measures", "power", Power)
    assert {"power", "power_n"} <= set(measure_names())
    assert get_measure("power_n", power=3)(counts_of((20, 30))) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("name", [n for n in measure_names() if n.endswith("_n")])
def test_a_normalised_measure_is_its_measure_over_the_mean_to_its_degree(name):
    measure, normalised, c = get_measure(name.removesuffix("_n")), get_measure(name), counts_of((40, 60))
    assert isinstance(normalised, BrightnessNormalised)
    assert normalised.degree == 0
    assert normalised(c) == pytest.approx(measure(c) / c.mean(dtype=float) ** measure.degree, rel=1e-12)
    assert cite_source(measure) in cite_source(normalised)
    if name in ("variance_n", "normalised_variance_n"):
        assert normalised(c) == pytest.approx(get_measure("sd")(c), rel=1e-12)


def test_the_normalised_event_count_is_exactly_the_number_of_pixels():
    for highest in range(2, 40):
        assert get_measure("er_count_n")(counts_of((25, 40), highest=highest)) == 1000.0


def test_any_measure_of_a_full_window_has_a_form_for_textures():
    c = counts_of((40, 60)) / 7
    for name in ("sd", "tenengrad", "tenengrad_n", "entropy"):
        inner, measure = get_measure(name), get_measure(f"{name}_tfi")
        assert isinstance(measure, IntervalTexture)
        assert (measure(c), measure.degree, measure.score_range) == (inner(c), inner.degree, inner.score_range)
        assert wants_intervals(measure)
        assert not wants_intervals(inner)
        assert cite_source(measure).startswith(cite_source(inner))
        assert "doi:10.1109/ICME.2019.00248" in cite_source(measure)
    assert get_measure("cen_tfi", highest=0.2) == IntervalTexture(get_measure("cen", highest=0.2))
    assert not [name for name in measure_names() if name.endswith("_tfi")]


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("sd_n", {}, "does not grow with brightness | mean 'sd'"),
        ("sd_debiased_tfi", {}, "it compares halves | mean 'sd_debiased'"),
        ("sd_tfi_tfi", {}, "it takes intervals already | mean 'sd_tfi'"),
        ("mfdct_le", {}, "unknown focus measure 'mfdct_le' | mean 'mfdct_lee'"),
        ("gradient_cod_n", {}, "unknown focus measure 'gradient_cod | mean 'gradient_code_n'"),
        ("tenengrat_tfi", {}, "unknown focus measure 'tenengrat' | mean 'tenengrad'"),
        ("tenengrad_tfi_n", {}, "unknown focus measure 'tenengrad_tfi_n' | mean 'tenengrad_n'"),
        ("sd", {"window": 3}, "'window'"),
        ("modified_laplacian", {"step": 0}, "step is 0 | 1 or more"),
        ("gaussian_derivative", {"sigma_px": "fine"}, "sigma_px is 'fine' | pixels"),
        ("gaussian_derivative", {"sigma_px": 0.1}, "sigma_px is 0.1 | 0.3 to 30 pixels"),
        ("dct_energy_ratio", {"highest_order": 15}, "highest_order is 15 | 1 to 14"),
        ("wavelet_ratio", {"levels": 0}, "levels is 0 | 1 to 8"),
        ("cen", {"highest": 1.0}, "highest 1.0 | highest <= 0.75"),
        ("cen", {"highest": True}, "highest is True | cycles per pixel"),
        ("mid_band_power", {"lowest": 0.3}, "lowest is 0.3, highest 0.25 | lowest < highest"),
        ("structure_calibrated", {"longest": 0}, "longest is 0 | 1 to 64"),
        ("structure_calibrated", {"dark": 0.6}, "dark is 0.6 | 0 to 0.5"),
        ("sd_calibrated", {"dark": True}, "dark is True | 0 to 0.5"),
        ("sd_calibrated", {"dark_rms": math.nan}, "dark_rms is nan | 0 to 10"),
        ("change_rate", {"contrast": 0}, "contrast is 0 | above 0, at most 10"),
    ],
)
def test_a_name_or_an_option_that_makes_no_sense_is_refused(name, options, words):
    assert_says(refusal(get_measure, name, **options), words)


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        (np.zeros(5), "(5,) | (rows, columns)"),
        (np.zeros((0, 3)), "(0, 3) | at least one pixel"),
        (np.array([["a"]]), "<U1 | numbers"),
        (np.array([[np.nan]]), "not finite | finite numbers"),
    ],
)
def test_what_is_no_image_of_counts_is_refused(counts, words):
    assert_says(refusal(get_measure("gradient_code_n"), counts), words)
