"""The exposure of moving scenes: the target fires as asked at the moment of its mask, whether the lens meets it or not.

The stacks are made by hand. A bright card crosses a dark field by a pixel per time slice, comes nearer, and is blurred
according to its depth. A picture of one moment and a mask of another would differ by many of its 30 columns.
"""

import hashlib
import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy.ndimage import fourier_gaussian
from small_dataset import make_sequence

import saf_gen
from saf_gen.camera import get_sensor
from saf_gen.generate.record import Recorder, has_recording, recording_digest
from saf_gen.optics import ImageDistanceDrive
from saf_gen.plugins.motions import lens_positions
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack, slice_windows

ROWS, COLUMNS, POSITIONS, FRAMES, STEP, PITCH_M = 40, 80, 33, 1_920, 40, 60e-6
AT = tuple(range(0, FRAMES + 1, STEP))
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.60, 0.42))
SENSOR = get_sensor("ideal", rows=ROWS, columns=COLUMNS, pitch_m=PITCH_M)
PLANNED = "0" * 64


def from_csv(begin, end):
    text = f"time_s,position\n0,{begin}\n0.05,{end}\n0.096,{end}\n"
    return {"kind": "from_csv", "file": {"path": "lens.csv", "text": text}}


MOTIONS = {
    "sweep": lambda begin, end: {"kind": "sweep", "from": begin, "to": end},
    "hold": lambda begin, end: {"kind": "hold", "position": (begin + 2 * end) / 3},
    "steps": lambda begin, end: {
        "kind": "steps", "count": 4, "natural_hz": 400.0, "damping": 0.5, "from": begin, "to": end
    },
    "hand": lambda begin, end: {
        "kind": "hand", "bandwidth_hz": 60.0, "irregularity": 0.5, "seed": 3, "from": begin, "to": end
    },
    "sweep_and_return": lambda begin, end: {"kind": "sweep_and_return", "from": begin, "to": end},
    "from_csv": from_csv,
}  # fmt: skip
CASES = {  # depths of the card at the first and at the last moment, and positions of the lens
    "crossing": ((0.52, 0.48), (0.1, 0.7)),  # the focus moves from 0.35 to 0.58
    "not crossing": ((0.47, 0.45), (0.0, 0.4)),  # from 0.64 to 0.77
    "focus outside the travel": ((0.9, 0.8), (0.9, 0.3)),
}
LIGHTS = {
    "constant": {"kind": "constant"},
    "continuous": {"kind": "ramp", "from": 0.5, "to": 2.0},
    "sudden": {"kind": "steps", "every_s": 0.02, "levels": [1.0, 0.4, 2.0]},
}


