"""Parts are found by name."""

import sys
from importlib.metadata import EntryPoint

import pytest
from refusals import assert_says, refusal

from saf_gen.cli import main
from saf_gen.core.config import registry
from saf_gen.errors import BadInput


def test_listing_a_room_names_its_files_and_no_helpers():
    assert {"constant", "ramp", "steps", "sine"} <= set(registry.names("lights"))
    assert not any(name.startswith("_") for room in registry.PLUGIN_KINDS for name in registry.names(room))


def test_every_registered_part_is_one_dataclass_with_a_docstring():
    for room in registry.PLUGIN_KINDS:
        for name in registry.names(room):
            assert registry.plugin_class(room, name).__doc__, f"{room}/{name}"


def test_a_trailing_underscore_is_no_part_of_a_key():
    assert registry.registered_option_fields("lights", "ramp") == {"from": "from_", "to": "to", "over_s": "over_s"}


def test_an_unknown_part_is_told_with_the_nearest():
    assert_says(refusal(registry.build_plugin, "lights", "rampp"), "'rampp' | mean 'ramp")


def test_an_unknown_key_is_told_with_the_nearest():
    assert_says(refusal(registry.build_plugin, "lights", "ramp", form=1), "'ramp': 'form' | from, over_s, to | 'from'")


def test_a_missing_key_is_told_with_the_keys():
    assert_says(
        refusal(registry.build_plugin, "lights", "ramp", to=2), "light schedule 'ramp' | missing | from, to, over_s"
    )


REFUSES = '''\
from dataclasses import dataclass


@dataclass(frozen=True)
class Fussy:
    """Takes one, and says so in its own way."""

    count: int = 1

    def __post_init__(self):
        if self.count == 2:
            raise ValueError("two is\\ntoo many")
        if self.count == 3:
            raise RuntimeError("three")
'''


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"count": 2}, r"with count=2: ValueError: two is too many; give values that it takes, or repair it"),
        ({"count": 3}, r"with count=3: RuntimeError: three; give values"),
    ],
)
def test_a_value_that_somebodys_part_refuses_is_told_in_one_line(tmp_path, options, told):
    (tmp_path / "fussy.py").write_text(REFUSES)
    name = f"{tmp_path / 'fussy.py'}:Fussy"
    with pytest.raises(BadInput, match=rf"search '.*fussy\.py:Fussy' {told}"):
        registry.build_plugin("searches", name, **options)
    assert registry.build_plugin("searches", name).count == 1


@pytest.mark.parametrize(
    ("module", "told"),
    [
        ("raise RuntimeError('no driver\\nfound')", "RuntimeError: no driver found"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("Part = ", "SyntaxError: invalid syntax"),
        ("other = 1", "AttributeError: module 'theirs_of_a_test' has no attribute 'Part'"),
    ],
)
def test_a_package_that_breaks_as_it_is_loaded_hides_no_other(tmp_path, monkeypatch, capsys, module, told):
    (tmp_path / "theirs_of_a_test.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    offered = {"theirs": EntryPoint("theirs", "theirs_of_a_test:Part", "saf_gen.searches")}
    monkeypatch.setattr(registry, "_offered", lambda room: offered if room == "searches" else {})
    try:
        with pytest.raises(BadInput, match=rf"search 'theirs' of the entry point .* cannot be loaded: {told}"):
            registry.plugin_class("searches", "theirs")
        with pytest.raises(SystemExit) as ended:
            main(["methods"])
    finally:
        sys.modules.pop("theirs_of_a_test", None)
    assert ended.value.code in (0, None)
    listed = capsys.readouterr().out
    assert "cannot be loaded" in listed
    assert "sgfs_causal" in listed
