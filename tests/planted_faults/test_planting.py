"""Faults reach every importer, and a fault that would change nothing is refused."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from planting import Change, NotPlantedError, Planter, changed_sources

TWICE = Change("core.seeds", "return int.from_bytes(", "return 2 * int.from_bytes(")


def test_a_fault_reaches_every_module_that_imported_the_name(tmp_path):
    """Through ``from x import y`` and as an attribute, in another process, where nothing is imported yet."""
    code = """
from planting import Change, Planter, changed_sources
import json
source = changed_sources([Change("core.seeds", "return int.from_bytes(", "return 2 * int.from_bytes(")])
planter = Planter(source)
planter.install()
from saf_gen.camera import encoder
from saf_gen.core import seeds
from saf_gen.generate import resolve
print(json.dumps([
    encoder.derive_seed is seeds.derive_seed, resolve.seeds.derive_seed("a"), seeds.derive_seed("a"), seeds.__file__,
    sorted(planter.planted),
]))
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, capture_output=True, text=True)
    same, by_attribute, faulty, file, planted = json.loads(done.stdout)
    from saf_gen.core import seeds

    assert same
    assert by_attribute == faulty == 2 * seeds.derive_seed("a")
    assert file == seeds.__file__
    assert planted == ["saf_gen.core.seeds"]


def test_changes_of_one_module_add_up():
    other = Change("core.seeds", ">> 1", ">> 2")
    (name, source), *rest = changed_sources([TWICE, other]).items()
    assert (name, rest) == ("saf_gen.core.seeds", [])
    assert "return 2 * int.from_bytes(_digest(name)[:8], " in source
    assert source.count(">> 2") == 1
    assert set(changed_sources([Change("render", "todo = [", "todo = [] and [")])) == {"saf_gen.render"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("return float.from_bytes(", "return 0 *", "no longer contains 'return float.from_bytes('"),
        ("a seed for a compiled kernel", "no seed at all", "changes no code"),
        ("return int.from_bytes(", "return int.from_bytes(  # planted\n        ", "changes no code"),
        ("def make_generator", "def make_generator", "changes no code"),
    ],
)
def test_a_fault_that_changes_nothing_is_not_planted(old, new, message):
    with pytest.raises(NotPlantedError, match=r"saf_gen\.core\.seeds") as caught:
        changed_sources([Change("core.seeds", old, new)])
    assert message in str(caught.value)


def test_a_fault_that_comes_too_late_is_not_planted():
    import saf_gen.core.seeds  # noqa: F401

    with pytest.raises(NotPlantedError, match=r"saf_gen\.core\.seeds was imported before"):
        Planter(changed_sources([TWICE])).install()
    assert not any(isinstance(finder, Planter) for finder in sys.meta_path)
