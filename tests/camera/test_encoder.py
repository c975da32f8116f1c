"""The encoder, compared with closed forms and with its slow reference."""

import hashlib
import inspect
import os
import subprocess
import sys
import tracemalloc
from dataclasses import asdict

import numpy as np
import pytest
from reference_encoder import encode_reference
from refusals import refusal
from scipy import stats

from saf_gen.camera import Encoder, draw_fixed_pattern, encode, get_sensor, knot_weights
from saf_gen.camera.counting_law import count_chi_squared, count_probabilities, count_variance, noise_per_spike

THETA = 29_900.0
QUIET = dict.fromkeys(asdict(get_sensor("ideal").noise), False)


def vidar(on=(), **changes):
    """Return the vidar_400x250 with only the noise terms ``on``, and without reset loss by default."""
    return get_sensor("vidar_400x250", **{"reset_loss": 0, **changes}, noise=QUIET | dict.fromkeys(on, True))


def unpacked(spikes, frames=None):
    """Return packed spikes (H, W, bytes) as frames (T, H, W)."""
    return np.moveaxis(np.unpackbits(spikes, axis=-1, bitorder="little", count=frames), -1, 0)


def counts(spikes):
    return np.bitwise_count(spikes).sum(axis=-1, dtype=np.uint32)


def uniform(charge, shape=(40, 50)):
    return np.full((1, *shape), charge, np.float32)


def schedule(frames=404, shape=(5, 30), groups=2, seed=3):
    """Return inputs of an encoder: a stack of light groups, swept over its knots, with changing gains."""
    random = np.random.default_rng(seed)
    stack = random.uniform(0, 12_000, (groups, 4, *shape)).astype(np.float32)
    index, fraction = knot_weights((np.arange(frames) + 0.5) / frames, 4)
    gain = random.uniform(0.2, 2, (frames, groups))
    return {"stack": stack, "index": index, "fraction": fraction, "gain": gain}


def some_frames(inputs, frames):
    return {key: value if key == "stack" else value[frames] for key, value in inputs.items()}


# --- the reference ----------------------------------------------------------------------------------


REFERENCES = {
    "quiet": {},
    "hard": {"reset": "hard", "reset_loss": 0.1},
    "dead readout": {"saturation": "dead_readout"},
    "pattern": {"on": ("dark", "response", "threshold_spread")},
    "noise": {"on": ("shot", "threshold_noise"), "threshold_e": 2_000, "reset_loss": 0.002},
    "everything": {
        "on": tuple(QUIET), "reset_jitter": 0.2, "row_skew": 0.8, "temperature_c": 40, "dead_fraction": 0.1,
        "reset_loss": 0.002,
    },
}  # fmt: skip


@pytest.mark.parametrize("changes", REFERENCES.values(), ids=REFERENCES)
def test_the_bits_are_those_of_the_scalar_reference(changes):
    """The 90 pixels are a block of 64 and a part of a block."""
    sensor = vidar(**changes)
    inputs = schedule(frames=204, shape=(3, 30))
    fast = Encoder(sensor, (3, 30), seed=11).encode(**inputs)
    assert np.array_equal(unpacked(fast, 204), encode_reference(*inputs.values(), sensor=sensor, seed=11))


@pytest.mark.slow
def test_intervals_are_distributed_as_with_normal_noise():
    """Two-sample χ² test of 2 × 30,000 intervals at 40 e⁻ per spike; significance 1e-4, seed 5."""
    sensor = vidar(on=("shot", "threshold_noise"), threshold_e=40)
    stack = np.full((1, 1, 10, 100), 10.0, np.float32)
    index, fraction, gain = np.zeros(124, int), np.zeros(124), np.ones((124, 1))
    fast = unpacked(Encoder(sensor, (10, 100), seed=5).encode(stack, index=index, fraction=fraction, gain=gain), 124)
    random = np.random.default_rng(5)
    slow = encode_reference(stack, index, fraction, gain, sensor=sensor, seed=6, normal=random.standard_normal)
    found = []
    for frames in (fast, slow):
        pixels, times = np.nonzero(frames.reshape(124, -1).T)
        interval = np.diff(times)[np.diff(pixels) == 0]
        found.append(np.bincount(np.clip(interval, 2, 6), minlength=7)[2:])
    assert stats.chi2_contingency(np.array(found)).pvalue > 1e-4


