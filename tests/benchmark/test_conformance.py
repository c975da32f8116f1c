"""Every registered focus measure, search and lens motion passes the conformance checks.

The package has the checks of measures and searches; test_conformance_checks.py shows that each finds its fault.
"""

import re
import sys
import tomllib
from dataclasses import is_dataclass
from pathlib import Path

import numpy as np
import pytest
from planted_sweeps import write_sweep
from refusals import refusal

from saf_gen import get_measure, get_motion, get_search
from saf_gen.benchmark.conformance import check_measure, check_search
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.core.config import registry
from saf_gen.plugins.measures import measure_names
from saf_gen.plugins.motions import lens_positions
from saf_gen.plugins.searches import search_names

PAGE = Path(__file__).parents[2] / "docs/add-a-method.md"
WARNINGS = {
    "anywhere": ["finds a bell"],  # it looks at nothing
    "elp_events": ["finds a bell"],  # as published, it answers a window early, for the lag of its filter
    "middle": ["finds a bell"],  # it looks at nothing
    "sgfs_printed": ["finds a bell"],  # the algorithm as the paper prints it stops at once
    "valley": ["finds a bell"],  # it looks for the lowest position between two peaks
}
"""Known warnings of checks for registered searches."""


def faults(results):
    return [result for result in results if result.level != "ok"]


def check_motion(motion, *, first=None):
    """Assert that a motion begins at ``first``, stays in the travel, and does not jump."""
    assert is_dataclass(motion), "it is no dataclass"
    assert motion.__dataclass_params__.frozen, "it can be changed"
    for duration in (0.5, 1.0):
        times = np.linspace(0, duration, 8001)
        times.flags.writeable = False
        position = motion.positions(times, duration)
        assert position.shape == times.shape, "it does not give a position for each time"
        assert position.dtype == np.float64, "its positions are not float64"
        assert np.isfinite(position).all(), "its positions are not finite"
        assert position.min() >= 0, "it leaves the travel"
        assert position.max() <= 1, "it leaves the travel"
        assert np.array_equal(motion.positions(times, duration), position), "the same times get another motion"
        few = motion.positions(times[5::7], duration)
        assert few == pytest.approx(position[5::7], abs=1e-12), "other readouts see another motion"
        if first is not None:
            assert position[0] == pytest.approx(first, abs=1e-9), "it does not begin where it says"
        widest, half = (np.abs(np.diff(position[::step])).max() for step in (2, 1))
        assert half <= 0.75 * widest + 1e-12, "it jumps"  # twice as many readouts should halve the steps
        assert lens_positions(motion, 800, readout_hz=800 / duration).shape == (800,)


MOTIONS = {
    "sweep": {"from": 0.9, "to": 0.2},
    "sweep_and_return": {"from": 0.1, "dwell_s": 0.1},
    "steps": {"count": 6, "natural_hz": 50.0, "damping": 0.15},
    "hand": {"reversals": True, "irregularity": 0.9, "bandwidth_hz": 8.0},
    "from_csv": {"file": {"path": "a.csv", "text": "time_s,position\n0,0.2\n0.3,0.9\n2,0.5\n"}},
    "hold": {"position": 0.4},
}
"""Options for our motions; motions of other packages are built without options."""


@pytest.mark.parametrize("name", registry.names("motions"))
def test_a_registered_motion_conforms(name):
    options = MOTIONS.get(name, {})
    check_motion(get_motion(name, **options), first=options.get("from"))


def test_every_motion_of_ours_is_tried_with_options():
    assert set(MOTIONS) == {name for name in registry.names("motions") if registry.is_builtin_name("motions", name)}


@pytest.mark.parametrize("name", measure_names())
def test_a_registered_measure_conforms(name):
    assert faults(check_measure(get_measure(name))) == []


@pytest.mark.parametrize("name", ["sd_tfi", "entropy_tfi", "gradient_code_n_tfi"])
def test_a_measure_of_textures_conforms(name):
    assert faults(check_measure(get_measure(name))) == []


@pytest.mark.parametrize("name", search_names())
@pytest.mark.slow
def test_a_registered_search_conforms(name):
    found = faults(check_search(get_search(name)))
    assert [f for f in found if f.level == "error"] == []
    assert [f.check for f in found] == WARNINGS.get(name, [])


# The code on docs/add-a-method.md, unchanged.


def code_blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.fixture
def package_of_the_page(tmp_path, monkeypatch, forget_packages):
    """Install the package that the page describes, as pip would, and unload it afterwards."""
    modules = []
    for text in code_blocks("python"):
        if not (named := re.match(r"# (\w+)\.py\n", text)):
            continue  # a file of the method in a folder
        name = named[1]
        modules.append(name)
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    project = tomllib.loads(code_blocks("toml")[0])["project"]
    info = tmp_path / "my_methods-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    groups = [
        "\n".join([f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())])
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(groups))
    monkeypatch.syspath_prepend(tmp_path)
    forget_packages()
    yield
    for name in modules:
        sys.modules.pop(name, None)


@pytest.mark.slow
def test_the_files_shown_are_complete_short_and_conform(package_of_the_page, tmp_path):
    assert all(len(text.splitlines()) <= 25 for text in code_blocks("python"))
    assert {"my_measure", "my_measure_n"} <= set(measure_names())
    assert {"my_search", "my_lens_search"} <= set(search_names())
    for name in ("my_measure", "my_measure_n"):
        assert faults(check_measure(get_measure(name))) == []
        assert get_measure(name, apart=2) != get_measure(name)
    for name in ("my_search", "my_lens_search"):
        assert faults(check_search(get_search(name))) == []
    write_sweep(tmp_path / "a.h5", 300.0)
    (record,) = evaluate(tmp_path / "a.h5", methods=["sd+my_search:window=50"]).records
    assert abs(record.judgement.frame - 300) <= 50


def test_a_package_that_cannot_be_loaded_is_reported_and_breaks_no_other(package_of_the_page, tmp_path):
    (tmp_path / "my_measure.py").write_text("import a_module_that_is_nowhere\n")
    assert {"my_measure", "sd", "er_count_n"} <= set(measure_names())
    assert "my_measure_n" not in measure_names()
    for name in ("my_measure", "my_measure_n"):
        error = refusal(get_measure, name)
        assert "'my_measure'" in error.problem
        assert "a_module_that_is_nowhere" in error.problem
        assert error.hint
