"""Products of light schedules, against closed forms, and what a recipe may multiply."""

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy.integrate import quad
from small_dataset import SMALL_RECIPE
from test_lights import EXAMPLES, RECTIFIED, light_of, table

from saf_gen.camera.course import LightCourse
from saf_gen.core.config import registry
from saf_gen.generate.draw import SceneFamily, draw_sequences
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.parts import LightFactor
from saf_gen.plugins.lights import build_light, gains_at_readouts, group_gains, list_lamps, states_spectrum

TIMES = np.linspace(0, 1, 401)
RAMP = {"kind": "ramp", "from": 0.5, "to": 2.0}
ONE = {"kind": "constant", "level": 1.0}


def component(name, **changes):
    return {"kind": name, **EXAMPLES[name], **changes}


def product(*factors, **common):
    return build_light({"product": list(factors), **common})


# --- what a factor says ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", registry.names("lights"))
def test_a_gain_is_the_slope_of_the_integral_and_smooth_between_breaks(name):
    """Ten nodes between two breaks give the integral to the last digits, which they cannot across a jump or a bend."""
    light = light_of(name)
    assert isinstance(light, LightFactor)
    breaks = light.breaks(1.0)
    edges = np.unique(np.concatenate(([0.0, 1.0], breaks[(breaks > 0) & (breaks < 1)])))
    nodes, weights = np.polynomial.legendre.leggauss(10)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    pieces = half * (light.gain(middle[:, None] + half[:, None] * nodes, 1.0) @ weights)
    assert pieces == pytest.approx(np.diff(light.integral(edges, 1.0)), rel=1e-11, abs=1e-14)


@pytest.mark.parametrize(
    "factor",
    [
        component("flicker", hz=100.0, harmonics=RECTIFIED),
        component("flicker", hz=20_000.0, phase=0.0),
        component("flash", rise_s=1e-7, decay_s=1e-7),
        component("flash", rise_s=1e-7, decay_s=0.3),
        component("flash", rise_s=0.4, decay_s=0.02),
        component("pwm", hz=3000.0, duty=0.01),
        component("pwm", hz=0.4, duty=0.9, phase=-400.0),
        component("pwm", duty=0.0),
        component("pwm", duty=1.0),
        component("sine", hz=0.01),
        component("steps", every_s=1e-4),
        component("ramp", over_s=0.3),
        component("from_csv", file=table((-1, 0.0), (0.5, 4.0), (3, 1.0))),
        component("random_walk", return_s=None),
    ],
    ids=str,
)
def test_a_factor_beside_light_that_stands_still_is_integrated_to_a_billionth(factor):
    """A sine without swing is 1, but is no constant to the code: it goes the way of every product."""
    still = {"kind": "sine", "hz": 1.0, "swing": 0.0}
    expected = build_light(factor).integral(TIMES, 1.0)
    assert product(factor, still).integral(TIMES, 1.0) == pytest.approx(expected, rel=1e-10, abs=1e-15)


# --- products ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_constant_light_of_gain_1_changes_no_bit_of_a_product(name):
    expected = light_of(name).integral(TIMES, 1.0)
    for factors in ([component(name), ONE], [ONE, component(name), ONE]):
        assert np.array_equal(product(*factors).integral(TIMES, 1.0), expected)
    assert product(component(name), component("constant", level=3.0)).integral(TIMES, 1.0) == pytest.approx(
        3 * expected, rel=1e-15
    )


def test_two_constants_multiply():
    light = product(component("constant", level=0.5), component("constant", level=3.0))
    assert light.integral(TIMES, 1.0) == pytest.approx(1.5 * TIMES, rel=1e-15)
    assert (gains_at_readouts(light, 100, readout_hz=20_000) == 1.5).all()


def test_the_square_of_a_ramp_is_a_parabola():
    """∫(a + bt)² = ((a + bt)³ − a³)/3b."""
    a, b = 0.5, 1.5
    assert product(RAMP, RAMP).integral(TIMES, 1.0) == pytest.approx(
        ((a + b * TIMES) ** 3 - a**3) / (3 * b), rel=1e-13, abs=1e-16
    )