# --- rates ------------------------------------------------------------------------------------------


def test_with_all_noise_on_the_mean_rate_is_light_plus_dark():
    """10,000 pixels, 4,000 frames, seed 2; 0.5 % is allowed, and a spread of pixels of 5.5 % leaves 0.06 %."""
    sensor = get_sensor("vidar_400x250")
    spikes = encode(uniform(0.2 * THETA, (100, 100)), sensor, frames=4_000, seed=2)
    expected = (0.2 + 0.0045) / (1 + 0.002 * 0.2045)
    assert counts(spikes).mean() / 4_000 == pytest.approx(expected, rel=0.005)


def test_overload_fires_every_readout_and_echoes_at_most_once():
    stack = np.stack([uniform(50 * THETA), uniform(0.0)], axis=1)
    index = np.repeat([0, 1], 80)
    spikes = unpacked(
        Encoder(vidar(), (40, 50), seed=1).encode(stack, index=index, fraction=np.zeros(160), gain=np.ones((160, 1)))
    )
    assert spikes[:80].all()
    assert spikes[80:].sum(axis=0).max() <= 1


# --- noise ------------------------------------------------------------------------------------------


def first_intervals(charge, sensor, frames, seed):
    """Return the charge between the first two spikes of each pixel, in electrons."""
    spikes = unpacked(encode(uniform(charge, (160, 250)), sensor, frames=frames, seed=seed))
    first = spikes.argmax(axis=0)
    after = np.arange(frames)[:, None, None] > first
    return ((spikes & after).argmax(axis=0) - first).ravel() * charge


def test_shot_noise_makes_the_variance_of_an_interval_the_threshold():
    """χ² test of 40,000 independent intervals at 400 e⁻ per spike, significance 1e-4, seed 9.

    Readout in steps of q = 8 e⁻ adds q²/6. Other terms of the exact law (test_counting_law.py) vanish, because the
    noise of an interval is 2.5 readouts.
    """
    charge = first_intervals(8.0, vidar(on=("shot",), threshold_e=400), 128, 9)
    expected = 400 + 8.0**2 / 6
    z = (charge.var() / expected - 1) / np.sqrt(2 / charge.size)
    assert abs(z) < stats.norm.isf(0.5e-4)
    assert charge.mean() == pytest.approx(400, abs=4 * np.sqrt(expected / charge.size))


def test_threshold_noise_alone_has_its_own_variance():
    """χ² test of 40,000 intervals, significance 1e-4, seed 9; readout adds q²/6."""
    sensor = vidar(on=("threshold_noise",), threshold_e=400, threshold_noise_rms=0.05)
    charge = first_intervals(8.0, sensor, 128, 9)
    z = (charge.var() / ((0.05 * 400) ** 2 + 8.0**2 / 6) - 1) / np.sqrt(2 / charge.size)
    assert abs(z) < stats.norm.isf(0.5e-4)


