"""The tables of pages of results, which studies/ranking/result_tables.py makes from two evaluations."""

import json

import pytest
from handmade_evaluations import write_board
from handmade_records import record

from studies.ranking import result_tables

LIGHTS = "constant", "darker"
TRACKS = "recorded", "closed_loop"
METHODS = dict.fromkeys((*result_tables.CLAIMS_SHOWN, "er_sumsq_n+argmax"))


def write(folder, *, track):
    """Write four scenes under two lights; er_sumsq+argmax is wrong under the darker one, everything else is right."""
    records = [
        record(
            method,
            f"{scene}-{light}",
            3.0 if (method, light) == ("er_sumsq+argmax", "darker") else 0.1,
            scene=f"scene{scene}",
            light=light,
            track=track,
        )
        for method in METHODS
        for scene in range(4)
        for light in LIGHTS
    ]
    folder.mkdir()
    write_board(folder, records)
    return json.loads((folder / "leaderboard.json").read_text(encoding="utf-8")) | {"folder": folder}


@pytest.fixture(scope="module")
def documents(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    return {track: write(folder / track, track=track) for track in TRACKS}


def cells(text):
    return [[cell.strip() for cell in line.strip("|\n ").split("|")] for line in text.splitlines()]


@pytest.mark.parametrize("track", TRACKS)
@pytest.mark.parametrize("name", result_tables.TABLES)
def test_every_line_of_a_table_has_as_many_cells_as_its_head(documents, name, track):
    text = result_tables.TABLES[name](documents[track])
    head, *lines = cells(text)
    assert lines
    assert {len(line) for line in lines} == {len(head)}


def test_tables_hold_the_success_of_each_method(documents):
    """Rows are ordered best first; a measure is compared with its brightness-normalised form."""
    _, _, *lines = cells(result_tables.TABLES["results"](documents["recorded"]))
    assert {line[2].strip("`") for line in lines} == set(METHODS)
    assert lines[-1][2:5] == ["`er_sumsq+argmax`", "50 %", "50 %"]
    _, _, first, *_ = cells(result_tables.TABLES["division"](documents["recorded"]))
    assert first == ["`er_sumsq`", "50 %", "100 %", "+50"]


def test_a_page_keeps_what_was_written_by_hand_and_is_the_same_when_made_again(documents):
    page = "before\n\n<!-- table: recorded claims -->\nold\n<!-- end -->\n\nafter\n"
    made = result_tables.rewrite(page, documents)
    assert made.startswith("before\n\n<!-- table: recorded claims -->\n\n| method | constant | darker | all |")
    assert made.endswith("|\n\n<!-- end -->\n\nafter\n")
    assert "old" not in made
    assert result_tables.rewrite(made, documents) == made


def test_the_pages_hold_every_table_once():
    pages = "".join(page.read_text(encoding="utf-8") for page in result_tables.PAGES)
    asked = [match.group(2, 3) for match in result_tables.TABLE.finditer(pages)]
    assert len(asked) == len(set(asked))
    assert {kind for _, kind in asked} == set(result_tables.TABLES)
