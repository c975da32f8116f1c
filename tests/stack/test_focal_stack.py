"""The store of focal stacks: keyed by content; a piece is either complete or missing."""

import json
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal

from saf_gen.core import exr
from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.stack.focal_stack import StackSpec, StackStore

SPEC = StackSpec(
    scene="plane",
    scene_digest="0" * 64,
    groups=("lamp", "room"),
    drive=ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)),
    rows=4,
    columns=6,
    pitch_m=20e-6,
    positions=3,
    samples=16,
    max_depth=4,
)


def filled(root):
    random = np.random.default_rng(1)
    store = StackStore(root, SPEC)
    radiance = random.random((2, 3, 4, 6), dtype=np.float32)
    depth = random.random((4, 6), dtype=np.float32)
    target = depth > 0.5
    for g, group in enumerate(SPEC.groups):
        store.write_group(group, radiance[g], backend="llvm")
    store.write_geometry(depth, target, backend="llvm")
    return store, radiance, depth, target


def test_what_is_stored_comes_back(tmp_path):
    store, radiance, depth, target = filled(tmp_path)
    stack = store.load()
    assert np.array_equal(stack.radiance, radiance)
    assert np.array_equal(stack.depth, depth)
    assert np.array_equal(stack.target, target)
    assert stack.backend == "llvm"


SLICE = replace(SPEC, window=(1, 2), time_s=0.5)


@pytest.mark.parametrize("brightest", [0.0, 3e-9, 1.0, 3e30])
def test_a_time_slice_is_half_floats_of_any_brightness(tmp_path, brightest):
    """Exact to 11 bits from the brightest value down to 4e-9 of it, and to 2^-40 of the brightest below that."""
    random = np.random.default_rng(1)
    radiance = (brightest * 10 ** -random.uniform(0, 8, (2, 4, 6))).astype(np.float32)
    radiance[0, 0, :3] = brightest, brightest * 1e-11, 0
    store = StackStore(tmp_path, SLICE)
    for group in SLICE.groups:
        store.write_group(group, radiance, backend="llvm")
    store.write_geometry(np.ones((4, 6)), np.ones((4, 6), bool), backend="llvm")
    back = store.load_planes(0, 2)
    assert back.dtype == np.float32
    for stored in back:
        np.testing.assert_allclose(stored, radiance, rtol=2.0**-11, atol=brightest * 2.0**-39)
    planes, facts = exr.read_planes(store.folder / "lamp.exr")
    assert planes["focus.0001"].dtype == np.float16
    assert facts["unit"] == f"2^{facts['exponent']} W m^-2 sr^-1 at gain 1"
    assert np.array_equal(planes["focus.0002"].astype(float) * 2.0 ** int(facts["exponent"]), back[0, 1])


def test_a_piece_says_which_drive_it_was_seen_through(tmp_path):
    store, *_ = filled(tmp_path)
    drive = {"kind": "image_distance", "focal_length_m": 0.025, "f_number": 2.0}
    drive |= {"focus_range_m": [0.6, 0.42], "transmission": 1.0}
    assert json.loads(exr.read_planes(store.folder / "lamp.exr")[1]["drive"]) == drive
    assert json.loads((store.folder / "lamp.json").read_text())["spec"]["drive"] == drive


def test_pieces_are_missing_until_they_are_there(tmp_path):
    store = StackStore(tmp_path, SPEC)
    assert store.missing_pieces() == ["geometry", "lamp", "room"]
    store.write_group("lamp", np.zeros((3, 4, 6)), backend="llvm")
    assert StackStore(tmp_path, SPEC).missing_pieces() == ["geometry", "room"]


def test_a_damaged_piece_counts_as_missing(tmp_path):
    store, *_ = filled(tmp_path)
    path = store.folder / "lamp.exr"
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(content)
    assert store.missing_pieces() == ["lamp"]
    path.write_bytes(content[:100])
    assert store.missing_pieces() == ["lamp"]
    note = store.folder / "room.json"
    note.write_text(note.read_text()[:50])
    assert store.missing_pieces() == ["lamp", "room"]


def test_a_stack_that_lacks_a_piece_is_refused(tmp_path):
    store, *_ = filled(tmp_path)
    (store.folder / "room.exr").unlink()
    error = refusal(store.load)
    assert "room" in error.problem
    assert "saf-gen generate" in error.hint


def test_damaged_geometry_is_not_read(tmp_path):
    store, *_ = filled(tmp_path)
    path = store.folder / "geometry.exr"
    content = bytearray(path.read_bytes())
    content[28] = 255  # in its header, which may crash OpenEXR
    path.write_bytes(content)
    assert "geometry" in refusal(store.load_geometry).problem


def test_the_digest_sees_the_values_of_a_piece(tmp_path):
    store, *_ = filled(tmp_path)
    before = store.digest()
    assert StackStore(tmp_path, SPEC).digest() == before
    store.write_group("lamp", np.ones((3, 4, 6)), backend="llvm")
    assert store.digest() != before


def test_a_stack_made_by_two_backends_says_so(tmp_path):
    store, radiance, *_ = filled(tmp_path)
    store.write_group("lamp", radiance[0], backend="scalar")
    assert store.load().backend == "llvm, scalar"


@pytest.mark.parametrize(
    "change",
    [
        {"scene_digest": "1" * 64},
        {"samples": 17},
        {"positions": 4},
        {"pitch_m": 10e-6},
        {"drive": ImageDistanceDrive(0.025, 2.8, (0.6, 0.42))},
        {"drive": FocalLengthDrive(0.025, 2.0, (0.6, 0.42))},  # the same numbers, another drive
        {"drive": Stage(0.025, 2.0, 0.05, (0.0, 0.1))},
        {"groups": ("lamp",)},
        {"window": (0, 2)},  # the same positions, as half floats
    ],
)
def test_the_key_sees_everything_that_changes_a_stack(change):
    assert replace(SPEC, **change).key != SPEC.key


def test_stacks_of_few_positions_state_the_version_of_their_layers_and_earlier_ones_are_read(tmp_path):
    """Stacks of many positions, and plain ones, have no layers; earlier stacks state no version."""
    many, plain = replace(SPEC, positions=17), replace(SPEC, estimator="plain")
    slice_of_many = replace(many, window=(3, 5))
    for spec in (many, plain, replace(many, window=(0, 16))):
        assert replace(spec, layers=1).key == spec.key
    for spec in (SPEC, slice_of_many):
        earlier = replace(spec, layers=1)
        assert "layers" not in earlier.as_dict()
        assert earlier.key != spec.key
        for stored in (earlier, spec):
            StackStore(tmp_path, stored).write_geometry(
                np.ones((4, 6), np.float32), np.ones((4, 6), bool), backend="llvm"
            )
            assert StackSpec.read(tmp_path, stored.key) == stored
