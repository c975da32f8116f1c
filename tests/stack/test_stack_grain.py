"""The grain of a stack under any mix of its lights, its file in the stack's folder, and grain along a recording."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from mean_energy import mean_energy
from refusals import refusal
from small_dataset import SPEC

from saf_gen.core.seeds import make_generator
from saf_gen.stack.focal_stack import FocalStack, StackStore
from saf_gen.stack.grain import ENERGIES, FILE, estimate_grain, measure_pictures, read_grain, write_grain
from saf_gen.stack.time_resolved import GRAIN_MOMENTS, PlaneSource, TimeResolvedStack, grain_along
from saf_gen.stream.metadata import Truth
from saf_gen.stream.recorded_grain import grain_of_stream

ROWS, COLUMNS, POSITIONS = 48, 64, 9
TARGET = np.zeros((ROWS, COLUMNS), bool)
TARGET[4:44, 8:60] = True
BOX = (slice(4, 44), slice(8, 60))
SAMPLES = (256, 32)
SIGMA = np.array([0.05, 0.02])
GAINS = [np.array([1.0, 1.0]), np.array([0.2, 3.0]), np.array([0.0, 1.0])]


def clean_stack():
    """Two lights whose pictures are blurred away from position 4: (light, focus, row, col)."""
    random = make_generator("clean", 1)
    texture = random.random((2, 1, ROWS, COLUMNS))
    contrast = np.exp(-((np.arange(POSITIONS) - 4) ** 2) / 4)[None, :, None, None]
    return np.array([1.0, 0.4])[:, None, None, None] * (1 + 0.5 * contrast * (texture - 0.5))


def noise(random, factor=1.0):
    """Noise of both lights, part of which is common to them."""
    separate = random.standard_normal((2, POSITIONS, ROWS, COLUMNS))
    common = random.standard_normal((1, POSITIONS, ROWS, COLUMNS))
    return factor * SIGMA[:, None, None, None] * (0.8 * separate + 0.6 * common)


@pytest.fixture(scope="module")
def renders():
    clean, random = clean_stack(), make_generator("noise", 2)
    return clean + noise(random), clean + noise(random, math.sqrt(SAMPLES[0] / SAMPLES[1]))


@pytest.fixture(scope="module")
def grain(renders):
    return measure_pictures(*renders, target=TARGET, samples=SAMPLES)


@pytest.mark.parametrize("gain", GAINS, ids=str)
def test_a_mix_of_lights_has_the_grain_of_the_mixed_pictures(renders, grain, gain):
    """Both computations are exact and agree to rounding; the mean is that of the first render."""
    for k in (3, 4):
        first, second = (np.tensordot(gain, stack[:, k], 1)[BOX] for stack in renders)
        found = estimate_grain(first, second, ratio=SAMPLES[0] / SAMPLES[1])
        rms, noise, signal = grain.mix(k, gain)
        assert rms * first.mean() == pytest.approx(found.rms.value * found.mean, rel=1e-9)
        for energy in ENERGIES:
            assert noise[energy] / signal[energy] == pytest.approx(found.noise_over_signal[energy].value, rel=1e-9)
            expected = mean_energy(first, second, energy=energy) / first.mean() ** 2
            assert signal[energy] == pytest.approx(expected, rel=1e-9)


def test_planted_noise_is_found_under_any_gains(grain):
    """The variance of a mix is g·Σ·g with the covariance Σ of the lights; 2,080 pixels, 9 positions, seed 2.

    The standard error of each rms is 1.6 %; four are allowed.
    """
    covariance = np.outer(SIGMA, SIGMA) * np.array([[1.0, 0.36], [0.36, 1.0]])
    for gain in GAINS:
        mean = gain @ np.array([1.0, 0.4])
        for k in range(POSITIONS):
            rms, of_noise, _ = grain.mix(k, gain)
            expected = math.sqrt(gain @ covariance @ gain) / mean
            assert rms == pytest.approx(expected, rel=0.065)
            assert of_noise["brenner"] == pytest.approx(2 * expected**2, rel=0.2)
            assert of_noise["tenengrad"] == pytest.approx(24 * expected**2, rel=0.3)


def test_a_dark_mix_has_no_figures(grain):
    rms, of_noise, signal = grain.mix(4, np.zeros(2))
    assert all(math.isnan(x) for x in (rms, *of_noise.values(), *signal.values()))


def test_what_cannot_be_compared_is_refused(renders):
    assert "shapes" in refusal(measure_pictures, renders[0], renders[1][:1], target=TARGET, samples=SAMPLES).problem
    empty = np.zeros_like(TARGET)
    assert "marks 0 pixels" in refusal(measure_pictures, *renders, target=empty, samples=SAMPLES).problem


# --- the file -----------------------------------------------------------------------------------------

STORED = replace(SPEC, rows=ROWS, columns=COLUMNS)


@pytest.fixture
def stored(tmp_path, renders, grain):
    """Store a stack with its grain, and return the root."""
    store = StackStore(tmp_path, STORED)
    store.write_geometry(np.full((ROWS, COLUMNS), 0.5, np.float32), TARGET, backend="llvm")
    for group, radiance in zip(STORED.groups, renders[0].astype(np.float32), strict=True):
        store.write_group(group, radiance, backend="llvm")
    digest = store.digest()
    write_grain(tmp_path, STORED, grain=grain)
    assert store.digest() == digest, "grain is no part of the stack"
    assert store.missing_pieces() == []
    return tmp_path


def test_grain_is_read_as_it_was_written(stored, grain):
    again = read_grain(stored, STORED)
    assert again.samples == SAMPLES
    for k in (0, 4, 8):
        for gain in GAINS:
            a, b = again.mix(k, gain), grain.mix(k, gain)
            assert a[0] == pytest.approx(b[0], rel=1e-5)
            assert a[1] == pytest.approx(b[1], rel=1e-5)
            assert a[2] == pytest.approx(b[2], rel=1e-4, abs=1e-9)


def test_grain_of_another_stack_is_not_taken(stored):
    StackStore(stored, STORED).write_group("lamp", np.ones((9, ROWS, COLUMNS), np.float32), backend="llvm")
    assert read_grain(stored, STORED) is None


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text[:-200],
        lambda text: "[]",
        lambda text: text.replace('"square": [', '"square": [0, '),
        lambda text: text.replace('"indices": [0', '"indices": [90'),
    ],
)
def test_a_damaged_file_counts_as_missing(stored, spoil):
    path = stored / STORED.key / FILE
    path.write_text(spoil(path.read_text()))
    assert read_grain(stored, STORED) is None
    path.unlink()
    assert read_grain(stored, STORED) is None


def test_what_is_no_number_is_stored_as_json_knows_it(stored, grain):
    strange = replace(grain, signal={**grain.signal, "brenner": np.full_like(grain.square, np.nan)})
    write_grain(stored, STORED, grain=strange)
    assert "NaN" not in (stored / STORED.key / FILE).read_text()
    assert math.isnan(read_grain(stored, STORED).mix(4, GAINS[0])[2]["brenner"])


# --- along a recording --------------------------------------------------------------------------------

FRAMES = 400
SWEEP = (np.arange(FRAMES) + 0.5) / FRAMES


def sweep_source(grain):
    stack = FocalStack(STORED, np.ones((2, 9, ROWS, COLUMNS), np.float32), np.ones((ROWS, COLUMNS)), TARGET, "llvm")
    return replace(PlaneSource.from_stack(stack), load_grain=lambda j: grain)


def test_a_still_recording_has_moments_and_its_focus(grain):
    gain = np.stack([np.linspace(1, 2, FRAMES), np.ones(FRAMES)], axis=1)
    found = grain_along(sweep_source(grain), Truth(position=0.5), position=SWEEP, gain=gain)
    assert len(found.moments) == GRAIN_MOMENTS + 1
    focus = found.moments[found.focus]
    assert focus.frame in (199, 200)
    assert focus.position == 0.5
    rms, of_noise, signal = grain.mix(4, gain[focus.frame])
    assert (focus.rms, focus.noise, focus.signal) == (rms, of_noise, signal)
    assert [m.frame for m in found.moments] == sorted({m.frame for m in found.moments})
    assert found.rms_range[0] <= found.rms_in_focus <= found.rms_range[1]


def test_a_moment_has_the_nearest_position_that_was_measured(renders):
    some = measure_pictures(*renders, target=TARGET, samples=SAMPLES, indices=[0, 3, 8])
    found = grain_along(sweep_source(some), Truth(position=0.5), position=SWEEP, gain=np.ones((FRAMES, 2)))
    assert found.moments[found.focus].position == 3 / 8
    assert {moment.position for moment in found.moments} == {0.0, 3 / 8, 1.0}


def test_a_lens_that_never_meets_the_truth_has_its_nearest_frame(grain):
    found = grain_along(sweep_source(grain), Truth(position=1.2), position=SWEEP, gain=np.ones((FRAMES, 2)))
    assert found.moments[found.focus].frame == FRAMES - 1


def test_a_moving_recording_has_the_slices_that_were_measured(grain):
    starts = (0, 160, 320, 480)
    windows = ((0, 4), (2, 7), (5, 8), (7, 8))
    specs = tuple(replace(STORED, time_s=t / 20_000, window=w) for t, w in zip(starts, windows, strict=True))
    known = {1: cut(grain, 2, 7), 3: cut(grain, 7, 8)}
    source = PlaneSource(TimeResolvedStack(starts, specs), None, None, "d", "llvm", known.get)
    track = np.full(FRAMES, 0.4, np.float32)
    found = grain_along(source, Truth(0.4, track=track), position=SWEEP, gain=np.ones((FRAMES, 2)))
    assert [m.frame for m in found.moments] == [160, FRAMES - 1]
    assert [m.position for m in found.moments] == [3 / 8, 1.0]
    assert found.focus == 0
    assert found.moments[0].rms == grain.mix(3, np.ones(2))[0]


def cut(grain, first, last):
    part = slice(first, last + 1)
    return replace(
        grain,
        indices=np.arange(last + 1 - first),
        mean=grain.mean[part],
        square=grain.square[part],
        noise={name: array[part] for name, array in grain.noise.items()},
        signal={name: array[part] for name, array in grain.signal.items()},
    )


def test_stacks_without_grain_leave_it_unknown():
    source = sweep_source(None)
    assert grain_along(source, Truth(0.5), position=SWEEP, gain=np.ones((FRAMES, 2))) is None


# --- as text ------------------------------------------------------------------------------------------


def test_the_text_of_a_stream_holds_it(grain):
    found = grain_along(sweep_source(grain), Truth(0.5), position=SWEEP, gain=np.ones((FRAMES, 2)))
    text = found.to_text()
    json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    again = grain_of_stream({"grain": text})
    assert again.focus == found.focus
    assert again.samples == SAMPLES
    assert again.rms_in_focus == pytest.approx(found.rms_in_focus, rel=1e-5)
    assert again.moments[3].signal == pytest.approx(dict(found.moments[3].signal), rel=1e-5, abs=1e-12)


def test_noise_over_the_curve_is_the_largest_noise_over_its_range(grain):
    found = grain_along(sweep_source(grain), Truth(0.5), position=SWEEP, gain=np.ones((FRAMES, 2)))
    noise = max(m.noise["brenner"] for m in found.moments)
    signal = [m.signal["brenner"] for m in found.moments]
    assert found.noise_over_curve("brenner") == pytest.approx(noise / (max(signal) - min(signal)))
    assert found.noise_over_curve("brenner", curve_range=2 * noise) == pytest.approx(0.5)
    assert found.noise_over_curve("brenner", curve_range=0.0) == math.inf
    assert math.isnan(found.noise_over_curve("unheard"))


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"moments": [], "focus": 0, "samples": [1, 2]}', '{"moments": 3}'])
def test_a_text_that_states_no_grain_leaves_it_unknown(text):
    assert grain_of_stream({"grain": text}) is None
    assert grain_of_stream({}) is None
