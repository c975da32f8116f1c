import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from handmade_evaluations import (
    board_of,
    make_delivered,
    make_evaluation,
    make_lens_path,
    make_records,
    make_sweep,
    make_thumbnails,
    write_board,
)
from handmade_records import failed, record
from markupsafe import escape

from saf_gen.benchmark.results import Evaluation, SequenceFailure
from saf_gen.leaderboard import Leaderboard, rank_methods
from saf_gen.leaderboard.report import write_evaluation
from saf_gen.leaderboard.report.charts import plot_times
from saf_gen.leaderboard.report.page import (
    MAX_ANSWERS,
    _author_and_year,
    add_sources,
    build_page,
    choose_answers,
    list_selections,
)
from saf_gen.leaderboard.results import MAX_SHOWN_BINS
from saf_gen.leaderboard.tables import ranking, shade

pytestmark = pytest.mark.slow

ASSETS = Path(__file__).parents[2] / "saf_gen/leaderboard/report/assets"
VOID = {"meta", "img", "br", "wbr", "input"}
NASTY = "<script>alert('$x')</script>&\"{}/../ü"


class Reader(HTMLParser):
    """A strict reader: every element is closed in the right order, and no attribute occurs twice."""

    def __init__(self):
        super().__init__()
        self.open, self.elements, self.headings, self.held = [], [], [], {}

    def handle_starttag(self, tag, attrs):
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), (tag, names)
        self.elements.append((tag, dict(attrs), tuple(self.open)))
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), tuple(self.open)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.held[self.open[-1]] = self.held.get(self.open[-1], "") + data

    def of(self, *tags):
        return [attrs for tag, attrs, _ in self.elements if tag in tags]


def viewer_data(reader):
    (viewer,) = (attrs for attrs in reader.of("div") if attrs.get("class") == "viewer")
    return json.loads(viewer["data-viewer"])


def chart_data(reader):
    found = [json.loads(attrs["data-chart"]) for attrs in reader.of("div") if attrs.get("class") == "chart"]
    return [chart for chart in found if "area" in chart]  # of sweeps


def page_data(text):
    return json.loads(text.split('id="data-of-records">')[1].split("</script>")[0])


def table_rows(text, table):
    """The cells of the table that begins with this text: per body, per row."""
    bodies = text.split(table)[1].split("</table>")[0].split("<tbody")[1:]
    return [
        [
            [re.sub("<.*?>", "", cell) for cell in re.findall("<td.*?</td>", row)]
            for row in re.findall("<tr.*?</tr>", body)
        ]
        for body in bodies
    ]


def page_of(records, *, failures=(), charts=()):
    """The page of these records, without sweeps and plug-ins."""
    return build_page(board_of(records, failures=failures), title="x", charts=charts)


def read(text):
    reader = Reader()
    reader.feed(text)
    reader.close()
    assert reader.open == []
    return reader


@pytest.fixture(scope="module")
def report(small_report):
    return *small_report, (small_report[0] / "index.html").read_text(encoding="utf-8")


def test_the_page_asks_the_network_for_nothing(report):
    reader = read(report[2])
    for attrs in reader.of("img", "script", "iframe", "link", "use", "image", "source"):
        for name in ("src", "href", "srcset"):
            assert attrs.get(name, "data:").startswith(("data:", "#")), attrs
    links = {a["href"] for a in reader.of("a")}
    assert {link for link in links if not link.startswith(("#", "https://doi.org/10."))} == {
        "records.jsonl",
        "leaderboard.json",
        "leaderboard.csv",
        "leaderboard.md",
        "leaderboard.tex",
    }
    styles = reader.held["style"]
    assert "@import" not in styles
    assert "url(" not in styles
    (policy,) = (m["content"] for m in reader.of("meta") if "http-equiv" in m)
    assert policy.startswith("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-")


def test_links_within_the_page_lead_somewhere_and_names_are_there_once(report):
    reader = read(report[2])
    ids = [attrs["id"] for _, attrs, _ in reader.elements if "id" in attrs]
    assert len(ids) == len(set(ids))
    for attrs in reader.of("a", "use"):
        if attrs["href"].startswith("#"):
            assert attrs["href"][1:] in ids