def test_a_ramp_times_a_sine_has_its_closed_form():
    """∫(a + bt) sin(ωt + φ) = −(a + bt) cos(ωt + φ)/ω + b sin(ωt + φ)/ω²."""
    a, b, omega, phase = 0.5, 1.5, 2 * np.pi * 3.0, 1.0

    def wave(t):
        return -(a + b * t) * np.cos(omega * t + phase) / omega + b * np.sin(omega * t + phase) / omega**2

    expected = a * TIMES + 0.5 * b * TIMES**2 + 0.4 * (wave(TIMES) - wave(0.0))
    light = product(RAMP, component("sine"))
    assert light.integral(TIMES, 1.0) == pytest.approx(expected, rel=1e-12, abs=1e-16)
    by_quad, _ = quad(lambda t: (a + b * t) * (1 + 0.4 * np.sin(omega * t + phase)), 0, 0.37, epsrel=1e-13)
    assert float(light.integral(np.array(0.37), 1.0)) == pytest.approx(by_quad, rel=1e-12)


def test_two_sines_beat():
    """cos A cos B = (cos(A − B) + cos(A + B))/2: the mean over whole periods is higher if both swing together."""
    flicker = {"kind": "flicker", "hz": 100.0, "depth": 0.6}
    together = product(flicker, flicker).integral(np.array(1.0), 1.0)
    apart = product(flicker, {**flicker, "hz": 120.0}).integral(np.array(1.0), 1.0)
    against = product(flicker, {**flicker, "phase": np.pi}).integral(np.array(1.0), 1.0)
    assert [float(one) for one in (together, apart, against)] == pytest.approx([1.18, 1, 0.82], rel=1e-12)


@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_many_swings_have_the_mean_of_a_binomial_coefficient(count):
    """The mean of (1 + cos)ⁿ is (2n over n)/2ⁿ."""
    light = product(*[{"kind": "flicker", "hz": 100.0, "depth": 1.0}] * count)
    assert float(light.integral(np.array(1.0), 1.0)) == pytest.approx(comb(2 * count, count) / 2**count, rel=1e-12)


def test_jumps_within_a_readout_count_in_proportion():
    """Levels 1 and 3 change at 0.1 s; a lamp that is on for a quarter of 0.16 s meets both at 10 readouts a second."""
    light = product(
        {"kind": "steps", "every_s": 0.1, "levels": [1.0, 3.0]}, {"kind": "pwm", "hz": 6.25, "duty": 0.25, "low": 0.0}
    )
    # On in 0…0.04, 0.16…0.2, 0.32…0.36 and 0.48…0.52 s.
    expected = [0.4 * 1, 0.4 * 3, 0, 0.4 * 3, 0.2 * 1, 0.2 * 3]
    assert gains_at_readouts(light, 6, readout_hz=10.0) == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize("pair", list(combinations(sorted(EXAMPLES), 2)), ids="×".join)
def test_a_product_is_that_of_the_means_over_short_times(pair):
    """Over 2 µs the mean of a product is the product of the means, but where both jump; no gains or breaks are used."""
    grid = np.linspace(0, 1, 500_001)
    means = [np.diff(light_of(name).integral(grid, 1.0)) / np.diff(grid) for name in pair]
    expected = np.concatenate(([0.0], np.cumsum(means[0] * means[1] * np.diff(grid))))[::1250]
    found = product(*map(component, pair)).integral(grid[::1250], 1.0)
    assert found == pytest.approx(expected, rel=1e-6, abs=2e-6)


@pytest.mark.parametrize("readout_hz", [100.0, 2_000.0, 20_000.0, 1e6])
def test_readouts_slower_and_faster_than_the_flicker_have_exact_means(readout_hz):
    """A ramp of 100 Hz mains light at any rate of readouts: at 100 a second the swing cancels but for the slope."""
    frames = 200
    length, omega = frames / readout_hz, 2 * np.pi * 100.0
    a, b = 0.5, 1.5 / length
    edges = np.arange(frames + 1) / readout_hz
    wave = (a + b * edges) * np.sin(omega * edges) / omega + b * np.cos(omega * edges) / omega**2
    expected = np.diff(a * edges + 0.5 * b * edges**2 + 0.6 * wave) * readout_hz
    light = product(RAMP, {"kind": "flicker", "hz": 100.0, "depth": 0.6})
    assert gains_at_readouts(light, frames, readout_hz=readout_hz) == pytest.approx(expected, abs=1e-6)


