"""Plug-ins are found by name."""

import os
import subprocess
import sys

import pytest
from refusals import assert_says, refusal

from saf_gen.core.config import registry


def test_the_names_of_a_kind_are_those_of_its_files_without_helpers():
    assert {"constant", "ramp", "steps", "sine"} <= set(registry.names("lights"))
    assert not any(name.startswith("_") for kind in registry.PLUGIN_KINDS for name in registry.names(kind))


def test_a_trailing_underscore_is_not_part_of_a_key():
    assert registry.option_fields("lights", "ramp") == {"from": "from_", "to": "to", "over_s": "over_s"}


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("rampp", {}, "'rampp' | mean 'ramp"),
        ("ramp", {"form": 1}, "'ramp': 'form' | from, over_s, to | 'from'"),
        ("ramp", {"to": 2}, "light schedule 'ramp' | missing | from, to, over_s"),
    ],
)
def test_an_unknown_name_or_key_and_a_missing_key_are_refused(name, options, message):
    assert_says(refusal(registry.build_plugin, "lights", name, **options), message)


REFUSES = '''\
from dataclasses import dataclass


@dataclass(frozen=True)
class Fussy:
    """Accepts only a count of one."""

    count: int = 1

    def __post_init__(self):
        if self.count == 2:
            raise ValueError("two is\\ntoo many")
        if self.count == 3:
            raise RuntimeError("three")
'''


def test_a_value_that_a_users_plug_in_refuses_is_one_line(tmp_path):
    (tmp_path / "fussy.py").write_text(REFUSES)
    name = f"{tmp_path / 'fussy.py'}:Fussy"
    for count, message in ((2, "ValueError: two is too many"), (3, "RuntimeError: three")):
        error = refusal(registry.build_plugin, "searches", name, count=count)
        assert_says(error, f"search '{name}' with count={count}: {message}; give values that it accepts, or repair it")
    assert registry.build_plugin("searches", name).count == 1


BREAKS = {
    "raises": ("raise RuntimeError('no driver\\nfound')", "RuntimeError: no driver found"),
    "unfinished": ("Part = ", "SyntaxError: invalid syntax"),
    "empty": ("other = 1", "AttributeError: module 'empty_of_a_test' has no attribute 'Part'"),
}


@pytest.mark.slow
def test_a_package_that_breaks_as_it_is_loaded_hides_no_other(tmp_path):
    """The package is installed as pip would install it, and offers three searches."""
    info = tmp_path / "theirs_of_a_test-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: theirs-of-a-test\nVersion: 0.1\n")
    offered = "".join(f"{name} = {name}_of_a_test:Part\n" for name in BREAKS)
    (info / "entry_points.txt").write_text(f"[saf_gen.searches]\n{offered}")
    for name, (text, _) in BREAKS.items():
        (tmp_path / f"{name}_of_a_test.py").write_text(text)

    def call(*words):
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path]), "COLUMNS": "400"}
        command = [sys.executable, "-m", "saf_gen", *words]
        return subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)

    listed = call("methods", "list")
    assert (listed.returncode, listed.stderr) == (0, "")
    assert "sgfs_causal" in listed.stdout
    lines = listed.stdout.splitlines()
    for name, (_, message) in BREAKS.items():
        (line,) = (line for line in lines if line.split()[:1] == [name])
        assert f"search '{name}' of the entry point '{name}_of_a_test:Part' cannot be loaded: {message}" in line
    shown = call("methods", "show", "sd+raises")
    assert (shown.returncode, shown.stderr.count("\n")) == (2, 1)
    assert f"cannot be loaded: {BREAKS['raises'][1]}" in shown.stderr