def test_the_page_has_texts_for_screen_readers(report):
    reader = read(report[2])
    assert all(attrs.get("alt") for attrs in reader.of("img"))
    for tag, attrs, around in reader.elements:
        if tag == "svg":
            assert attrs["role"] == "img"
            assert attrs["aria-label"]
        if tag in ("input", "select"):
            named = {label.get("for") for label in reader.of("label")}
            assert "label" in around or attrs.get("aria-label") or attrs["id"] in named
        if tag == "th" and "group" not in attrs.get("class", ""):
            assert attrs["scope"] == "col"
    assert reader.headings[0] == 1
    assert reader.headings.count(1) == 1
    steps = zip(reader.headings, reader.headings[1:], strict=False)
    assert all(after <= before + 1 for before, after in steps)
    tables, captions = (len(reader.of(tag)) for tag in ("table", "caption"))
    assert tables == captions
    assert reader.of("html") == [{"lang": "en"}]


def test_the_page_contains_the_table_the_columns_the_failures_and_the_digests(report):
    rows = rank_methods(make_records())
    text = report[2]
    for row in rows:
        assert f'<td class="name"><a href="#answers">{row.method}</a></td>' in text
    for column in shade(ranking(rows)).shown:
        assert column.header in text
        assert escape(column.meaning) in text
    some = next(row for row in rows if 0 < row.answerable_1dof < 1)
    assert f"--lo:{some.answerable_1dof_low:.4g};--hi:{some.answerable_1dof_high:.4g}" in text
    assert "sha-camel-ramp" in text
    assert "<code>bad</code>: truncated" in text


def test_each_measure_and_search_has_formula_source_and_code(report):
    text = report[2].split('<section id="methods"')[1].split("</section>")[0]
    assert re.findall(r'class="plugin" id="([\w-]+)"><summary><code>(.*?)</code>', text) == [
        ("measures-1", "sd"),
        ("measures-2", "er_count"),
        ("searches-1", "argmax"),
        ("searches-2", "egs_code"),
    ]
    assert "squared mean, V/ū²" in text
    assert '<a href="https://doi.org/10.1109/CVPR52733.2024.02363">doi:10.1109/CVPR52733.2024.02363</a>.' in text
    assert "class SpikeDispersion:" in text


def test_a_sweep_with_pictures_can_be_looked_through(report):
    reader = read(report[2])
    held = viewer_data(reader)
    assert (held["across"], len(held["words"]), len(held["x"])) == (8, 16, 16)
    assert held["x"] == sorted(held["x"])
    assert held["words"][0].startswith("frame 24, lens at 0.031, −3.8 DoF from the focus, 0.200 spikes")
    (slider,) = (attrs for attrs in reader.of("input") if attrs.get("type") == "range")
    assert (slider["min"], slider["max"], slider["value"]) == ("0", "15", "6")  # 6 is nearest to the truth
    (box,) = (attrs for attrs in reader.of("span") if attrs.get("class") == "box")
    assert box["style"] == "top:25%;left:12.5%;bottom:calc(100% - 75%);right:calc(100% - 87.5%)"


def without_curves():
    """An evaluation without focus curves: no method uses argmax, only searches on some windows and predictions."""
    steps = {"frame": 300.0, "trace": (700.0, 100.0, 300.0)}
    records = [
        record(m, f"camel-{light}", 0.1, light=light, split="test", **steps)
        for light in ("constant", "ramp")
        for m in ("sd+egs_code", "my_net")
    ]
    sweeps = (make_sweep("constant", measures=(), thumbnails=make_thumbnails()), make_sweep("ramp", measures=()))
    return Evaluation(tuple(records), sweeps, ())


def test_without_any_curve_sweeps_have_their_chart_and_viewer(tmp_path):
    made = without_curves()
    write_evaluation(tmp_path, Leaderboard.of(made), title="no argmax")
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    reader = read(text)
    assert viewer_data(reader)["words"][0].startswith("frame 24, lens at 0.031, −3.8 DoF")
    assert "<h3>Sweeps</h3>" in text
    charts = chart_data(reader)
    assert [chart["rows"] for chart in charts] == [["predictions", "egs_code"]] * 2
    assert {mark[4] for chart in charts for mark in chart["marks"]} == {"sd+egs_code", "my_net"}
    assert all((chart["lines"], chart["at"], chart["bands"]) == ([], [0.375], [[0.33, 0.42]]) for chart in charts)


