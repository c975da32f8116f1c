"""A tenth of the paper's grid at full size: every tenth sequence of recipes/paper.yaml, in minutes."""

from dataclasses import replace

import pytest

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.render import backend
from saf_gen.stream.manifest import read_manifest, verify_entry

METHODS = ["sd+argmax", "sd_code+sgfs_code", "sd_calibrated+photon_aware", "er_count+argmax"]
pytestmark = pytest.mark.long


@pytest.mark.skipif(not backend.probe_backends().llvm_usable, reason="half an hour without LLVM")
def test_a_tenth_of_the_grid_is_complete_and_shows_the_claims_of_the_paper(tmp_path):
    """SD is at most one depth of focus off in every sequence, and the spike count is wrong in some."""
    work = resolve_recipe("recipes/paper.yaml")
    work = replace(work, sequences=work.sequences[::10])
    assert len(work.sequences) == 4
    assert any(s.planned.scene_motion == "dynamic" for s in work.sequences)
    outcome = generate(work, tmp_path / "grid")
    assert outcome.failed == {}
    entries = read_manifest(tmp_path / "grid").sequences
    assert [entry.id for entry in entries] == [s.planned.id for s in work.sequences]
    for entry in entries:
        verify_entry(tmp_path / "grid", entry)
        assert entry.frames == 20_000
    records = evaluate(tmp_path / "grid", methods=METHODS, split="all").records
    right = {m: [bool(r.success()) for r in records if r.who.method == m] for m in METHODS}
    assert all(right["sd+argmax"])
    assert all(right["sd_calibrated+photon_aware"])
    assert not all(right["er_count+argmax"])
