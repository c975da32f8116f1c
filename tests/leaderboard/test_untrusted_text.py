"""Untrusted names are shown as text on a terminal, in a spreadsheet, in Markdown and in LaTeX."""

import csv
import json
import re

import pytest
from handmade_evaluations import write_board
from handmade_records import record
from markupsafe import escape
from rich.table import Table as Grid
from rich.text import Text

from saf_gen.benchmark.results import SequenceFailure
from saf_gen.cli._tables import print_json, print_table
from saf_gen.cli._terminal import out, print_error
from saf_gen.core.table import Table
from saf_gen.errors import BadInput, escape_controls

STEERING = "\x1b[2J\x1b]0;title\x07\x9b31m\x7f\u202eevil\u2028next\ud800"
NASTY = f"a|b\n| c | <script>alert(1)</script> `x` [y](http://z) {STEERING}"
FORMULAS = ["=cmd|' /C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", "\tx", "\rx"]


def no_steering(text, *, keep="\n"):
    return not any((ord(c) < 32 and c not in keep) or 0x7F <= ord(c) < 0xA0 or c in "\u202e\u2028\ud800" for c in text)


def test_terminal_controls_are_escaped_and_everything_else_stays():
    assert escape_controls("\x1b[2J \x9b \u202e") == r"\x1b[2J \x9b \u202e"
    assert escape_controls("Größe 3–5 µm 焦点 🙂\n", keep="\n") == "Größe 3–5 µm 焦点 🙂\n"
    assert json.loads(f'"{escape_controls(STEERING, write=json.dumps)}"') == STEERING


@pytest.mark.parametrize("kind", ["print", "table", "title", "text", "error", "json"])
def test_nothing_that_is_printed_steers_a_terminal(capsys, kind):
    table = Grid(title=Text(NASTY))
    table.add_row(Text(NASTY))
    {
        "print": lambda: out.print(NASTY),
        "table": lambda: print_table(Table.of(["name", "what"], [(NASTY, NASTY)])),
        "title": lambda: print_table(Table.of(["name"], ["x"], title=NASTY)),
        "text": lambda: out.print(table),
        "error": lambda: print_error(NASTY, 2),
        "json": lambda: print_json([{NASTY: NASTY}]),
    }[kind]()
    shown = capsys.readouterr()
    assert no_steering(shown.out + shown.err)
    assert "x1b[2J" in shown.out + shown.err or "u001b[2J" in shown.out


def test_an_error_is_one_short_line_whatever_it_names():
    line = str(BadInput(f"unknown {NASTY}", where=NASTY, allowed="x" * 1_000_000, nearest=NASTY, hint=NASTY))
    assert no_steering(line, keep="")
    assert "\n" not in line
    assert len(line) < 6_000


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The leaderboard of records whose names are all malicious."""
    nasty = NASTY.replace("\ud800", "")  # half a surrogate pair is no UTF-8; files that contain one are refused
    records = [
        record(method, f"s-{light}-{nasty}", 0.3, scene=scene, light=light, split="=test", note=nasty)
        for method in ("sd+argmax", f"net {nasty}")
        for light in [*FORMULAS, nasty]
        for scene in ["=scene"]
    ]
    folder = tmp_path_factory.mktemp("written")
    write_board(folder, records, failures=[SequenceFailure(f"=s {nasty}", f"bad {nasty}")])
    return folder


def test_no_cell_of_a_csv_begins_as_a_formula(written):
    seen = 0
    for path in written.glob("*.csv"):
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.reader(file):
                for cell in row:
                    seen += cell.startswith("'")
                    assert not re.match(r"[=+@\t\r\n]|-(?![\d.])", cell), cell
    assert seen > len(FORMULAS)


def test_markdown_and_latex_hold_no_html_link_or_line_of_a_name(written):
    text = (written / "leaderboard.md").read_text(encoding="utf-8")
    assert no_steering(text)
    assert "<script" not in text
    assert set(re.findall(r"<[^>]*>", text)) <= {"<br>"}
    assert not re.search(r"(?<!\\)\]\(", text)
    tables = [part.splitlines() for part in re.split(r"\n{2,}", text) if part.startswith("|")]
    assert len(tables) > 1
    for lines in tables:
        widths = {len(re.findall(r"(?<!\\)\|", line)) for line in lines}
        assert len(widths) == 1, lines
    assert no_steering((written / "leaderboard.tex").read_text(encoding="utf-8"))


def test_the_page_shows_escapes_in_its_text_and_in_what_its_script_reads(written):
    text = (written / "index.html").read_text(encoding="utf-8")
    assert no_steering(text, keep="\n\t")
    assert "<script>alert" not in text
    data = json.loads(text.split('id="data-of-records">')[1].split("</script>")[0])
    assert escape_controls(NASTY.replace("\ud800", "")) in data["answers"][0]  # the note
    assert all(f">{escape(name)}</a>" in text for name in data["methods"]), "the script compares them"