def test_the_code_of_a_measure_keeps_its_lines(report):
    (code,) = re.findall(r'<pre [^>]*aria-label="sd.py">(.*?)</pre>', report[2], re.DOTALL)
    assert "\n\nfrom dataclasses import dataclass\nfrom typing import ClassVar\n" in code


def test_every_selection_is_ranked_as_a_leaderboard_of_its_own(report):
    """The rows of each table body are those of rank_methods on only the records of the selection."""
    records, text = make_records(), report[2]
    shown = add_sources(shade(board_of(records).ranking), make_evaluation().plugins).shown
    bodies, data = table_rows(text, 'id="board"'), page_data(text)
    names = re.findall(r'<option value="\d+">(.*?)</option>', text)
    selections = list_selections(records)
    assert names == ["all 12 sequences", *(selection.name for selection in selections)]
    assert len(data["selections"]) == len(selections) > 12
    everything = {"body": 0, "sequences": list(range(12))}
    for chosen in [everything, *data["selections"]]:
        sequences = {data["sequences"][number] for number in chosen["sequences"]}
        rows = rank_methods([r for r in records if r.what.sequence in sequences])
        assert bodies[chosen["body"]] == [[c.text(row) for c in shown] for row in rows]
    assert len(bodies) == len({tuple(c["sequences"]) for c in [everything, *data["selections"]]})
    assert text.count("<tbody hidden>") == len(bodies) - 1


def test_the_worst_answers_are_a_table_whose_lines_lead_to_the_file():
    records = [record("a+s", f"s{i}", 0.1 * i, scene=f"s{i}") for i in range(MAX_ANSWERS + 5)]
    records[7] = failed("a+s", "s7", "failed", scene="s7", note="<late>")
    text = page_of(records)
    (rows,) = table_rows(text, 'aria-label="Single answers"')
    assert len(rows) == MAX_ANSWERS
    assert rows[0] == ["a+s", "s7", "failed", "–", "0.0000", "–", "–", "8", "&lt;late&gt;"]
    assert rows[1][5:8] == ["10.40", "20.8", "105"]
    assert '<td><a href="records.jsonl">105</a></td>' in text
    assert f"The {MAX_ANSWERS} worst of {MAX_ANSWERS + 5} answers." in text


def make_many(sequences, *, scenes=4):
    """Two methods on many sequences; the first is worse, increasingly so towards the last sequence."""
    return [
        record(method, f"s{i}", (-1) ** i * factor * i / sequences, scene=f"scene{i % scenes}", split="test")
        for i in range(sequences)
        for method, factor in (("a+s", 9.0), ("b+s", 0.5))
    ]


def test_of_many_answers_the_page_holds_the_worst_of_each_method_and_of_all():
    held = choose_answers(make_many(400), max_answers=60)
    assert held.total == 400
    answers = {(one.record.who.method, one.record.what.sequence) for one in held.answers}
    assert answers == {("a+s", f"s{i}") for i in range(300, 400)} | {("b+s", f"s{i}") for i in range(370, 400)}
    assert held.sequences == tuple(f"s{i}" for i in range(300, 400))
    sizes = [abs(one.record.judgement.error_dof) for one in held.answers]
    assert sizes == sorted(sizes, reverse=True)
    assert len(choose_answers(make_many(50), max_answers=100).answers) == 100


def test_the_page_does_not_grow_with_the_sequences(monkeypatch):
    """With three times as many sequences only the digits of numbers may make the page longer, by a fiftieth."""
    monkeypatch.setattr(choose_answers, "__kwdefaults__", {"max_answers": 100})
    sizes = [len(page_of(make_many(count, scenes=2))) for count in (300, 900)]
    assert sizes[1] < 1.02 * sizes[0], sizes


def test_of_many_scenes_the_largest_have_columns_and_selections():
    records = make_many(120, scenes=60)
    text = page_of(records)
    assert len([s for s in list_selections(records) if s.axis == "Scene"]) == MAX_SHOWN_BINS
    assert f"Shown: the {MAX_SHOWN_BINS} of 60 bins with the most sequences; axes.csv has all." in text


