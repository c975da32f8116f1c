"""The recipe `variety`: each feature that it states is in what is recorded."""

import json

import numpy as np
import pytest
import yaml
from written_scenes import needs_llvm

import saf_gen
from saf_gen.generate.recipe import find_recipe

CAMERAS = ("davis346", "qvga_spad", "imx273")


@pytest.mark.long
@pytest.mark.slow
@needs_llvm
def test_each_feature_of_variety_is_in_its_recordings(tmp_path, call):
    """Lens, lamps, exposure and cameras are as stated there; recordings are shorter, with fewer light paths."""
    recipe = yaml.safe_load(find_recipe("variety").read_text())
    recipe["camera"]["frames"] = 800
    recipe["render"] |= {"samples": 4, "slice_samples": 4}
    path, folder = tmp_path / "short.yaml", tmp_path / "variety"
    path.write_text(yaml.safe_dump(recipe))
    code, _, error = call("generate", path, "--out", folder)
    assert code == 0, error
    for dataset in (folder, *(folder / "cameras" / name for name in CAMERAS)):
        assert "4 of 4 sequences are intact" in call("verify", dataset)[1]

    truths, lenses, drives = [], [], []
    for file in ("file/neon_signs-led-00", "ring/gears-dusk-00", "moving/fabric-dynamic-led-00"):
        with saf_gen.open_stream(folder / f"{file}.h5") as stream:
            truth, provenance = stream.truth, stream.metadata.provenance
            assert truth.known
            # The light is that of the scene's lamps, through the lens at the recipe's f-number, and exposes the sensor.
            assert json.loads(provenance["exposure"])["scale"] == 1
            drives.append(json.loads(provenance["lens"])["drive"])
            assert drives[-1]["f_number"] == 2
            assert 0.03 < stream.counts(0, 800)[truth.target > 0].mean() / 800 < 0.3
            # Aberrations, or light of two lamps, part the sharpest texture from the least blur.
            assert truth.least_blur != pytest.approx(truth.position, abs=1e-4)
            truths.append(truth)
            lenses.append(truth.lens)
            told = np.asarray(stream.focus_position)
            if "dusk" in file:
                assert stream.light_names[:2] == ("lamp 1 (daylight 6504 K)", "lamp 2 (tungsten)")
    # The lenses are those of the cards: one read from a file, one behind a ring, one with aberrations.
    fitted, ring, bent = drives
    assert fitted["kind"] == "lens_file"
    assert len(fitted["wavefront"]["starts"]) == 70
    assert ring["ring"] == {"radius_m": 0.01, "distance_m": 0.08}
    assert bent["wavefront"]["spherical_m"] > 0
    assert bent["wavefront"]["field_curvature_m"] > 0
    assert (ring["distortion"]["share"], bent["distortion"]["share"]) == (-0.01, -0.015)
    assert (fitted["veiling_glare"], ring["veiling_glare"]) == (0.01, 0.02)
    # The actuator has hysteresis, so that the lens is lower on the way up. It rings: its speed swings about the mean.
    rises, middle = np.arange(800) < 400, (told > 0.3) & (told < 0.7)
    below, above = ((lenses[0] - told)[middle & way].mean() for way in (rises, ~rises))
    assert below < -0.03
    assert above > 0.03
    speed = np.diff(lenses[0])[middle[1:] & rises[1:]] / np.diff(told)[middle[1:] & rises[1:]].mean()
    assert speed.min() < 0.7
    assert speed.max() > 1.3
    assert all(np.array_equal(lens, lenses[0]) for lens in lenses)
    # The lens has axial colour: the focus moves as daylight fades, towards that of the red light of bulbs.
    still, dusk, moving = truths
    assert still.track is None
    assert dusk.track[-1] > dusk.track[0] + 0.005
    # Something moves in the moving scene alone.
    assert np.ptp(moving.track) > 1e-5

    for split, name in (("file", "neon_signs-led-00"), ("moving", "fabric-dynamic-dusk-00")):
        events, photons, frames = (folder / "cameras" / camera / split / f"{name}.h5" for camera in CAMERAS)
        with saf_gen.open_events(events) as stream:
            assert stream.counts(0, 0.04).sum() > 5_000
        with saf_gen.open_stream(photons) as stream:
            assert stream.counts(0, stream.shape[0]).mean() / stream.shape[0] == pytest.approx(0.4, abs=0.2)
        with saf_gen.open_frames(frames) as stream:
            assert stream.shape == (26, 128, 128)