def test_a_product_is_the_same_whatever_times_are_asked_for_and_starts_like_a_shorter_one():
    factors = [component("flicker"), component("random_walk"), component("pwm")]
    light = product(*factors)
    expected = light.integral(TIMES, 1.0)
    assert np.array_equal(light.integral(TIMES[::-1], 1.0), expected[::-1])
    assert np.array_equal(light.integral(TIMES[20:21], 1.0), expected[20:21])
    assert np.array_equal(light.integral(TIMES.reshape(-1, 1), 1.0), expected[:, None])
    assert np.array_equal(product(*factors).integral(TIMES, 1.0), expected)
    assert light.integral(TIMES, 3.0) == pytest.approx(expected, rel=1e-13, abs=1e-16)


def test_factors_may_be_written_in_any_order():
    factors = [component(name) for name in ("flicker", "steps", "ramp", "constant", "flash")]
    expected = product(*factors).integral(TIMES, 1.0)
    assert product(*factors[::-1]).integral(TIMES, 1.0) == pytest.approx(expected, rel=1e-13, abs=1e-16)


def test_offset_and_lux_belong_to_the_product():
    alone = product(RAMP, component("flicker")).integral(TIMES, 1.0)
    light = product(RAMP, component("flicker"), offset=2.0, unit="lux", lux_at_gain_1=400.0)
    assert light.integral(TIMES, 1.0) == pytest.approx((alone + 2.0 * TIMES) / 400, rel=1e-12)


def test_the_course_of_a_product_follows_it_between_its_jumps():
    """What an event camera sees: in each cell the gain is a straight line, to a hundred-thousandth."""
    factors = {"kind": "steps", "every_s": 0.013, "levels": [1.0, 0.3]}, {"kind": "flicker", "hz": 100.0, "depth": 0.5}
    light = product(*factors)
    course = LightCourse.follow(
        lambda at: at / 0.05, [lambda at: light.integral(at, 0.05)], span_s=(0.0, 0.05), knots=9
    )
    middle = 0.5 * (course.seconds[1:] + course.seconds[:-1])
    expected = np.where(middle // 0.013 % 2 == 0, 1.0, 0.3) * (1 + 0.5 * np.cos(2 * np.pi * 100 * middle))
    wide = np.diff(course.seconds) > 1e-6  # in the shortest cell there is a jump
    assert course.gain.mean(axis=1)[wide, 0] == pytest.approx(expected[wide], rel=1e-4)


# --- factors of users ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Decay:
    after_s: float

    def integral(self, seconds, duration_s):
        return self.after_s * -np.expm1(-np.asarray(seconds) / self.after_s)


@dataclass(frozen=True)
class DecayFactor(Decay):
    def gain(self, seconds, duration_s):
        return np.exp(-np.asarray(seconds) / self.after_s)

    def breaks(self, duration_s):
        return np.arange(0, duration_s, 4 * self.after_s)


class Falling(DecayFactor):
    def gain(self, seconds, duration_s):
        return -super().gain(seconds, duration_s)


class OneNumber(DecayFactor):
    def gain(self, seconds, duration_s):
        return 1.0


class BreaksAtNan(DecayFactor):
    def breaks(self, duration_s):
        return [0.1, np.nan]


class Raises(DecayFactor):
    def breaks(self, duration_s):
        raise ZeroDivisionError("by zero")


@pytest.fixture
def added(register):
    for plugin in (Decay, DecayFactor, Falling, OneNumber, BreaksAtNan, Raises):
        register("lights", plugin.__name__, plugin)


@pytest.mark.usefixtures("added")
def test_a_light_of_users_with_gain_and_breaks_is_a_factor():
    light = product({"kind": "DecayFactor", "after_s": 0.1}, {"kind": "DecayFactor", "after_s": 0.1})
    assert light.integral(TIMES, 1.0) == pytest.approx(-0.05 * np.expm1(-TIMES / 0.05), rel=1e-11, abs=1e-16)


@pytest.mark.usefixtures("added")
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("Decay", "Decay(after_s=0.1) cannot be a factor | gain and breaks | docs/add-a-method.md"),
        ("Falling", "the gain of | falls to -0.949 | 0 or more"),
        ("OneNumber", "returns an array of shape () | one number per time"),
        ("BreaksAtNan", "the breaks of | nan | a list of times in seconds"),
        ("Raises", "ZeroDivisionError: by zero"),
    ],
)
def test_a_light_of_users_that_cannot_be_a_factor_is_refused_in_one_line(kind, message):
    def gains():
        part = {"kind": kind, "after_s": 0.1}
        return gains_at_readouts(product(part, part), 100, readout_hz=100.0)

    assert_says(refusal(gains), message)