def test_of_many_failures_the_page_names_some_and_counts_the_rest():
    failures = [SequenceFailure(f"bad{i}", "truncated") for i in range(120)]
    text = page_of((), failures=tuple(failures))
    assert text.count("truncated") == 100
    assert "and 20 more" in text


def test_text_from_files_cannot_break_the_page(tmp_path):
    records = [
        record(f"{NASTY}+{number}", f"{NASTY}{light}", 0.1, light=f"{NASTY}{light}", scene=NASTY, note=NASTY)
        for number in (1, 2)
        for light in (1, 2)
    ]
    one = make_sweep(NASTY, scene=NASTY, split=NASTY, thumbnails=make_thumbnails())
    paths = (make_lens_path(f"{NASTY}+s", NASTY, scene=NASTY),)
    made = Evaluation(tuple(records), (one,), (SequenceFailure(NASTY, NASTY),), paths)
    write_evaluation(tmp_path / "out", Leaderboard.of(made), title=NASTY)
    reader = read((tmp_path / "out/index.html").read_text(encoding="utf-8"))
    assert len(reader.of("script")) == 2
    data = json.loads(reader.held["script"].split("/*!")[0])
    assert {answer[-1] for answer in data["answers"]} == {NASTY}
    assert {p.name for p in tmp_path.iterdir()} == {"out"}


def test_the_closed_loop_shows_where_the_lens_went(tmp_path):
    records = [
        record("sd+hill_climb", "camel-constant", 0.1, track="closed_loop", terms="voice_coil, 200 ms"),
        record("er_count+hill_climb", "camel-constant", None, track="closed_loop", terms="voice_coil, 200 ms"),
    ]
    made = Evaluation(tuple(records), (), (), tuple(make_lens_path(r.who.method) for r in records))
    write_evaluation(tmp_path, Leaderboard.of(made), title="loop")
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "Path of the lens" in text
    assert "closed loop (voice_coil, 200 ms)" in text
    assert "Focus curves</h3>" not in text


def test_a_page_without_truth_says_that_nothing_ranks():
    records = [record("a+s", "x", None)]
    text = page_of(records)
    assert "No answer of all: that takes 3 measures" in text
    assert "methods are not ranked" in page_of([record("a+s", "x", None, track="closed_loop", frame=None)])
    assert not re.search(r"\bnan\b", text.split("<script>")[0], re.IGNORECASE)


def test_an_empty_evaluation_still_makes_a_page(tmp_path):
    failures = (SequenceFailure("bad", "truncated"),)
    write_board(tmp_path, [], failures=failures)
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    read(text)
    assert "truncated" in text


def luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_lines_stand_out_in_both_schemes(scheme):
    """Text has a contrast of 4.5 : 1, lines and marks of 3 : 1, as WCAG 2.2 requires (1.4.3, 1.4.11)."""
    first, dark = (ASSETS / "page.css").read_text().split("@media screen and (prefers-color-scheme: dark)")
    colours = dict(re.findall(r"(--[\w]+): (#[0-9a-f]{6})", dark if scheme == "dark" else first))
    for text in ("--ink", "--soft", "--best"):
        for under in ("--paper", "--raised"):
            assert contrast(colours[text], colours[under]) >= 4.5, (text, under)
    assert contrast(colours["--ink"], colours["--bar"]) >= 4.5
    assert contrast(colours["--ink"], colours["--warn"]) >= 4.5
    for number in range(1, 9):
        assert contrast(colours[f"--c{number}"], colours["--paper"]) >= 3, number


def test_the_headline_and_the_table_say_the_same_fraction():
    """Five of eight scenes are 62.5 %, which is rounded up."""
    records = [record("m+s", f"s{i}", 0.0 if i < 5 else 9.0, scene=f"s{i}") for i in range(8)]
    text = page_of(records)
    assert '<p class="lead">m+s: right on 63% of 8 sequences, averaged over scenes.' in text
    assert table_rows(text, 'id="board"')[0][0].count("63%") >= 1


def of_scenes(*, right, scenes):
    """Methods that are right on the first so many of the scenes."""
    return [
        record(f"{name}+s", f"s{i}", 0.0 if i < count else 9.0, scene=f"s{i}")
        for name, count in right.items()
        for i in range(scenes)
    ]


