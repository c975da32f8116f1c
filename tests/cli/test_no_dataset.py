# ruff: noqa: E501  a manifest in a line
"""A folder whose manifest.json is not that of a dataset is called so, by every command that takes a dataset."""

import json
from pathlib import Path

import pytest
from planted_sweeps import write_three_sweeps

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import write_records

MANIFESTS = {
    "an object": {"x": 1}, "a list": [], "a list of objects": [{"id": "a"}], "a text": "manifest", "a number": 7, "nothing": None,
    "true": True, "empty": {}, "a web app": {"name": "App", "start_url": ".", "display": "standalone", "icons": [{"src": "a.png"}]},
    "a browser's extension": {"manifest_version": 3, "name": "x", "version": "1"},
    "Croissant": {"@context": {"@vocab": "https://schema.org/"}, "@type": "sc:Dataset", "name": "x", "distribution": []},
    "another tool's": {"format": "webdataset", "layout": 1, "shards": []}, "the index of shards": {"format": "saf-gen shards", "layout": 1},
    "another word": {"format": ["saf-gen dataset"], "layout": 1}, "a later layout": {"format": "saf-gen dataset", "layout": 99},
    "only the format": {"format": "saf-gen dataset", "layout": 1},
}  # fmt: skip
TEXTS = {
    "no text": "",
    "no JSON": "<!doctype html>",
    "half": '{"format": "saf-gen dataset", ',
    "bytes": "\x00\x01",
    "deep": "[" * 9999,
}
COMMANDS = (
    "verify {data}", "evaluate {data} --method sd+argmax --out {out}",
    "tune {data} --method sd+argmax --try search.window=20,50 --out {out}", "dataset index {data}",
    "leaderboard verify {judged} --on {data}", "evaluate {data} --predictions {answers} --out {out}",
    "evaluate {data} --method sd+argmax --track closed_loop --out {out}",
)  # fmt: skip


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """A folder with a good stream, and what the commands take besides a dataset."""
    root = tmp_path_factory.mktemp("desk")
    write_three_sweeps(root / "whole")
    (root / "judged").mkdir()
    write_records(root / "judged/records.jsonl", evaluate(root / "whole", methods=["sd+argmax"], draw=False).records)
    (root / "answers.jsonl").write_text('{"method": "mine", "sequence": "one", "frame": 3}\n')
    (root / "whole").rename(root / "data")
    names = {name: root / name for name in ("data", "judged", "answers.jsonl", "out")}
    return {name.partition(".")[0]: str(path) for name, path in names.items()}


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_takes_a_folder_with_another_manifest_for_a_dataset(call, places, command):
    folder = Path(places["data"])
    for kind, text in {**{kind: json.dumps(held) for kind, held in MANIFESTS.items()}, **TEXTS}.items():
        (folder / "manifest.json").write_text(text)
        before = sorted(folder.rglob("*"))
        code, out, err = call(*command.format(**places).split())
        assert (code, out, err.count("\n"), err.startswith("saf-gen:")) == (2, "", 1, True), (kind, code, out, err)
        assert "manifest.json" in err or "fetch" in command, (kind, err)
        assert (sorted(folder.rglob("*")), Path(places["out"]).exists()) == (before, False), kind


@pytest.mark.parametrize("command", [command for command in COMMANDS if not command.startswith(("dataset", "fetch"))])
def test_a_description_alone_is_no_dataset(call, places, tmp_path, command):
    (tmp_path / "croissant.json").write_text(json.dumps(MANIFESTS["Croissant"]))
    code, _, err = call(*command.format(**{**places, "data": tmp_path}).split())
    assert (code, err.count("\n"), "has no manifest.json" in err) == (2, 1, True)