@pytest.mark.parametrize("interval", [2.6, 12.7])
def test_reset_jitter_adds_its_square_to_the_variance_of_an_interval_at_any_rate(interval):
    """Pearson's χ² and the variance of 40,000 intervals, for the exact law with s² = j²; 1e-4 each, seed 9.

    In charge that is (j·charge per readout)². The law needs a uniform phase, which jitter produces in 60 spikes.
    """
    jitter, skipped = 0.2, 60
    sensor = vidar(on=("reset_jitter",), reset_jitter=jitter)
    rate = np.float32(THETA / interval) / THETA
    charge = np.float32(rate * THETA)
    frames = int((skipped + 3) * interval + 12)
    seen = unpacked(encode(uniform(charge, (160, 250)), sensor, frames=frames, seed=9))
    so_far = seen.cumsum(axis=0, dtype=np.uint8)
    first, second = ((so_far == count).argmax(axis=0).ravel() for count in (skipped, skipped + 1))
    mean, variance = (THETA / float(charge), noise_per_spike(sensor, rate=float(rate)) * (THETA / float(charge)) ** 2)
    assert variance == pytest.approx(jitter**2)
    statistic, freedom = count_chi_squared(second - first, count_probabilities(mean, variance))
    assert stats.chi2.sf(statistic, freedom) > 1e-4
    allowed = count_variance(mean, variance) * stats.norm.isf(0.5e-4) * np.sqrt(2 / first.size)
    assert np.var(second - first) == pytest.approx(count_variance(mean, variance), abs=allowed)


def test_flicker_of_100_hz_vanishes_in_windows_of_200_frames():
    edges = np.arange(2_001) / 20_000
    integral = edges - 0.8 * np.cos(2 * np.pi * 100 * edges) / (2 * np.pi * 100)
    gain = (np.diff(integral) * 20_000)[:, None]
    encoder = Encoder(vidar(), (100, 100), seed=3)
    stack = np.full((1, 1, 100, 100), 0.2 * THETA, np.float32)
    spikes = encoder.encode(stack, index=np.zeros(2_000, int), fraction=np.zeros(2_000), gain=gain)
    periods = unpacked(spikes).reshape(10, 200, 100, 100).sum(axis=1)
    halves = unpacked(spikes)[:1_600].reshape(16, 100, 100, 100).sum(axis=1)
    assert abs(periods - 40.0).max() <= 1
    assert np.ptp(periods.mean(axis=(1, 2))) < 0.02
    assert np.ptp(halves.mean(axis=(1, 2))) > 15


@pytest.mark.parametrize("term", QUIET)
def test_each_noise_term_changes_only_what_it_should(term):
    """Rates of 2,000 pixels over 2,000 frames change by the maps of the device; seed 7."""
    sensor = vidar(on=(term,), dead_fraction=0.01, dust_fraction=0.02, reset_jitter=0.1)
    charge = uniform(0.2 * THETA)
    quiet, noisy = (encode(charge, one, frames=2_000, seed=7) for one in (vidar(), sensor))
    device = draw_fixed_pattern(sensor, (40, 50), seed=7)
    expected = (device.response + device.dark / (0.2 * THETA)) * (THETA / device.threshold)
    ratio = counts(noisy) / counts(quiet)
    assert ratio.mean() == pytest.approx(expected.mean(), abs=0.003)
    assert ratio == pytest.approx(expected, abs=0.02)
    assert ratio.std() == pytest.approx(expected.std(), rel=0.05, abs=0.002)
    assert not np.array_equal(quiet, noisy)


# --- rows that are read one after the other -----------------------------------------------------------


def sums_to_a_ramp(sensor, slope, *, frames=4_096, rows=17, columns=4_000):
    """Return the mean number of spikes per row, (row,), while the charge per readout rises from 0 by ``slope``."""
    knots = np.float32([slope / 2, slope * (frames - 0.5)])  # at the middle of the first and last readouts
    stack = np.broadcast_to(knots[:, None, None], (1, 2, rows, columns)).copy()
    index, fraction = knot_weights(np.arange(frames) / (frames - 1), 2)
    encoder = Encoder(sensor, (rows, columns), seed=2)
    spikes = encoder.encode(stack, index=index, fraction=fraction, gain=np.ones((frames, 1)))
    return counts(spikes).mean(axis=1)