@pytest.mark.parametrize(
    ("right", "scenes", "shades", "headline"),
    [
        (
            {"a": 3, "b": 2},
            3,
            ["first", "level"],
            "<strong>Undecided: 3 scenes cannot tell these 2 methods apart.</strong> a+s is "
            "right on 100% of 3 sequences, averaged over scenes; no other method is right more often.",
        ),
        (
            {"a": 3, "b": 3},
            3,
            ["first", "first"],
            "<strong>Undecided: 3 scenes cannot tell these 2 methods apart.</strong> a+s, "
            "b+s are right on 100% of 3 sequences, averaged over scenes; no other method is right more often.",
        ),
        (
            {"a": 60, "b": 2},
            60,
            ["first"],
            "<strong>a+s wins:</strong> right on 100% of 60 sequences"
            ", averaged over scenes, and every other method "
            "can be told "
            "apart from it.",
        ),
        (
            {"a": 60, "b": 59, "c": 2},
            60,
            ["first", "level"],
            "<strong>a+s leads:</strong> right on 100% of 60 sequences"
            ", averaged over scenes; 1 of 2 other methods "
            "cannot be told apart from it.",
        ),
        (
            {"a": 60, "b": 60, "c": 2},
            60,
            ["first", "first"],
            "<strong>a+s, b+s lead together:</strong> right on 100% of 60 sequences"
            ", averaged over scenes; every "
            "other method can be told apart.",
        ),
    ],
)
def test_the_headline_says_who_wins_or_that_the_scenes_cannot_say(right, scenes, shades, headline):
    text = page_of(of_scenes(right=right, scenes=scenes))
    assert headline in text
    assert re.findall(r'<tr class="(\w+)">', text.split('id="board"')[1].split("</tbody>")[0])[-len(shades) :] == shades


def test_the_headline_counts_scenes_as_the_ranking_does():
    """Members and repeats of a scene are not scenes, however many there are."""
    records = [
        record(method, f"x{member}", error, scene="x")
        for method, error in (("a+s", 0.0), ("b+s", 9.0))
        for member in range(5)
    ]
    text = page_of(records)
    assert "Undecided: 1 scene (intervals need 3) cannot tell these 2 methods apart." in text
    assert '<tr class="level">' in text  # nothing is tested with so few scenes, so nothing is told apart


def test_control_characters_in_what_was_delivered_are_escaped(tmp_path):
    records = make_records()
    shown = replace(make_delivered(), sequence="ca\x1bmel", answers=(("a\u202eb+s", 0.0), ("c+s", 1.0)))
    write_evaluation(tmp_path, board_of(records), title="x", delivered=shown)
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "\x1b" not in text
    assert "\u202e" not in text


@pytest.mark.parametrize("track", ["recorded", "closed_loop"])
def test_success_stands_against_the_time_that_includes_computing(track):
    """In the closed loop the clock goes on while a method computes, and nothing is added."""
    reversals = None if track == "recorded" else 2
    records = [
        record("a+s", "x", 0.0, time_to_focus_s=0.3, seconds=0.1, reversals=reversals, track=track),
        record("b+s", "x", 9.0, time_to_focus_s=1.0, seconds=0.2, reversals=reversals, track=track),
    ]
    times = plot_times(rank_methods(records))
    longest = 1.05 * (1.2 if track == "recorded" else 1.0)
    places = {row.method: (across * longest, up) for row, across, up in times.points}
    assert places["a+s"] == pytest.approx((0.4 if track == "recorded" else 0.3, 1.0))
    assert places["b+s"] == pytest.approx((longest / 1.05, 0.0))
    assert [label for _, label in times.ticks][:2] == ["0", "0.5" if longest > 1.2 else "0.2"]


def test_a_source_is_the_first_author_and_year_of_the_first_reference():
    assert [_author_and_year(source) for source in (
        "Equation 12 of Su et al., CVPR 2024, doi:10.1109/CVPR52733.1999.02363.",
        "[1] Exhaustive search. Its code: 2024.",
        "[1] Vollath, 147(3), 1987, doi:x. [2] Santos et al., 1997.",
        "This project, after Vollath, 1987.",
        '"Autofocus of a Camera", ICML 2026, example.org/2027.',
        "",
    )] == ["Su 2024", "", "Vollath 1987", "here", "ICML 2026", ""]  # fmt: skip