# --- in recipes ----------------------------------------------------------------------------------------

R, F = "{kind: ramp, from: 1, to: 0.5}", "{kind: flicker, depth: 0.3}"


@pytest.fixture
def recipe_of(tmp_path, test_scenes):
    """Write the small recipe with this text as its only light, and return its path."""

    def write(light, repeats=1):
        head, _ = SMALL_RECIPE.split("lights:\n")
        path = tmp_path / "small.yaml"
        (tmp_path / "lamp.csv").write_text("time_s,gain\n0,1\n0.01,0.5\n")
        path.write_text(
            f"{head}lights:\n  it: {light}\nsplits:\n  test: {{scenes: [plane], lights: [it], repeats: {repeats}}}\n"
        )
        return path

    return write


def gains_of(sequence, frames=200):
    return group_gains(sequence.schedule, ("lamp", "room"), frames=frames, readout_hz=20_000).astype(float)


@pytest.mark.parametrize("group", ["", "lamp"])
def test_a_recipe_multiplies_for_all_lights_or_for_one(recipe_of, group):
    light = f"{{product: [{R}, {F}], offset: 0.25}}"
    (sequence,) = draw_sequences(read_recipe(recipe_of(f"{{{group}: {light}}}" if group else light)))
    found = gains_of(sequence)
    edges = np.arange(201) / 20_000
    expected = build_light({"product": [{**RAMP, "from": 1, "to": 0.5}, {"kind": "flicker", "depth": 0.3}]})
    means = np.diff(expected.integral(edges, 0.01)) * 20_000 + 0.25
    assert found[:, 0] == pytest.approx(means, abs=1e-6)
    assert found[:, 1] == pytest.approx(1.0 if group else means, abs=1e-6)


def test_each_factor_draws_from_a_stream_of_its_own(recipe_of):
    """Another range of one factor leaves the numbers of the others, and two walks of a product differ."""
    walk, sine = "{kind: random_walk, sd: 0.3}", "{{kind: sine, hz: {{uniform: [1, {}]}}}}"
    light = f"{{product: [{walk}, {sine.format(9)}, {walk}, {sine.format(9)}], offset: {{uniform: [0, 1]}}}}"
    plan = draw_sequences(read_recipe(recipe_of(light, repeats=3)))
    parts = [s.schedule[""] for s in plan]
    drawn = [(factor.get("seed"), factor.get("hz")) for part in parts for factor in part["product"]]
    assert len(set(drawn)) == 12
    assert len({part["offset"] for part in parts}) == 3
    changed = draw_sequences(read_recipe(recipe_of(light.replace("[1, 9]}}]", "[1, 5]}}]"), repeats=3)))
    for before, after in zip(parts, (s.schedule[""] for s in changed), strict=True):
        assert after["product"][:3] == before["product"][:3]
        assert after["product"][3] != before["product"][3]
        assert after["offset"] == before["offset"]


def test_a_choice_may_hold_products_and_a_factor_may_be_a_choice(recipe_of):
    light = (
        f"{{choice: [{{kind: constant}}, {{product: [{R}, {{choice: [{F}, {{kind: pwm, hz: 100, duty: 0.5}}]}}]}}]}}"
    )
    drawn = [s.schedule[""] for s in draw_sequences(read_recipe(recipe_of(light, repeats=20)))]
    kinds = {part["product"][1]["kind"] if "product" in part else part["kind"] for part in drawn}
    assert kinds == {"constant", "flicker", "pwm"}


