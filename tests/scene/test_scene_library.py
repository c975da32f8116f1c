"""Bodies of the scene library: closed, facing outwards, and of the right volume."""

import importlib.util

import numpy as np
import pytest

from saf_gen.scene.library import library_module


def library(name):
    spec = importlib.util.spec_from_file_location(name, library_module(name))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


solids, clay = library("solids_1"), library("clay_1")
LINE = np.linspace([0, 0, 0], [1, 2, 2], 9)  # 3 long
BALL = 4 / 3 * np.pi


def volume(vertices, triangles):
    """The volume by the divergence theorem: negative for a body that faces inwards, wrong for one with a hole."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (solids.box((1, 2, 3), (2, 4, 6)), 6.0),
        (solids.ball((5, 0, 0), (1, 2, 3), rings=64, around=128), 6 * BALL),
        (solids.turned([(0, 0), (1, 0), (1, 2), (0, 2)], around=256), 2 * np.pi),
        (solids.placed(solids.box((0, 0, 0), (1, 1, 1)), (3, 0, 0), scale=(-1, 2, 1)), 2.0),
        (solids.placed(solids.box((0, 0, 0), (1, 1, 1)), turn=solids.turning([1, 2, 3], 40)), 1.0),
    ],
    ids=["box", "ball", "turned", "mirror", "turn"],
)
def test_a_body_has_its_volume(body, expected):
    assert volume(body.vertices, body.triangles) == pytest.approx(expected, rel=2e-3)


def test_a_tube_is_a_rod_with_rounded_ends():
    """The volume of the ends is between those of inscribed cones and of half balls."""
    body = solids.tube(LINE, 0.1, around=200)
    rod = 3 * np.pi * 0.1**2
    assert rod + 2 / 3 * np.pi * 0.1**3 < volume(body.vertices, body.triangles) < rod + BALL * 0.1**3


def test_turning_is_counter_clockwise():
    assert solids.turning([0, 0, 1], 90) @ [1, 0, 0] == pytest.approx([0, 1, 0])


def test_clay_is_added_and_cut_away():
    """On a grid of a twentieth of the radius: a ball, a separate hollow ball, and a limb."""
    made = clay.Clay((-1.2, -1.2, -1.2), (6.2, 1.2, 1.2), cell=0.05)
    made.ball((0, 0, 0), 1.0, blend=0.01)
    assert volume(*made.mesh()) == pytest.approx(BALL, rel=0.01)
    made.ball((2.5, 0, 0), (1, 1, 1), blend=0.01)
    made.ball((2.5, 0, 0), 0.5, blend=0.01, cut=True)
    assert volume(*made.mesh()) == pytest.approx(1.875 * BALL, rel=0.01)
    made.limb([(4.5, 0, 0, 0.5), (5.5, 0, 0, 0.5)], blend=0.01)
    assert volume(*made.mesh()) == pytest.approx(1.875 * BALL + 0.25 * np.pi + BALL / 8, rel=0.01)


def test_clay_melts_together():
    """Two balls that nearly touch: a wide blend bridges the gap, and adds clay only there."""
    volumes = {}
    for blend in (0.01, 0.8):
        made = clay.Clay((-1.2, -1.2, -1.2), (3.5, 1.2, 1.2), cell=0.05)
        made.ball((0, 0, 0), 1.0, blend=blend)
        made.ball((2.1, 0, 0), 1.0, blend=blend)
        volumes[blend] = volume(*made.mesh())
        assert (made.field[round(2.25 / 0.05), round(1.2 / 0.05), round(1.2 / 0.05)] < 0) == (blend > 0.1)
    assert 2 * BALL < volumes[0.8] < 2.1 * BALL
