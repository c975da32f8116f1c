"""Scenes drawn at random that move: targets two largest blurs wide, movements within 60 pixels a second."""

import numpy as np
import pytest
from written_scenes import SensorGrid

from saf_gen.render import make_renderer
from saf_gen.render.mitsuba_scene import validate_motions

FORMS = {"flat", "slanted", "relief", "ball", "column", "two_depths", "cluttered"}
PIXELS, PITCH_M, WAVE_M = 128, 20e-6, 555e-9  # for which the scene is drawn
MAX_SPEED = 60.0  # pixels a second, and time slices


def sight_and_target(modules, member, number):
    """What the lens of a member sees, and a target of it, without its texture."""
    params = member.script_params
    seen = modules["sight"].look(params["lens"], params["place_deg"])
    return seen, modules["targets"].target(params, seen, np.random.default_rng(number))


@pytest.mark.slow
def test_every_target_is_two_largest_blurs_wide_over_the_whole_travel(family, modules):
    """The law by the lens's own drive, over 200 members of the seed "law"; those of the longest travels included."""
    beyond, forms = 0, set()
    for n in range(200):
        member = family.draw_member("law", n)
        seen, target = sight_and_target(modules, member, n)
        positions = np.linspace(0, 1, 101)
        blurs = member.build_drive().blur_diameter(positions, seen.away / 1e3) / PITCH_M
        assert modules["targets"].largest_blur_px(member.script_params["lens"], seen) == pytest.approx(blurs.max())
        assert 2 * blurs.max() <= min(target.size) * (1 + 1e-9)
        assert target.depth <= modules["scene"].MAX_DEPTH
        for centre, size in zip(target.centre, target.size, strict=True):  # it is in the frame, or covers it
            assert abs(centre) <= abs(PIXELS - size) / 2 + 1e-9
        beyond += min(target.size) > PIXELS
        forms.add(member.params["form"])
    assert 0 < beyond < 200
    assert forms == FORMS


def test_a_missing_corner_counts_by_what_the_frame_shows_of_it(family, modules):
    member = family.draw_member("notch", 1).with_params({"form": "two_depths", "lens": "fast_50mm_91"})
    for n in range(20):
        _, target = sight_and_target(modules, member, n)
        if target.notch.any():
            break
    notch = np.zeros_like(target.notch)
    assert modules["targets"].notched(target._replace(notch=notch)) == 0
    assert modules["targets"].notched(target._replace(notch=~notch)) == 1
    notch[:, notch.shape[1] // 2 :] = True
    half = target._replace(notch=notch, centre=(0.0, 0.0))
    assert modules["targets"].notched(half) == pytest.approx(0.5, abs=0.05)


def test_travels_are_those_that_the_names_of_the_lenses_say(family):
    travels = []
    for name, lens in family.card.lenses.items():
        low, high = lens.build_drive().depth_of_focus(0.5, PITCH_M, wavelength_m=WAVE_M)
        travels.append(1 / (high - low))
        assert travels[-1] == pytest.approx(int(name.rsplit("_", 1)[1]), abs=0.6), name
    assert min(travels) >= 10
    assert max(travels) <= 100
    assert sum(travel <= 15 for travel in travels) >= 6
    assert sum(travel > 40 for travel in travels) >= 10


@pytest.mark.slow
def test_movements_keep_to_sixty_pixels_a_second_and_each_kind_is_drawn(family, modules):
    """The speed of every point of the target in the picture in focus, over 100 members of the seed "speed"."""
    kinds, backgrounds = set(), set()
    for n in range(100):
        member = family.draw_member("speed", n)
        seen, target = sight_and_target(modules, member, n)
        found = validate_motions(modules["movements"].movements(member.script_params, seen, target), "scene.py")
        kinds.add(member.params["motion"])
        backgrounds.add(tuple(sorted(found)))
        drive = member.build_drive()
        image = float(drive.image_distance(seen.place))
        points = {"target": target.body(seen).vertices[::7] / 1e3}
        for name in ("things", "wall"):
            points[name] = seen.at(*np.array([[-60, 60, 0], [60, -60, 0]]), 0.0) / 1e3  # no nearer than the target
        fastest = 0.0
        for name, motion in found.items():
            assert np.allclose(motion.pose_at(family.card.still_s), np.eye(4), atol=1e-9)  # at rest as without motion

            def in_picture(time_s, points=points[name], motion=motion, seen=seen, image=image):
                pose = motion.pose_at(time_s)
                x, y, z = (points @ pose[:3, :3].T + pose[:3, 3]).T
                return np.stack([x, y]) * image / PITCH_M / (-z - (seen.away - seen.focused) / 1e3)

            for time_s in np.linspace(0, 0.999, 41):
                moved = in_picture(time_s + 1e-4) - in_picture(time_s)
                fastest = max(fastest, float(np.hypot(*moved).max()) / 1e-4)
        assert 0.5 < fastest <= min(1.1 * member.params["speed_px_s"], MAX_SPEED, family.card.slices_per_s)
    assert kinds == {"shift", "turn", "tremble"}
    assert backgrounds == {("target",), ("target", "things", "wall")}


@pytest.mark.slow
def test_a_shift_stays_within_the_travel_of_the_lens(family, modules):
    for n in range(40):
        member = family.draw_member("travel", n).with_params({"motion": "shift"})
        seen, target = sight_and_target(modules, member, n)
        motion = validate_motions(modules["movements"].movements(member.script_params, seen, target), "")["target"]
        for time_s in np.linspace(0, 1, 11):
            away = seen.away / 1e3 - motion.shift_at(time_s)[2]
            assert 0 <= float(member.build_drive().best_position(away)) <= 1


@pytest.mark.slow
def test_members_move_and_their_motion_leaves_them_at_rest_as_they_are(family):
    assert family.card.slices_per_s <= MAX_SPEED
    member = family.draw_member("rest", 3)
    grid = SensorGrid(rows=24, columns=24, pitch_m=PIXELS * PITCH_M / 24)
    frame, pictures = (slice(0, 24), slice(0, 24)), {}
    for motion in ("shift", "tremble"):
        one = member.with_params({"motion": motion, "speed_px_s": 50.0})
        renderer = make_renderer(one, grid, backend_name="scalar")
        for time_s in (None, 0.9):
            pictures[motion, time_s] = renderer.render_region(0.5, samples=4, region=frame, time_s=time_s)
    assert np.array_equal(pictures["shift", None], pictures["tremble", None])
    assert not np.array_equal(pictures["shift", 0.9], pictures["shift", None])
    assert not np.array_equal(pictures["tremble", 0.9], pictures["tremble", None])
