"""A table is the same table in every writer: values for programs, texts for readers, and nothing that a name breaks."""

import csv
import io
import re
from html import unescape
from operator import itemgetter
from types import SimpleNamespace

import pytest

from saf_gen.core.plain_text import escape_latex, escape_markdown
from saf_gen.core.table import Column, Table, percent
from saf_gen.leaderboard.report.page import load_templates

INF = float("inf")
NASTY = "a|b_c & <b>x</b> [y](z)\n=1+1 50 %"
ROWS = [
    SimpleNamespace(name="sd+argmax", rate=0.375, low=0.1, high=0.6, size=12.5, note=None, secret=1),
    SimpleNamespace(name=NASTY, rate=None, low=None, high=None, size=INF, note=None, secret=None),
    SimpleNamespace(name="=SUM(A1)", rate=1.0, low=None, high=1.0, size=-2.0, note=None, secret=3),
]
TABLE = Table(
    [
        Column("method", "name", meaning="A method.", kind="name", link="#x"),
        Column(
            *("≤1 DoF", "rate", percent, "Success."),
            kind="main",
            group="success",
            fraction=True,
            ends=lambda row: (row.low, row.high),
        ),
        Column(
            *("95 %", "low"),
            cell=lambda row: "–" if row.low is None else f"{row.low}–{row.high}",
            kind="number",
            group="success",
        ),
        Column("size", "size", ".2f", kind="number", detail=3, key="size_px"),
        Column("note", "note", optional=True),
        Column("", "secret", meaning="For programs.", for_programs=True),
    ],
    ROWS,
    "A table",
    lambda row: "first" if row.rate == 1 else "",
)


def test_programs_get_every_column_with_its_value_and_none_where_it_is_unknown():
    header, *lines = csv.reader(io.StringIO(TABLE.to_csv()))
    assert header == ["name", "rate", "low", "size_px", "note", "secret"] == list(TABLE.to_dicts()[0])
    assert lines[0] == ["sd+argmax", "0.375", "0.1", "12.5", "", "1"]
    assert lines[1][1:] == ["", "", "inf", "", ""]
    assert [one["rate"] for one in TABLE.to_dicts()] == [0.375, None, 1.0]


@pytest.mark.parametrize("text", ["=cmd|' /C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", "\tx", "\rx", "\nx", "a\r=1+1"])
def test_no_text_in_a_csv_is_a_formula_and_numbers_stay_numbers(text):
    written = Table.of(["text", "number"], [(text, -2.5)]).to_csv()
    _, (cell, number) = csv.reader(io.StringIO(written, newline=""))
    assert (cell.removeprefix("'"), number) == (text, "-2.5")
    assert not re.match(r"[=+@\t\r\n-]", cell)


@pytest.mark.parametrize("text", ["\x1b[31mred", "a\u202eb", "\x07", "\x9b2J"])
def test_no_text_in_a_csv_steers_a_terminal(text):
    assert text not in Table.of(["text"], [(text,)]).to_csv()
    assert "灯 °C" in Table.of(["text"], [("灯 °C",)]).to_csv()


def test_a_text_is_formatted_from_the_value_and_a_dash_where_it_is_unknown():
    _, rate, interval, size = TABLE.shown  # not the note, which nobody has
    assert [column.header for column in TABLE.up_to(2).shown] == ["method", "≤1 DoF", "95 %"]
    assert [rate.text(row) for row in ROWS] == ["38%", "–", "100%"]
    assert [interval.text(row) for row in ROWS] == ["0.1–0.6", "–", "–"]
    assert [size.text(row) for row in ROWS] == ["12.50", "inf", "-2.00"]
    assert Column("part", "inner.name").text(SimpleNamespace(inner=ROWS[0])) == "sd+argmax"
    assert (Column("a heading", itemgetter(1)).name, Column("a", "b").name) == ("a_heading", "b")


@pytest.mark.parametrize(
    ("fraction", "text"), [(0.625, "63%"), (0.375, "38%"), (0.125, "13%"), (0.005, "1%"), (2 / 3, "67%"), (1, "100%")]
)
def test_a_percentage_that_ends_in_a_half_is_rounded_up(fraction, text):
    assert percent(fraction) == percent(fraction - 1e-16) == text


def test_markdown_has_as_many_cells_in_every_line_whatever_names_hold():
    lines = TABLE.to_markdown().splitlines()
    assert lines[0] == "| method | ≤1 DoF | 95 % | size |"
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {5}
    assert r"a\|b_c &amp; &lt;b&gt;x&lt;/b&gt; \[y\](z) =1+1 50 %" in lines[3]
    assert escape_markdown("sd_code+sgfs_code:dt=50@frame") == "sd_code+sgfs_code:dt=50@frame"


@pytest.mark.parametrize(
    ("plain", "latex"),
    [
        ("sd_code+egs", r"sd\_code+egs"),
        ("50%", r"50\%"),
        (r"a\b", r"a\textbackslash{}b"),
        ("{$x^2$} & #1 ~", r"\{\$x\textasciicircum{}2\$\} \& \#1 \textasciitilde{}"),
        ("≤½ DoF", r"$\leq$$\frac{1}{2}$ DoF"),
        ("1–4\n|−2|", "1--4 $|$$-$2$|$"),
    ],
)
def test_latex_escapes_what_means_something_to_it(plain, latex):
    assert escape_latex(plain) == latex


@pytest.mark.parametrize("rows", [ROWS, []])
def test_latex_has_a_cell_for_each_column_in_every_line(rows):
    lines = Table(TABLE.columns, rows).to_latex().splitlines()
    assert lines[1] == r"\begin{tabular}{lrrr}"
    body = lines[lines.index(r"\midrule") + 1 : lines.index(r"\bottomrule")]
    assert len(body) == len(rows)
    assert all(line.endswith(r" \\") and line.count(" & ") == 3 for line in [lines[5], *body])
    assert "".join(lines).isascii()


def test_html_has_bars_intervals_links_and_marks_and_text_stays_text():
    macros = load_templates().get_template("macros.html").module
    page = str(macros.table(TABLE, [ROWS, ROWS[:1]], "board"))
    assert page.count("<tbody") == 2 == page.count("</tbody>")
    assert page.count("<tbody hidden>") == 1
    assert '<td class="name"><a href="#x">sd+argmax</a></td>' in page
    assert '<td class="main" style="--v:0.375;--lo:0.1;--hi:0.6">38%</td><td>0.1–0.6</td><td>12.50</td>' in page
    assert '<td class="main">–</td>' in page
    assert "<b>" not in page
    assert NASTY.replace("\n", r"\n") in unescape(page)
