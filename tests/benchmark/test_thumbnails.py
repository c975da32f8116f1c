import numpy as np

import saf_gen
from saf_gen.benchmark.thumbnails import MAX_WIDTH_PX, THUMBNAIL_COUNT, make_thumbnails, select_to_show
from saf_gen.benchmark.view.recording import WindowCounts


def stream_of(frames, tmp_path):
    saf_gen.write_stream(tmp_path / "a.h5", frames)
    return saf_gen.open_stream(tmp_path / "a.h5")


def test_pictures_count_the_spikes_of_windows_side_by_side(tmp_path):
    frames = (np.random.default_rng(1).random((500, 12, 16)) < 0.3).astype(np.uint8)
    with stream_of(frames, tmp_path) as stream:
        made = make_thumbnails(stream, (slice(3, 9), slice(4, 16)))
        expected = WindowCounts(stream).intervals(470, 480)
    np.testing.assert_allclose(made.textures[47], expected, rtol=1e-6)
    np.testing.assert_array_equal(made.spikes[[0, 47]], frames[[5, 475]])
    assert made.images.shape == (THUMBNAIL_COUNT, 12, 16)
    assert made.window == 500 // THUMBNAIL_COUNT == 10
    np.testing.assert_array_equal(made.images[1], frames[10:20].sum(axis=0))
    np.testing.assert_array_equal(made.images[47], frames[470:480].sum(axis=0))
    assert made.frames[:2].tolist() == [4.5, 14.5]
    assert made.box == (0.25, 0.25, 0.75, 1.0)


def test_a_short_recording_has_fewer_pictures_and_a_wide_sensor_smaller_ones(tmp_path):
    frames = (np.random.default_rng(2).random((5, 7, 2 * MAX_WIDTH_PX + 1)) < 0.5).astype(np.uint8)
    with stream_of(frames, tmp_path) as stream:
        made = make_thumbnails(stream, None)
    assert made.images.shape == (5, 2, 267)
    assert made.binning == 3
    assert made.images[3, 1, 2] == frames[3, 3:6, 6:9].sum()
    assert made.box == (0, 0, 1, 1)


def test_what_is_shown_of_many_covers_scenes_and_conditions():
    keys = [(scene, light) for scene in "abcd" for light in "uvw" for _ in range(2)]
    shown = select_to_show(keys, 4)
    assert shown == sorted(shown)
    assert {keys[i][0] for i in shown} == set("abcd")
    assert {keys[i][1] for i in shown} == set("uvw")
    assert select_to_show(keys, 99) == list(range(0, 24, 2))  # the first repeat of each
    assert select_to_show(keys, 0) == []
    assert select_to_show([], 5) == []
