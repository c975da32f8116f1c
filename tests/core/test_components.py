"""Components in recipes: their options are checked at the ends of ranges, and drawn by name."""

import json

from saf_gen.core.config import components
from saf_gen.core.config.yaml_document import read_yaml

NAME = (7, "test", "camel-constant-00")


def read_motion(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(f"motion: {text}\n")
    document = read_yaml(path)
    return components.read_component("motions", document.data["motion"], document=document, keys=("motion",))


def test_a_part_is_read_as_it_was_written_but_for_its_files(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,position\n0,0.5\n")
    table = {"path": "a.csv", "text": "time_s,position\n0,0.5\n"}
    assert read_motion(tmp_path, "{kind: sweep, to: {uniform: [0.5, 0.9]}}") == {
        "kind": "sweep",
        "to": {"uniform": [0.5, 0.9]},
    }
    assert read_motion(tmp_path, "{kind: from_csv, file: a.csv}")["file"] == table
    among = read_motion(tmp_path, "{kind: from_csv, file: {choice: [a.csv, a.csv]}}")["file"]
    assert among == {"choice": [table, table]}
    again = json.dumps({"kind": "from_csv", "file": table})  # as in the recipe of a recording
    assert read_motion(tmp_path, again)["file"] == table


def test_a_part_is_resolved_by_the_names_of_recording_and_purpose():
    motion = {"kind": "hand", "irregularity": {"uniform": [0.1, 0.9]}, "bandwidth_hz": {"uniform": [5, 9]}}

    def draw(component=motion, name=NAME, purpose="motion"):
        return components.draw_component("motions", component, name=name, purpose=(purpose,))

    one = draw()
    assert one == draw()
    assert 0.1 <= one["irregularity"] <= 0.9
    for other in (draw(purpose="another"), draw(name=(8, *NAME[1:]))):
        assert other["seed"] != one["seed"]
        assert other["irregularity"] != one["irregularity"]
    assert draw(motion | {"irregularity": 0.5}) == one | {"irregularity": 0.5}  # draws of keys are independent


def test_a_choice_among_parts_draws_a_part_and_then_its_numbers():
    among = {"choice": [{"kind": "hold", "position": {"uniform": [0.1, 0.9]}}, {"kind": "sweep"}]}
    drawn = [components.draw_component("motions", among, name=(seed, "a"), purpose=("motion",)) for seed in range(40)]
    held = [motion["position"] for motion in drawn if motion["kind"] == "hold"]
    assert 5 < len(held) < 35  # a fair coin leaves this range with probability 1.4·10⁻⁶
    assert len(set(held)) == len(held)