@pytest.mark.slow
def test_under_a_ramp_each_row_is_behind_by_its_part_of_the_skew():
    """Row r of n is read (n - 1 - r)/(n - 1) of the skew earlier, and is behind by at most slope·frames·skew/θ spikes.

    A pixel has one spike less with that probability f. The mean of 4,000 pixels has a standard error of
    √(f(1 − f)/4,000), of which 5 are allowed. The first readout lacks slope·e², which is negligible. Seed 2.
    """
    skew, slope, frames, rows = 1.0, 0.9 * THETA / 4_096, 4_096, 17
    late = sums_to_a_ramp(vidar(), slope) - sums_to_a_ramp(vidar(row_skew=skew), slope)
    expected = skew * np.linspace(1, 0, rows) * slope * frames / THETA
    assert late == pytest.approx(expected, abs=5 * 0.5 / np.sqrt(4_000))
    assert late[-1] == 0


# --- blocks, threads, machines ----------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, {"row_skew": 0.7, "reset_jitter": 0.1, "noise": {"reset_jitter": True}}])
@pytest.mark.parametrize("cut", [(8,), (8, 200, 400)])
def test_any_cut_into_blocks_gives_the_same_bits(cut, changes):
    inputs = schedule()
    sensor = get_sensor("vidar_400x250", threshold_e=2_000, **changes)
    uncut = Encoder(sensor, (5, 30), seed=11).encode(**inputs)
    encoder, parts = Encoder(sensor, (5, 30), seed=11), []
    for a, b in zip((0, *cut), (*cut, 404), strict=True):
        parts.append(encoder.encode(**some_frames(inputs, slice(a, b))))
    assert np.array_equal(np.concatenate(parts, axis=-1), uncut)
    assert encoder.frames == 404


@pytest.mark.parametrize("threads", [2, 7])
def test_the_number_of_threads_does_not_matter(threads):
    inputs = schedule(shape=(23, 31))
    sensor = get_sensor("vidar_400x250")
    one = Encoder(sensor, (23, 31), seed=11, threads=1).encode(**inputs)
    assert np.array_equal(one, Encoder(sensor, (23, 31), seed=11, threads=threads).encode(**inputs))


@pytest.mark.parametrize(("rows", "skew"), [(slice(0, 5), 0), (slice(4, 9), 0.9), (slice(20, None), 0.9)])
def test_some_rows_fire_as_they_do_in_the_whole(rows, skew):
    """With 48 columns blocks of 64 pixels begin in every fourth row."""
    inputs = schedule(shape=(23, 48))
    sensor = get_sensor("vidar_400x250", row_skew=skew)
    all_rows = Encoder(sensor, (23, 48), seed=11).encode(**inputs)
    some = Encoder(sensor, (23, 48), seed=11, rows=rows)
    parts = [
        some.encode(**some_frames(inputs, t) | {"stack": inputs["stack"][:, :, rows]})
        for t in (slice(200), slice(200, None))
    ]
    assert np.array_equal(np.concatenate(parts, axis=-1), all_rows[rows])


DIGEST = "39e4cac5decdb4b96222699f8056c99f9871e4cd8befe38bed1c444bb2a6b730"


def digest_of_a_stream():
    inputs = schedule(frames=2_000, shape=(20, 33))
    spikes = Encoder(get_sensor("vidar_400x250"), (20, 33), seed=11).encode(**inputs)
    return hashlib.sha256(spikes).hexdigest()


def test_the_bits_are_the_same_on_every_machine():
    """If this pinned digest changes, all streams change; say in the commit what moved, and why."""
    assert digest_of_a_stream() == DIGEST


