"""Bodies of the kit are closed, face outwards and have the right volume; its text is set and inked right."""

import importlib.util

import numpy as np
import pytest

from saf_gen.scene.scene_folder import kit_modules


def kit(name):
    spec = importlib.util.spec_from_file_location(name, kit_modules()[name])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


solids, clay, typeface = kit("solids"), kit("clay"), kit("typeface")
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


@pytest.fixture
def blocks(tmp_path):
    """A typeface of em 100: A is a block 60 wide and 70 high, B a disc of diameter 80; A and B are kerned by -20."""
    disc = [[40, 0], [0, 0], [0, 40], [0, 80], [40, 80], [80, 80], [80, 40], [80, 0]]
    np.savez(
        tmp_path / "blocks.npz",
        em=100,
        heights=[70, 50, 80, -20],
        characters=[32, 65, 66],
        advances=[25, 60, 80],
        points=np.array([[0, 0], [0, 70], [60, 70], [60, 0], *disc], dtype=np.int16),
        on_curve=np.array([True] * 4 + [True, False] * 4),
        ends=[4, 12],
        contours=np.array([0, 1, 1], dtype=np.uint8),
        left=np.array([1], dtype=np.uint8),
        right=np.array([2], dtype=np.uint8),
        kern=np.array([-20], dtype=np.int16),
    )
    return typeface.Typeface(tmp_path / "blocks.npz")


def test_ink_is_the_share_of_a_pixel_that_is_covered():
    """Against a picture sixteen times as fine in both directions; triangles overlap, and leave the picture."""
    corners = np.random.default_rng(1).uniform(-4, 24, (40, 3, 2))
    turn = corners[:, 1:] - corners[:, :1]
    clockwise = turn[:, 0, 0] * turn[:, 1, 1] < turn[:, 0, 1] * turn[:, 1, 0]
    triangles = [corner[::-1] if flip else corner for corner, flip in zip(corners, clockwise, strict=True)]
    one, finer = typeface.ink(triangles[:1], (20, 16)), typeface.ink(triangles[:1], (320, 256), scale=16)
    assert one == pytest.approx(finer.reshape(20, 16, 16, 16).mean((1, 3)), abs=2e-6)
    fine = typeface.ink(triangles, (1280, 1024), scale=64) > 0.5
    assert np.abs(typeface.ink(triangles, (20, 16)) - fine.reshape(20, 64, 16, 64).mean((1, 3))).mean() < 0.01
    assert typeface.ink([], (2, 3)).tolist() == [[0, 0, 0], [0, 0, 0]]


def test_a_letter_has_its_place_and_its_area(blocks):
    ink = typeface.ink(blocks.line("A", (3, 90), size=100), (100, 100))
    assert ink.sum() == pytest.approx(60 * 70)
    assert ink[20:90, 3:63].min() == 1
    disc = typeface.ink(blocks.line("B", (97, 90), size=100, align="right"), (100, 100))
    assert disc[10:90, 17:97].sum() == disc.sum() == pytest.approx(4 * 40**2 * 5 / 6, rel=1e-3)  # four parabolas


def test_a_line_is_kerned_aligned_and_justified(blocks):
    assert blocks.width("AB BA", size=10) == pytest.approx(6 - 2 + 8 + 2.5 + 8 + 6)
    assert blocks.width("AA", size=10, tracking=0.1) == pytest.approx(13)
    ends = [points[:, 0].max() for points in blocks.line("A A A", (5, 0), size=10, measure=40)]
    assert ends == pytest.approx([11, 28, 45])
    middle = np.concatenate(blocks.line("A A", (0, 0), size=10, align="centre"))[:, 0]
    assert middle.min() == pytest.approx(-middle.max())


def test_a_paragraph_keeps_its_words_and_its_measure(blocks):
    text = " ".join("A" * (1 + k % 3) for k in range(40))
    lines = blocks.paragraph(text, size=10, measure=100, indent=7)
    assert " ".join(line.text for line in lines) == text
    assert [line.indent for line in lines] == [7] + [0] * (len(lines) - 1)
    assert [line.ends for line in lines] == [False] * (len(lines) - 1) + [True]
    assert all(blocks.width(line.text, size=10) + line.indent <= 100 for line in lines)
    set_ = np.concatenate(blocks.column(lines[:-1], (2, 0), size=10, measure=100, leading=12))
    assert set_[:, 0].max() == pytest.approx(102)
    assert set_[:, 1].max() == pytest.approx(12 * (len(lines) - 2))
    assert [line.text for line in blocks.paragraph("AAAA A", size=10, measure=20)] == ["AAAA", "A"]
