"""Light schedules, against the integrals that they represent."""

import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy import stats
from scipy.integrate import quad
from scipy.signal import sawtooth
from small_dataset import SPEC, make_sequence

import saf_gen
from saf_gen import get_light
from saf_gen.camera import get_sensor
from saf_gen.core.config import registry
from saf_gen.core.seeds import make_generator
from saf_gen.generate.record import Recorder
from saf_gen.parts import is_endless
from saf_gen.plugins.lights import build_light, gains_at_readouts, group_gains
from saf_gen.plugins.lights._gains import scale_light
from saf_gen.stack.focal_stack import FocalStack
from saf_gen.stack.time_resolved import PlaneSource

CSV = {"path": "lamp.csv", "text": "time_s,gain\n0.1,0.5\n0.4,2.0\n0.5,0.0\n0.9,1.0\n"}
EXAMPLES = {
    "constant": {"level": 0.7},
    "flash": {"at_s": 0.3, "peak": 20.0, "base": 0.2, "rise_s": 0.01, "decay_s": 0.1},
    "flicker": {"hz": 10.0, "depth": 0.6, "harmonics": [1.0, -0.2, 0.0857], "level": 1.3, "phase": 0.4},
    "from_csv": {"file": CSV},
    "pwm": {"hz": 7.0, "duty": 0.3, "low": 0.1, "high": 1.5, "phase": 2.0},
    "ramp": {"from": 0.5, "to": 2.0},
    "random_walk": {"sd": 0.5, "return_s": 0.2, "seed": 3},
    "sine": {"hz": 3.0, "swing": 0.4, "phase": 1.0},
    "steps": {"every_s": 0.1, "levels": [1.0, 0.4, 2.0]},
}
FLICKERING = {"kind": "flicker", "depth": 0.6, "hz": 10.0}
RISING = {"kind": "ramp", "from": 0.5, "to": 2.0}
RECTIFIED = [(-1) ** (n + 1) * 3 / (4 * n**2 - 1) for n in range(1, 41)]  # |cos| of half the frequency


def light_of(name, **changes):
    return get_light(name, **EXAMPLES[name] | changes)


def instantaneous(light, seconds, duration_s=1.0):
    """The gain at these times: the slope of the integral over a hundredth of a microsecond."""
    seconds = np.asarray(seconds, dtype=float)
    after = light.integral(seconds + 1e-8, duration_s) - light.integral(seconds, duration_s)
    return after / 1e-8


@pytest.mark.parametrize("name", [*EXAMPLES, "product"])
def test_a_light_goes_on_after_the_recording_and_the_recorded_gains_stay(name):
    light = light_of(name) if name != "product" else build_light({"product": [FLICKERING, RISING]})
    assert is_endless(light)
    recorded = gains_at_readouts(light, 1000, readout_hz=2000.0)
    longer = gains_at_readouts(light, 3000, readout_hz=2000.0, duration_s=0.5)
    assert np.array_equal(longer[:1000], recorded)
    if name == "ramp":
        assert set(longer[1000:]) == {np.float32(2.0)}
    elif name == "product":  # the ramp has ended at 2
        expected = 2 * gains_at_readouts(build_light(FLICKERING), 3000, readout_hz=2000.0)[1000:]
        assert longer[1000:] == pytest.approx(expected, abs=1e-5)
    else:
        assert np.array_equal(longer, gains_at_readouts(light, 3000, readout_hz=2000.0))


def test_a_light_of_a_user_ends_with_the_recording_unless_it_says_otherwise():
    class Lamp:
        pass

    assert not is_endless(Lamp())
    assert not is_endless(scale_light(Lamp(), offset=0.5))