def card(j):
    """The mask of the card at moment j."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[5:35, j + 1 : j + 31] = True
    return mask


def blurred(j, position, depth_m):
    """The card of radiance 1 on a field of 1/40, blurred to the second moment of a disc."""
    sigma_px = float(DRIVE.blur_diameter(position, depth_m)) / 4 / PITCH_M
    return np.fft.ifft2(fourier_gaussian(np.fft.fft2(np.where(card(j), 1, 1 / 40)), sigma_px)).real


def dimmed(j, position, depth_m):
    """A picture of simple fractions, which is the same to the last bit on every machine."""
    return np.where(card(j), 1, 1 / 32) * (1 - position / 4)


def scene(depths_m, lens, *, full_travel=False, still=False, picture=blurred):
    """The moving card, or the card of one moment, rendered at the positions that the lens visits or at all."""
    at = AT[:1] if still else AT
    position = lens_positions(lens, FRAMES, readout_hz=SENSOR.readout_hz)
    windows = slice_windows(position, at, positions=POSITIONS)
    if full_travel or still:
        windows = [(0, POSITIONS - 1)] * len(at)
    spec = StackSpec("card", "0" * 64, ("lamp",), DRIVE, ROWS, COLUMNS, PITCH_M, POSITIONS, 16, 4)
    specs = [replace(spec, time_s=t / SENSOR.readout_hz, window=window) for t, window in zip(at, windows, strict=True)]
    depth_m = np.linspace(*depths_m, len(AT))

    def load_planes(j, first, stop):
        positions = specs[j].focus[first:stop]
        return np.array([[picture(j, position, depth_m[j]) for position in positions]], np.float32)

    def load_geometry(j):
        return np.where(card(j), depth_m[j], 0.7).astype(np.float32), card(j)

    return PlaneSource(TimeResolvedStack(at, tuple(specs)), load_planes, load_geometry, "d", "llvm")


def record(path, source, lens, **changes):
    sequence = make_sequence(**{"mean_rate": 0.3, "motion": lens, **changes})
    Recorder(SENSOR, FRAMES, device_seed=1, provenance={}).record(sequence, source, path=path, fingerprint=PLANNED)
    return saf_gen.open_stream(path)


def moment_of_mask(stream):
    """The index of the slice whose mask the stream has; no two are equal."""
    (j,) = (j for j in range(len(AT)) if np.array_equal(card(j), stream.truth.target))
    return j


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_target_fires_as_asked_at_the_moment_of_its_mask(motion, case, tmp_path):
    """In 16 readouts around that moment, within 2 %.

    There is no shot noise. The phases of 900 pixels with 5 spikes each leave 0.2 %. Where the lens crosses the focus,
    the light is measured there, up to half a pixel of the card's 30 from the mask: 1.6 %. Elsewhere the picture is that
    of the mask, at the rendered position nearest to the focus, which is up to 1/32 of the travel from the lens: 0.6 %.
    """
    depths_m, ends = CASES[case]
    lens = MOTIONS[motion](*ends)
    with record(tmp_path / "s.h5", scene(depths_m, lens), lens) as stream:
        assert np.isfinite(stream.truth.frame) == (case == "crossing")
        begin = min(max(AT[moment_of_mask(stream)] - 8, 0), FRAMES - 16)
        rate = stream.counts(begin, begin + 16)[stream.truth.target].mean() / 16
    assert rate == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("motion", ["sweep", "hand"])
def test_if_all_positions_are_rendered_the_light_is_that_at_best_focus(motion, case, tmp_path):
    """The noise-free charge of the mask's own slice, at the position of the travel that is nearest to the focus.

    The scale has 20 bits; where the lens crosses the focus, the card is up to half a pixel from the mask.
    """
    depths_m, ends = CASES[case]
    lens = MOTIONS[motion](*ends)
    source = scene(depths_m, lens, full_travel=True)
    with record(tmp_path / "s.h5", source, lens) as stream:
        charge_source = ChargeSource(source, SENSOR)
        charge_source.scale = json.loads(stream.metadata.provenance["exposure"])["scale"]
        j, position = moment_of_mask(stream), float(np.clip(stream.truth.position, 0, 1))
        charge = charge_source.charge_image(AT[j] - 0.5, position)[0, stream.truth.target].mean()
    assert charge / SENSOR.threshold_e == pytest.approx(0.3, rel=0.02 if case == "crossing" else 1e-5)


def test_a_target_that_was_in_sight_only_once_is_exposed_there(tmp_path):
    """The lens stays away from the focus, and the card is hidden at all moments but the tenth."""
    lens = {"kind": "hold", "position": 0.1}
    source = scene(CASES["not crossing"][0], lens)
    seen = replace(source, load_geometry=lambda j: (source.load_geometry(j)[0], card(j) & (j == 10)))
    with record(tmp_path / "s.h5", seen, lens) as stream:
        rate = stream.counts(AT[10] - 8, AT[10] + 8)[card(10)].mean() / 16
    assert rate == pytest.approx(0.3, rel=0.02)


RECORDED = {"sweep": ("affd647302982d60", "402ea22106c3c849"), "hand": ("1f65952a146e7c89", "d22b8279e4fc8ace")}
"""Digests of the spikes of three recordings, still and moving, as before the exposure of other sequences changed."""


@pytest.mark.slow
@pytest.mark.parametrize("motion", RECORDED)
def test_still_scenes_and_lenses_that_cross_the_focus_keep_spikes_and_fingerprint(motion, tmp_path):
    depths_m, ends = CASES["crossing"]
    lens = MOTIONS[motion](*ends)
    digests = []
    for still in (True, False):
        source, spikes = scene(depths_m, lens, still=still, picture=dimmed), []
        for light, schedule in LIGHTS.items():
            with record(tmp_path / f"{light}.h5", source, lens, schedule={"": schedule}) as stream:
                assert stream.metadata.provenance["fingerprint"] == PLANNED
            with h5py.File(tmp_path / f"{light}.h5") as file:
                spikes.append(file.attrs["spikes_sha256"])
        digests.append(hashlib.sha256("".join(spikes).encode()).hexdigest()[:16])
    assert tuple(digests) == RECORDED[motion]


@pytest.mark.parametrize(
    ("case", "changes", "still", "is_made_again"),
    [
        ("crossing", {}, False, False),
        ("not crossing", {}, False, True),
        ("not crossing", {"mean_rate": None}, False, False),
        ("not crossing", {}, True, False),
    ],
)
def test_files_of_other_spikes_are_made_again_and_no_others(case, changes, still, is_made_again, tmp_path):
    """They have the fingerprint of their plan, whether or not the lens meets the focus."""
    depths_m, ends = CASES[case]
    lens, path = MOTIONS["sweep"](*ends), tmp_path / "s.h5"
    source = scene(depths_m, lens, still=still)
    with record(path, source, lens, **changes) as stream:
        assert (stream.metadata.provenance["fingerprint"] != PLANNED) == is_made_again
        assert recording_digest(path, PLANNED) == stream.content_sha256
    assert has_recording(path, PLANNED)
    assert not has_recording(path, "1" * 64)
    with h5py.File(path, "r+") as file:
        file["provenance/fingerprint"][()] = PLANNED
    assert has_recording(path, PLANNED) != is_made_again