@pytest.mark.long
def test_the_bits_are_the_same_on_a_processor_without_vector_extensions(tmp_path):
    """The kernel is compiled for a generic processor, and numpy's vector loops are disabled.

    The process gets only the source of two functions, so that it imports neither pytest nor scipy.stats.
    """
    environment = os.environ | {
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CACHE_DIR": str(tmp_path),
        "NPY_DISABLE_CPU_FEATURES": "AVX2 AVX512F AVX512CD AVX512_SKX",
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    code = "import hashlib\nimport numpy as np\nfrom saf_gen.camera import Encoder, knot_weights, get_sensor\n"
    code += f"{inspect.getsource(schedule)}\n{inspect.getsource(digest_of_a_stream)}\nprint(digest_of_a_stream())"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.strip() == DIGEST, done.stderr


def test_seeds_name_recordings_and_devices():
    sensor = get_sensor("vidar_400x250")
    one, two = (Encoder(sensor, (20, 30), seed=1, device_seed=5), Encoder(sensor, (20, 30), seed=2, device_seed=5))
    assert np.array_equal(one.pattern.response, two.pattern.response)
    charge = uniform(0.2 * THETA)
    assert np.array_equal(encode(charge, sensor, frames=64, seed=1), encode(charge, "vidar_400x250", frames=64, seed=1))
    assert not np.array_equal(encode(charge, sensor, frames=64, seed=1), encode(charge, sensor, frames=64, seed=2))


def test_the_last_byte_is_filled_with_zeros():
    spikes = encode(uniform(THETA), vidar(), frames=11, seed=1)
    assert spikes.shape == (40, 50, 2)
    assert (spikes[..., 0] == 255).all()
    assert (spikes[..., 1] == 0b111).all()


def test_memory_does_not_grow_with_the_recording():
    """Uses the least of three peaks, because threads of earlier tests may allocate memory at the same time."""
    inputs = schedule(frames=800, shape=(50, 64))
    encoder = Encoder(get_sensor("vidar_400x250"), (50, 64), seed=1)

    def find_peak(blocks):
        tracemalloc.reset_peak()
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(blocks):
            encoder.encode(**inputs)
        return tracemalloc.get_traced_memory()[1] - before

    tracemalloc.start()
    try:
        peaks = [min(find_peak(blocks) for _ in range(3)) for blocks in (2, 20)]
    finally:
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0] + 20_000


# --- errors -----------------------------------------------------------------------------------------


def encode_uniform(charge, frames=16):
    return encode(charge, "ideal", frames=frames, seed=1)


def encode_schedule(**changes):
    return Encoder(get_sensor("ideal"), (5, 30), seed=1).encode(**schedule() | changes)


def encode_after_a_part_of_a_byte():
    encoder = Encoder(get_sensor("ideal"), (5, 30), seed=1)
    encoder.encode(**some_frames(schedule(), slice(13)))
    encoder.encode(**schedule())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: encode_uniform(uniform(-1.0)), "negative"),
        (lambda: encode_uniform(uniform(np.nan)), "not finite"),
        (lambda: encode_uniform(uniform(1.0)[0]), "3 axes"),
        (lambda: encode_uniform(uniform(1.0), 0), "frames is 0"),
        (lambda: encode_uniform(uniform(1.0), 2.5), "frames is 2.5"),
        (lambda: encode_schedule(stack=np.ones((2, 4, 5, 30))), "the stack is float64"),
        (lambda: encode_schedule(stack=np.ones((2, 4, 5, 31), np.float32)), "float32 (light, focus, 5, 30)"),
        (lambda: encode_schedule(index=np.full(404, 3)), "knot 3 to knot 4; allowed: 0 to 3"),
        (lambda: encode_schedule(fraction=np.full(404, 1.5)), "fraction is outside"),
        (lambda: encode_schedule(gain=np.ones((404, 3))), "(n,), (n,) and (n, 2)"),
        (lambda: encode_schedule(gain=np.full((404, 2), -1.0)), "gain is negative"),
        (encode_after_a_part_of_a_byte, "ended at readout 13"),
        (lambda: Encoder(get_sensor("ideal"), (0, 4), seed=1), "shape is (0, 4)"),
        (lambda: Encoder(get_sensor("ideal"), (23, 48), seed=1, rows=slice(3, 9)), "a multiple of 4"),
        (lambda: Encoder(get_sensor("ideal"), (23, 48), seed=1, rows=slice(5, 5)), "a multiple of 4"),
    ],
)
def test_what_cannot_be_encoded_is_refused(call, message):
    assert message in str(refusal(call))
