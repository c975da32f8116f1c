"""Plug-ins are found by name."""

import sys
from importlib.metadata import EntryPoint

import pytest
from refusals import assert_says, refusal

from saf_gen.core.config import registry
from saf_gen.errors import BadInput


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


@pytest.mark.parametrize(
    ("module", "message"),
    [
        ("raise RuntimeError('no driver\\nfound')", "RuntimeError: no driver found"),
        ("Part = ", "SyntaxError: invalid syntax"),
        ("other = 1", "AttributeError: module 'theirs_of_a_test' has no attribute 'Part'"),
    ],
)
def test_a_package_that_breaks_as_it_is_loaded_hides_no_other(tmp_path, monkeypatch, call, module, message):
    (tmp_path / "theirs_of_a_test.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    offered = {"theirs": EntryPoint("theirs", "theirs_of_a_test:Part", "saf_gen.searches")}
    monkeypatch.setattr(registry, "_entry_points", lambda kind: offered if kind == "searches" else {})
    try:
        with pytest.raises(BadInput, match=rf"search 'theirs' of the entry point .* cannot be loaded: {message}"):
            registry.plugin_class("searches", "theirs")
        code, listed, _ = call("methods", "list")
    finally:
        sys.modules.pop("theirs_of_a_test", None)
    assert code == 0
    assert "cannot be loaded" in listed
    assert "sgfs_causal" in listed