def test_every_registered_light_has_an_example_here():
    assert set(EXAMPLES) == set(registry.names("lights"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_integral_starts_at_zero_and_never_falls(name):
    times = np.linspace(0, 1, 501)
    integral = light_of(name).integral(times, 1.0)
    assert integral.shape == times.shape
    assert integral.dtype == np.float64
    assert integral[0] == pytest.approx(0, abs=1e-15)
    assert (np.diff(integral) >= -1e-12).all()
    gains = gains_at_readouts(light_of(name), 2000, readout_hz=2000.0)
    assert gains.dtype == np.float32
    assert gains.min() >= 0


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_integral_is_the_same_whatever_times_are_asked_for(name):
    light, times = light_of(name), np.linspace(0, 1, 57)
    expected = light.integral(times, 1.0)
    assert np.array_equal(light.integral(times[::-1], 1.0), expected[::-1])
    assert np.array_equal(light.integral(times[20:21], 1.0), expected[20:21])
    assert np.array_equal(light_of(name).integral(times, 1.0), expected)


@pytest.mark.parametrize("name", sorted(set(EXAMPLES) - {"ramp"}))
def test_a_longer_recording_begins_like_a_shorter_one(name):
    """A ramp without over_s is as long as the recording; no other schedule depends on the length."""
    times = np.linspace(0, 0.5, 41)
    assert np.array_equal(light_of(name).integral(times, 0.5), light_of(name).integral(times, 2.0))


@pytest.mark.parametrize("name", EXAMPLES)
def test_gains_are_means_over_readouts_however_finely_time_is_cut(name):
    """Four readouts average to the one that spans them; point samples would not."""
    light = light_of(name)
    fine = gains_at_readouts(light, 4000, readout_hz=4000.0).reshape(-1, 4).mean(axis=1)
    assert np.allclose(fine, gains_at_readouts(light, 1000, readout_hz=1000.0), rtol=1e-5, atol=2e-6)


@pytest.mark.parametrize("name", sorted(set(EXAMPLES) - {"steps", "pwm"}))
def test_light_without_switches_is_continuous(name):
    """With a time step four times as fine the largest jump is less than half; a step would keep its height."""
    jumps = [abs(np.diff(instantaneous(light_of(name), np.linspace(0, 1, n)))).max() for n in (4001, 16001)]
    assert jumps[1] < 0.5 * jumps[0] + 1e-6


def test_a_ramp_runs_through_the_recording_or_through_its_own_length():
    gains = gains_at_readouts(get_light("ramp", **{"from": 0.5, "to": 2.0}), 1000, readout_hz=20_000)
    assert np.allclose(gains, 0.5 + 1.5 * (np.arange(1000) + 0.5) / 1000, rtol=1e-5)
    gains = gains_at_readouts(get_light("ramp", **{"from": 1, "to": 3, "over_s": 0.5}), 100, readout_hz=100)
    assert gains[:50] == pytest.approx(1 + 4 * (np.arange(50) + 0.5) / 100, rel=1e-5)
    assert gains[50:] == pytest.approx(3)


def test_steps_take_their_levels_in_turn():
    gains = gains_at_readouts(get_light("steps", every_s=0.1, levels=[1.0, 0.4, 2.0]), 20, readout_hz=20.0)
    assert gains == pytest.approx([1, 1, 0.4, 0.4, 2, 2] * 3 + [1, 1], rel=1e-5)


def test_a_step_within_a_readout_counts_in_proportion():
    gains = gains_at_readouts(get_light("steps", every_s=0.15, levels=[0.0, 1.0]), 2, readout_hz=10.0)
    assert gains == pytest.approx([0, 0.5], abs=1e-6)


def test_a_sine_is_the_integral_of_what_its_docstring_says():
    light = get_light("sine", hz=3.0, swing=0.4, level=1.5, phase=1.0)
    expected, _ = quad(lambda t: 1.5 * (1 + 0.4 * np.sin(2 * np.pi * 3.0 * t + 1.0)), 0, 0.37)
    assert float(light.integral(np.array(0.37), 1.0)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("hz", "frames", "harmonics", "depth"),
    [(100.0, 200, [1.0], 1.0), (120.0, 500, [1.0, -0.2, 0.0857], 0.1), (100.0, 200, [0.3, 1.0], 0.5)],
)
def test_mains_flicker_sums_to_nothing_in_whole_periods(hz, frames, harmonics, depth):
    """At 20 kHz 200 frames are whole periods of 100 Hz, and 500 frames of 120 Hz: their mean is exactly the level."""
    light = get_light("flicker", hz=hz, depth=depth, harmonics=harmonics, level=0.8, phase=0.7)
    gains = gains_at_readouts(light, 20 * frames, readout_hz=20_000).astype(float)
    assert gains.reshape(20, frames).mean(axis=1) == pytest.approx(0.8, abs=1e-6)
    assert np.ptp(gains) > 0.1
    edges = np.arange(21) * frames / 20_000
    assert np.diff(light.integral(edges, 1.0)) == pytest.approx(0.8 * frames / 20_000, rel=1e-12)


@pytest.mark.parametrize("harmonics", [[-2.0], [1.0, -0.2, 0.0857], RECTIFIED, [0.0, 0.0, 1.0]])
@pytest.mark.parametrize("depth", [0.35, 1.0])
def test_the_modulation_depth_is_the_one_asked_for(harmonics, depth):
    """(highest - lowest)/(highest + lowest), on a grid of 20,001 phases that finds the extremes to 1e-7."""
    light = get_light("flicker", hz=1.0, depth=depth, harmonics=harmonics, level=2.0, phase=0.3)
    gain = instantaneous(light, np.linspace(0, 1, 20_001))
    assert (gain.max() - gain.min()) / (gain.max() + gain.min()) == pytest.approx(depth, abs=1e-6)
    assert gain.min() > -1e-6


def test_the_spectrum_of_flicker_is_its_harmonics_and_nothing_else():
    """A readout of length 1/F reduces a harmonic at f by sinc(f/F); 0.1 s of 100 Hz at 20 kHz."""
    harmonics = np.array([1.0, -0.2, 0.0857])
    gains = gains_at_readouts(
        get_light("flicker", hz=100.0, depth=1.0, harmonics=list(harmonics)), 2000, readout_hz=20_000
    )
    line = np.fft.rfft(gains.astype(float)) / 1000
    heights = np.abs(line)
    lowest = np.cos(np.outer(np.linspace(0, np.pi, 100_001), [1, 2, 3])) @ harmonics
    scale = -1 / lowest.min()  # at depth 1 the lowest gain is 0
    expected = scale * np.abs(harmonics) * np.sinc(100 * np.array([1, 2, 3]) / 20_000)
    assert heights[[10, 20, 30]] == pytest.approx(expected, rel=1e-5)
    heights[[0, 10, 20, 30]] = 0
    assert heights.max() < 1e-6


def test_the_harmonics_of_a_rectified_sine_make_one():
    """With forty harmonics the lamp follows |cos| of 50 Hz within 1 % of its peak."""
    light = get_light("flicker", hz=100.0, depth=1.0, harmonics=RECTIFIED, level=2 / np.pi)
    times = np.linspace(0, 0.02, 401)
    assert instantaneous(light, times) == pytest.approx(abs(np.cos(2 * np.pi * 50 * times)), abs=0.01)


def test_phase_shifts_the_whole_wave():
    early = get_light("flicker", hz=50.0, depth=0.4, harmonics=[1.0, 0.5], phase=np.pi / 2)
    late = get_light("flicker", hz=50.0, depth=0.4, harmonics=[1.0, 0.5])
    times = np.linspace(0, 0.1, 301)
    assert instantaneous(early, times) == pytest.approx(instantaneous(late, times + 0.005), abs=1e-5)


@pytest.mark.parametrize(("duty", "phase"), [(0.0, 1.0), (0.37, 0.0), (0.37, -40.0), (1.0, 1.0)])
def test_the_mean_of_pwm_is_its_duty(duty, phase):
    """400 Hz at 20 kHz: 50 readouts per period."""
    light = get_light("pwm", hz=400.0, duty=duty, low=0.2, high=1.2, phase=phase)
    gains = gains_at_readouts(light, 2000, readout_hz=20_000)
    assert gains.reshape(40, 50).mean(axis=1) == pytest.approx(0.2 + duty, abs=1e-6)


def test_a_readout_of_pwm_is_a_mean_and_not_a_point():
    """The period is 2.5 readouts, and the light is on for 1: edges within readouts count in proportion."""
    gains = gains_at_readouts(get_light("pwm", hz=8_000.0, duty=0.4), 10, readout_hz=20_000)
    assert gains == pytest.approx([1, 0, 0.5, 0.5, 0] * 2, abs=1e-6)


@pytest.mark.parametrize("hz", [20_000.0, 60_000.0])
def test_pwm_as_fast_as_the_readout_is_steady(hz):
    gains = gains_at_readouts(get_light("pwm", hz=hz, duty=0.3, phase=1.0), 100, readout_hz=20_000)
    assert gains == pytest.approx(0.3, abs=1e-6)


def test_pwm_is_on_for_the_first_part_of_its_period():
    times = (np.arange(1000) + 0.5) / 1000
    light = get_light("pwm", hz=5.0, duty=0.25, low=0.5, high=2.0, phase=1.0)
    phase = (sawtooth(2 * np.pi * 5.0 * times + 1.0) + 1) / 2
    assert instantaneous(light, times) == pytest.approx(np.where(phase < 0.25, 2.0, 0.5), abs=1e-5)


@pytest.mark.parametrize(("rise_s", "decay_s"), [(1e-4, 1e-3), (5e-3, 1e-3), (1e-6, 2e-3)])
def test_a_flash_reaches_its_peak_where_theory_says(rise_s, decay_s):
    light = get_light("flash", at_s=0.1, peak=9.0, base=0.5, rise_s=rise_s, decay_s=decay_s)
    top = 0.1 + rise_s * np.log1p(decay_s / rise_s)
    assert instantaneous(light, [top])[0] == pytest.approx(9.0, rel=1e-4)
    assert instantaneous(light, 0.1 + np.linspace(0, 0.02, 5001)).max() <= 9.0 + 1e-4
    assert instantaneous(light, [0.05, 0.4]) == pytest.approx(0.5, abs=1e-5)


def test_a_flash_is_the_integral_of_what_its_docstring_says():
    r, d = 1e-4, 1e-3
    light = get_light("flash", at_s=0.002, peak=5.0, base=0.0, rise_s=r, decay_s=d)
    area, _ = quad(lambda t: (1 - np.exp(-t / r)) * np.exp(-t / d), 0, 0.003)
    highest = (d / r) / (1 + d / r) ** (1 + r / d)
    assert float(light.integral(np.array(0.005), 1.0)) == pytest.approx(5.0 * area / highest, rel=1e-9)


LIMIT = stats.norm.isf(0.5e-4)
"""Two-sided, at a significance of 1e-4; all tests of walks share the seeds 0 to 799."""


def walks(times, **options):
    """Return the logarithms of the gains of 800 walks at these times, (walks, times), and test their mean."""
    lights = (get_light("random_walk", seed=seed, **options) for seed in range(800))
    gain = np.array([instantaneous(light, times, 0.1) for light in lights]) / options["level"]
    error = gain[:, 1:].std(axis=0) / np.sqrt(len(gain))
    assert (abs(gain[:, 1:].mean(axis=0) - 1) < LIMIT * error).all()
    return np.log(gain)


@pytest.mark.slow
def test_a_returning_walk_is_stationary_log_normal_with_an_exponential_memory():
    """Mean of the gain; mean, spread, distribution and memory of its logarithm, also between the points of the walk."""
    y = walks([0.0, 0.02025, 0.09], sd=0.6, return_s=0.05, level=2.0) + 0.6**2 / 2
    for at in y.T:
        assert stats.kstest(at / 0.6, "norm").pvalue > 1e-4
        assert abs(at.mean()) < LIMIT * 0.6 / np.sqrt(at.size)
        assert abs(at.var() / 0.36 - 1) < LIMIT * np.sqrt(2 / at.size)
    for i, j, lag in [(0, 1, 0.02025), (1, 2, 0.06975), (0, 2, 0.09)]:
        seen = np.arctanh(np.corrcoef(y[:, i], y[:, j])[0, 1])
        assert abs(seen - np.arctanh(np.exp(-lag / 0.05))) < LIMIT / np.sqrt(y.shape[0] - 3)


@pytest.mark.slow
def test_a_free_walk_begins_at_its_level_and_spreads_as_the_root_of_time():
    y = walks([0.0, 0.02025, 0.08], sd=2.0, level=0.5)
    assert y[:, 0] == pytest.approx(0, abs=1e-4)
    for at, seconds in zip(y[:, 1:].T, (0.02025, 0.08), strict=True):
        spread = 2.0 * np.sqrt(seconds)
        assert stats.kstest((at + spread**2 / 2) / spread, "norm").pvalue > 1e-4


def test_a_walk_takes_its_numbers_from_its_own_named_stream():
    """The first point of a returning walk is the first number of the stream."""
    first = make_generator("random_walk", 7).standard_normal()
    gain = instantaneous(get_light("random_walk", sd=0.3, return_s=1.0, seed=7), [0.0])[0]
    assert gain == pytest.approx(np.exp(0.3 * first - 0.3**2 / 2), rel=1e-4)


def table(*points):
    return {"path": "t.csv", "text": "time_s,gain\n" + "".join(f"{t},{g}\n" for t, g in points)}


def test_a_table_runs_in_straight_lines_and_is_level_at_its_ends():
    times = np.linspace(0, 1, 997)
    expected = np.interp(times, [0.1, 0.4, 0.5, 0.9], [0.5, 2.0, 0.0, 1.0])
    assert instantaneous(light_of("from_csv"), times) == pytest.approx(expected, abs=1e-5)
    assert (gains_at_readouts(get_light("from_csv", file=table((0.3, 0.25))), 100, readout_hz=100.0) == 0.25).all()


def test_a_table_may_begin_before_the_recording_and_end_after_it():
    light = get_light("from_csv", file=table((-1, 0.0), (3, 4.0)))
    assert gains_at_readouts(light, 100, readout_hz=100.0) == pytest.approx(1 + (np.arange(100) + 0.5) / 100, rel=1e-5)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_offset_is_light_that_stays_and_lux_are_divided_by_the_lux_of_gain_1(name):
    times = np.linspace(0, 1, 101)
    alone, with_sky = light_of(name).integral(times, 1.0), light_of(name, offset=2.0).integral(times, 1.0)
    assert with_sky == pytest.approx(alone + 2.0 * times, abs=1e-12)
    lux = light_of(name, offset=2.0, unit="lux", lux_at_gain_1=400.0).integral(times, 1.0)
    assert lux == pytest.approx(with_sky / 400, rel=1e-12)


def test_a_lamp_that_goes_out_leaves_the_stream_of_a_scene_without_that_lamp(tmp_path):
    """Bit for bit the recording of a stack whose lamp is black; the sky is unchanged."""
    random = make_generator("test_lights", "stack")
    field = random.uniform(0.2, 1, (2, 9, 16, 24)).astype(np.float32) * 0.2
    sensor = get_sensor("vidar_400x250", rows=16, columns=24, pitch_m=60e-6)
    recorder = Recorder(sensor, 400, device_seed=1, provenance={})

    def spikes(name, schedule, radiance):
        stack = FocalStack(SPEC, radiance, np.full((16, 24), 0.5, np.float32), np.ones((16, 24), bool), "llvm")
        sequence = make_sequence(schedule=schedule, mean_rate=None)
        recorder.record(sequence, PlaneSource.from_stack(stack), path=tmp_path / name, fingerprint="")
        with saf_gen.open_stream(tmp_path / name) as stream:
            return stream.frames(0, 400), stream.gain

    black = field.copy()
    black[0] = 0
    lamp_out = {"lamp": {"kind": "constant", "level": 0.0}}
    out, gain = spikes("out.h5", lamp_out, field)
    without, _ = spikes("without.h5", {}, black)
    both, _ = spikes("both.h5", {}, field)
    assert (gain[:, 0] == 0).all()
    assert (gain[:, 1] == 1).all()
    assert np.array_equal(out, without)
    assert 0 < out.sum() < 0.8 * both.sum()
    halfway = {"lamp": {"kind": "steps", "every_s": 0.01, "levels": [1.0, 0.0]}}
    then, gain = spikes("then.h5", halfway, field)
    assert (gain[:200] == 1).all()
    assert np.array_equal(then[:200], both[:200])
    # Then only the sky is left, which each of 384 pixels counts to within one spike of phase.
    assert abs(then[200:].sum(axis=0).astype(int) - without[200:].sum(axis=0)).max() <= 1


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("constant", {"level": -1}, "level is -1 | 0 or more"),
        ("constant", {"unit": "lux", "lux_at_gain_1": 0}, "lux_at_gain_1 is 0 | lux, above 0"),
        ("ramp", {"from": -0.5, "to": 1}, "0 or more"),
        ("flicker", {"depth": 0.5, "hz": 0}, "hz is 0 | above 0"),
        ("flicker", {"depth": 0.5, "level": -1}, "level is -1 | 0 or more"),
        ("flicker", {"depth": 0.5, "phase": float("nan")}, "phase is nan | radians"),
        ("pwm", {"hz": -1, "duty": 0.5}, "hz is -1 | above 0"),
        ("pwm", {"hz": 10, "duty": 0.5, "phase": float("inf")}, "phase is inf | radians"),
        ("random_walk", {"sd": 0.1, "level": -1}, "level is -1 | 0 or more"),
        ("ramp", {"from": 0.5, "to": 1, "over_s": 0}, "over_s is 0 | seconds above 0"),
        ("steps", {"every_s": 1e-10, "levels": [1]}, "every_s is 1e-10 | 1e-06 s"),
        ("steps", {"every_s": 1, "levels": []}, "levels are"),
        ("sine", {"hz": 1, "phase": "pi"}, "phase is 'pi' | radians"),
        ("sine", {"hz": 0}, "hz is 0 | above 0"),
        ("sine", {"hz": 1, "swing": 1.5}, "swing is 1.5 | 0 to 1"),
        ("constant", {"level": "bright"}, "light schedule 'constant'"),
        ("flicker", {"depth": 1.1}, "depth is 1.1 | 0 to 1"),
        ("flicker", {"depth": 0.5, "harmonics": [0, 0]}, "harmonics are | a list of amplitudes"),
        ("pwm", {"hz": 10, "duty": 1.5}, "duty is 1.5 | 0 to 1"),
        ("pwm", {"hz": 10, "duty": 0.5, "low": 2}, "low is 2, high 1.0 | 0 <= low <= high"),
        ("flash", {"at_s": -1, "peak": 5}, "at_s is -1 | 0 or more"),
        ("flash", {"at_s": 0, "peak": 0.5}, "base is 1.0, peak 0.5 | 0 <= base <= peak"),
        ("flash", {"at_s": 0, "peak": 5, "rise_s": 0}, "rise_s is 0 | 1e-7 to 10 seconds"),
        ("random_walk", {"sd": -0.1}, "sd is -0.1 | 0 to 3"),
        ("random_walk", {"sd": 0.1, "return_s": 0.001}, "return_s is 0.001 | 0.005"),
        ("random_walk", {"sd": 0.1, "seed": -1}, "seed is -1 | 0 or more"),
        ("from_csv", {"file": "lamp.csv"}, "file is 'lamp.csv' | CSV file"),
        ("from_csv", {"file": table((0, 1), (1, -2))}, "t.csv | gain is -2 at 1 s | 0 or more"),
        ("constant", {"levl": 1}, "'constant' | 'levl' | mean 'level"),
        ("constant", {"ofset": 1}, "offset | mean 'offset"),
        ("constant", {"offset": -0.1}, "offset is -0.1 | 0 or more"),
        ("constant", {"unit": "lx"}, "unit is 'lx' | ratio, lux"),
        ("constant", {"unit": "lux"}, "illuminance_lux"),
        ("constant", {"lux_at_gain_1": 100}, "lux_at_gain_1 is 100 | unit: lux"),
    ],
)
def test_an_impossible_light_is_refused(name, options, message):
    assert_says(refusal(get_light, name, **options), message)


@pytest.mark.parametrize(
    "part",
    [
        {"kind": "constant", "level": 1e39},
        {"kind": "constant", "unit": "lux", "lux_at_gain_1": 1e-300},
        {"kind": "steps", "every_s": 0.004, "levels": [1, 1e39]},
    ],
    ids=str,
)
def test_a_gain_that_float32_cannot_hold_is_refused_in_one_line(part):
    error = refusal(group_gains, {"room": part}, ("lamp", "room"), frames=200, readout_hz=20_000)
    assert_says(error, "the gain of | is too large to be recorded | allowed: gains up to 3.4e+38")
