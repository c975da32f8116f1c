"""The description of the machine that `saf-gen doctor` prints."""

import sys

from saf_gen.acceptance.speed.machine_check import describe_machine_to_bench


def test_versions_cores_and_variant_are_named():
    described, _ = describe_machine_to_bench()
    assert described["mitsuba"] == "3.9.1"
    assert described["variant"] in ("cuda", "llvm", "scalar")
    assert "usable of" in described["cores"]


def test_a_machine_without_a_renderer_is_told_what_to_install(monkeypatch):
    for name in [m for m in sys.modules if m.startswith("saf_gen.render")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    described, advice = describe_machine_to_bench()
    assert described["variant"].startswith("none: rendering needs the package mitsuba; ")
    assert advice == ["to render: pip install 'saf-gen[render]'"]