def test_a_product_takes_a_table_a_spectrum_and_lux_and_adds_up_in_a_list(recipe_of):
    light = (
        f"[{{product: [{{kind: from_csv, file: lamp.csv}}, {F}], unit: lux, spectrum: led}}, "
        "{kind: constant, level: 0.5, spectrum: tungsten}]"
    )
    recipe = read_recipe(recipe_of(light))
    assert states_spectrum(recipe.lights["it"])
    assert not states_spectrum(read_recipe(recipe_of(f"{{product: [{R}, {F}]}}")).lights["it"])
    (sequence,) = draw_sequences(recipe, {"plane": SceneFamily(illuminance_lux={"lamp": 300.0, "room": 100.0})})
    first = sequence.schedule[""][0]
    assert first["lux_at_gain_1"] == 400
    assert first["product"][0]["file"]["text"].startswith("time_s")
    lamps = list_lamps(sequence.schedule, ("lamp", "room"))
    assert [lamp.spectrum for lamp in lamps] == ["led", "tungsten"] * 2


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (f"{{product: [{R}]}}", "small.yaml:7 | the product is | at least two schedules | without product"),
        ("{product: []}", "small.yaml:7 | the product is [] | at least two schedules"),
        (f"{{product: {R}}}", "small.yaml:7 | the product is | at least two schedules | without product"),
        ("{product: 3}", "small.yaml:7 | the product is 3 | at least two schedules"),
        (f"{{product: [{R}, null]}}", "small.yaml:7 | factor 2 of the product is None | {kind: ..., ...}"),
        (f"{{product: [{R}, {{lamp: {F}}}]}}", "small.yaml:7 | factor 2 of the product is {'lamp' | {kind: ..., ...}"),
        (f"{{product: [{R}, [{F}]]}}", "factor 2 of the product is [ | lights that add up"),
        (f"{{product: [{{product: [{R}, {F}]}}, {F}]}}", "factor 1 of the product is a product | one list"),
        (f"{{product: [{R}, {{kind: flickr}}]}}", "small.yaml:7 | 'flickr' | mean 'flicker'"),
        (f"{{product: [{R}, {{kind: flicker, dept: 1}}]}}", "small.yaml:7 | 'dept' | mean 'depth'"),
        (f"{{product: [{R}, {{kind: flicker, depth: {{uniform: [0, 2]}}}}]}}", "depth is 2 | 0 to 1"),
        (f"{{product: [{R}, {{kind: constant, level: -1}}]}}", "level is -1 | 0 or more"),
        (f"{{product: [{R}, {{kind: constant, offset: 1}}]}}", "factor 2 | 'offset' | beside product"),
        (f"{{product: [{R}, {{kind: constant, unit: lux}}]}}", "factor 2 | 'unit' | beside product"),
        (f"{{product: [{R}, {{kind: constant, spectrum: led}}]}}", "factor 2 | 'spectrum' | beside product"),
        (f"{{product: [{R}, {{choice: [{F}, {{kind: constant, offset: 1}}]}}]}}", "factor 2 | 'offset'"),
        (f"{{product: [{R}, {F}], ofset: 1}}", "small.yaml:7 | key of a product | 'ofset' | mean 'offset'"),
        (f"{{product: [{R}, {F}], offset: -1}}", "small.yaml:7 | offset is -1 | 0 or more"),
        (f"{{product: [{R}, {F}], unit: lx}}", "small.yaml:7 | unit is 'lx' | mean 'lux'"),
        (f"{{product: [{R}, {F}], spectrum: ledd}}", "spectrum is 'ledd' | mean 'led'"),
        (f"{{product: [{R}, {F}], lamp: {F}}}", "key of a product | 'lamp'"),
        (f"{{kind: constant, product: [{R}, {F}]}}", "the kind 'constant' and a product | one of the factors"),
        (f"{{kind: product, factors: [{R}, {F}]}}", "product is no kind | {product: ["),
        (f"{{products: [{R}, {F}]}}", "no light group 'products' | mean 'product'"),
        (f"{{product: [{R}, {{kind: sine, hz: 1.0e+12}}]}}", "every 2.5e-13 s | at most 10,000,000 | lower frequency"),
        (f"{{product: [{R}, {{kind: pwm, hz: 1.0e+300, duty: 0.5}}]}}", "at most 10,000,000 | lower frequency"),
        (
            "{product: [{kind: constant, level: 1.0e+200}, {kind: constant, level: 1.0e+200}]}",
            "product of gains is too",
        ),
        ("{product: [{kind: sine, hz: 1, level: 1.0e+300}, {kind: sine, hz: 1, level: 1.0e+300}]}", "is too large"),
        (f"{{product: [{R}, {{kind: constant, level: 1.0e+300}}]}}", "too large to be recorded"),
    ],
)
def test_a_product_that_does_not_fit_is_refused_in_one_line(recipe_of, light, message):
    assert_says(refusal(resolve_recipe, recipe_of(light)), message)


@pytest.mark.parametrize("stored", [{}, {"product": 3}, {"product": [{}, {}]}, {"product": [RAMP, {"choice": [RAMP]}]}])
def test_a_stored_component_that_is_no_schedule_is_refused_in_one_line(stored):
    refusal(build_light, stored)
