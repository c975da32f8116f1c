"""The page as people have it: in Chromium, worked by its buttons, on a phone, in the dark, without script."""

import math
from dataclasses import replace

import pytest
from browser import CHROMIUM, NO_CHROMIUM, run_chromium, run_in_page
from handmade_evaluations import make_evaluation, make_records

from saf_gen.benchmark.records import record_to_json
from saf_gen.leaderboard import AXES, list_shown_columns, rank_methods
from saf_gen.leaderboard.columns import format_percent
from saf_gen.leaderboard.report import write_report
from saf_gen.leaderboard.report.page_data import AGGREGATION_RULES

pytestmark = [pytest.mark.browser, pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)]

READ = """
const read = () => [...page.getElementById("board").tBodies[0].rows]
  .filter((row) => !row.hidden).map((row) => [...row.cells].map((cell) => cell.textContent));
const form = page.getElementById("filters");
const choose = (name, text) => {
  const select = form.elements[name];
  const option = [...select.options].find((o) => o.text === text);
  select.value = option.value;
  select.dispatchEvent(new window.Event("input", { bubbles: true }));
};
const reset = async () => { form.reset(); await new Promise((done) => setTimeout(done, 20)); };
const status = () => page.getElementById("shown").textContent;
const head = (text) => [...page.querySelectorAll("#board thead tr:last-child th")]
  .find((th) => th.textContent === text);
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("page")
    made = make_evaluation()
    write_report(out, evaluation=made, rows=rank_methods(made.records), title="small")
    return out


@pytest.fixture(scope="module")
def ask(folder, tmp_path_factory):
    def asked(script, **options):
        return run_in_page(folder, READ + script, profile=tmp_path_factory.mktemp("profile"), **options)

    return asked


def shown_as(record_filter):
    """The leaderboard's lines for some of the records, as Python has them; intervals are left out."""
    records = make_records()
    shown = list_shown_columns(rank_methods(records))
    lines = []
    for row in rank_methods([r for r in records if record_filter(r)]):
        held = [
            column.format_value(row)
            if column.name in ("rank", "method", *AGGREGATION_RULES) or column.share
            else "–"
            for column in shown
        ]
        lines.append([held[0].rstrip("~"), *held[1:]])
    return lines


def test_the_page_loads_alone_and_its_policy_lets_its_script_run(ask):
    answer = ask("""
      return {
        loaded: window.performance.getEntriesByType("resource").map((e) => e.name),
        sorts: page.querySelectorAll("#board th button").length,
        status: status(),
      };
    """)
    assert answer["loaded"] == []
    assert answer["sorts"] == len(list_shown_columns(rank_methods(make_records())))
    assert answer["status"] == "4 of 4 methods, 12 of 12 sequences."


def test_the_policy_stops_what_would_ask_the_network_or_run_another_script(ask):
    answer = ask("""
      const stopped = [];
      page.addEventListener("securitypolicyviolation", (e) => stopped.push(e.effectiveDirective));
      const script = page.createElement("script");
      script.textContent = "window.ran = true";
      page.body.append(script);
      const image = page.createElement("img");
      image.src = "other.png";
      page.body.append(image);
      await new Promise((done) => setTimeout(done, 200));
      return { stopped: stopped.sort(), ran: window.ran === true };
    """)
    assert answer == {"stopped": ["img-src", "script-src-elem"], "ran": False}


def test_a_column_sorts_both_ways_and_says_so(ask):
    answer = ask("""
      const at = [...page.querySelectorAll("#board thead tr:last-child th")].indexOf(head("err DoF"));
      const click = (text) => head(text).querySelector("button").click();
      const values = () => read().map((cells) => cells[at]);
      const sorted = () => [...page.querySelectorAll("#board th[aria-sort]")]
        .map((th) => [th.textContent, th.getAttribute("aria-sort")]);
      click("err DoF"); const up = [values(), sorted()];
      click("err DoF"); const down = [values(), sorted()];
      click("≤1 DoF"); const share = [read().map((c) => c[4]), sorted()];
      click("method"); const names = [read().map((c) => c[2]), sorted()];
      return { up, down, share, names };
    """)
    errors = [float(v) for v in answer["up"][0]]
    assert errors == sorted(errors)
    assert answer["up"][1] == [["err DoF", "ascending"]]
    assert answer["down"] == [answer["up"][0][::-1], [["err DoF", "descending"]]]
    assert answer["share"][1] == [["≤1 DoF", "descending"]]  # shares begin with the best
    assert answer["names"][0] == sorted(answer["names"][0])


def test_what_is_unknown_stays_last_whichever_way_a_table_sorts(ask):
    answer = ask("""
      const table = page.querySelector("#conditions table");
      const row = table.tBodies[0].rows[0];
      row.cells[1].textContent = "–"; delete row.cells[1].dataset.v;
      const button = table.querySelectorAll("th button")[1];
      const last = () => [...table.tBodies[0].rows].at(-1) === row;
      button.click(); const one = last(); button.click();
      return [one, last()];
    """)
    assert answer == [True, True]


def test_numbers_are_printed_as_python_prints_them(ask):
    numbers = [
        0.125,
        0.375,
        2.5,
        3.5,
        0.5,
        1.005,
        12.5,
        87.5,
        1e-9,
        1234567.5,
        0.045,
        2.675,
        -0.125,
        -2.5,
        0.0,
    ]
    numbers += [math.pi * 10**k for k in range(-6, 6)]
    answer = ask(f"return {numbers}.map((n) => [0, 1, 2, 4].map((d) => window.fixed(n, d)));")
    assert answer == [[f"{n:.{d}f}" for d in (0, 1, 2, 4)] for n in numbers]


BINS = {a.name: a for a in AXES}
CHOICES = [
    {"split": "train"},
    {"scene": "usaf"},
    {"light": "ramp"},
    {"scene_motion": "dynamic"},
    {"light_ratio": "2 to 5"},
    {"photon_budget": "10 to 30"},
    {"split": "test", "light": "steps"},
    {"split": "train", "scene": "camel"},
]


def test_the_leaderboard_of_some_sequences_is_that_of_python(ask):
    titles = {"split": "split", **{name: name for name in BINS}}
    steps = "".join(
        "await reset();"
        + "".join(f"choose({titles[name]!r}, {text!r});" for name, text in choice.items())
        + "out.push(read());"
        for choice in CHOICES
    )
    answer = ask(f"const out = [read()]; {steps} await reset(); out.push(read()); return out;")
    whole = [
        [c.format_value(row) for c in list_shown_columns(rank_methods(make_records()))]
        for row in rank_methods(make_records())
    ]
    assert answer[0] == whole
    assert answer[-1] == whole
    for choice, lines in zip(CHOICES[:-1], answer[1:-2], strict=True):

        def fits(r, choice=choice):
            return all(
                (r.split if name == "split" else BINS[name].bin(r)) == text for name, text in choice.items()
            )

        assert lines == shown_as(fits), choice
    assert {cell for line in answer[-2] for cell in line[3:]} == {"–"}  # no sequence is both


def test_methods_are_found_by_words_measure_and_search(ask):
    answer = ask("""
      const names = () => read().map((cells) => cells[2]).sort();
      const type = (text) => {
        form.elements.text.value = text;
        form.elements.text.dispatchEvent(new window.Event("input", { bubbles: true }));
      };
      type("ER egs"); const words = names();
      await reset(); choose("measure", "sd"); const measure = names();
      choose("search", "argmax"); const both = names(); const said = status();
      await reset(); type("nothing"); const none = [names(), status()];
      await reset();
      return { words, measure, both, said, none, all: names().length };
    """)
    assert answer["words"] == ["er_count+egs_code"]
    assert answer["measure"] == ["sd+argmax", "sd+egs_code"]
    assert answer["both"] == ["sd+argmax"]
    assert answer["said"] == "1 of 4 methods, 12 of 12 sequences."
    assert answer["none"] == [[], "0 of 4 methods, 12 of 12 sequences."]
    assert answer["all"] == 4


def test_single_answers_are_the_worst_first_with_their_lines(ask):
    answer = ask("""
      const lines = () => [...page.querySelectorAll("#answers tbody tr")].map((row) => [
        row.cells[0].textContent, row.cells[1].textContent, row.cells[5].textContent,
        row.querySelector("button").textContent, row.cells[8].innerHTML]);
      const all = lines();
      choose("split", "train"); choose("measure", "sd");
      return { all, some: lines(), said: page.querySelector("#answers [role=status]").textContent };
    """)
    records = make_records()
    worst = sorted(range(len(records)), key=lambda i: -abs(records[i].error_dof or math.inf))
    assert [line[3] for line in answer["all"]] == [f"line {i + 1}" for i in worst]
    for line in answer["all"]:
        told_of = records[int(line[3].removeprefix("line ")) - 1]
        error = "–" if told_of.error_dof is None else f"{told_of.error_dof:.2f}"
        assert line[:3] == [told_of.method, told_of.sequence, error]
        assert line[4] == told_of.note.replace("<", "&lt;").replace(">", "&gt;")
    kept = [r for r in records if r.split == "train" and r.method.startswith("sd+")]
    assert len(answer["some"]) == len(kept)
    assert answer["said"] == f"{len(kept)} answers, the worst first."


ANSWERS_TABLE = """[...page.querySelectorAll("#answers tbody tr")].map((row) => [...row.cells].map((c) =>
  [c.textContent, c.className, c.dataset.v === undefined ? null : Number(c.dataset.v)]))"""


def test_the_answers_of_the_script_are_those_that_are_there_without_it(ask):
    of_script, plain = (ask(f"return {ANSWERS_TABLE};", scripts=scripts) for scripts in (True, False))
    assert len(plain) == len(make_records())
    for one, other in zip(of_script, plain, strict=True):
        for (text, kind, value), (plain_text, plain_kind, plain_value) in zip(one, other, strict=True):
            assert (text, kind) == (plain_text, plain_kind)
            assert value == (plain_value if plain_value is None else pytest.approx(plain_value, rel=1e-8))


def test_a_line_s_number_opens_its_record_and_sorting_shuts_it(ask):
    answer = ask("""
      page.querySelector("#answers details").open = true;
      const placeOf = (button) => Number(button.textContent.replace("line ", "")) - 1;
      const button = [...page.querySelectorAll("#answers tbody button")]
        .find((one) => window.recordOf(placeOf(one)).trace.length > 2);
      const place = placeOf(button);
      button.click();
      const row = button.closest("tr").nextElementSibling;
      const seen = row.getBoundingClientRect().height > 40;
      const said = Object.fromEntries([...row.querySelectorAll("dl div")].map((pair) =>
        [pair.querySelector("dt").textContent, pair.querySelector("dd").textContent]));
      const opened = button.getAttribute("aria-expanded");
      button.click();
      const shut = [page.querySelectorAll("tr.record").length, button.getAttribute("aria-expanded")];
      button.click();
      page.querySelector("#answers th button").click();
      const sorted = [page.querySelectorAll("tr.record").length, button.getAttribute("aria-expanded")];
      return { place, said, seen, opened, shut, sorted,
        all: Array.from({ length: 5 }, (_, r) => window.recordOf(r)) };
    """)
    records = make_records()
    assert (answer["seen"], answer["opened"]) == (True, "true")
    assert answer["shut"] == answer["sorted"] == [0, "false"]
    full = record_to_json(records[answer["place"]])
    assert list(answer["said"]) == list(full)
    for name in ("format", "method", "sequence", "data", "code", "status", "scene"):
        assert answer["said"][name] == full[name]
    assert answer["said"]["trace"].split(", ") == [f"{x:.9g}" for x in full["trace"]]
    for told_of, found in zip(records, answer["all"], strict=False):
        full = record_to_json(told_of)
        assert found.pop("trace") == pytest.approx(full.pop("trace"))
        for name, value in full.items():
            assert found[name] == (pytest.approx(value, rel=1e-8) if type(value) is float else value), name


def test_the_slider_and_the_pointer_choose_the_picture_and_move_the_cursor(ask):
    answer = ask("""
      const figure = page.querySelector("figure:has(.reel)");
      const [slider, said, image, cursor, view, plot] =
        ["input", "output", "img", ".cursor", ".view", ".plot"].map((s) => figure.querySelector(s));
      const state = () => {
        const [seen, whole] = [view.getBoundingClientRect(), image.getBoundingClientRect()];
        return {
          at: Number(slider.value), said: said.textContent, spoken: slider.getAttribute("aria-valuetext"),
          column: (seen.left - whole.left) / seen.width, row: (seen.top - whole.top) / seen.height,
          cursor: (cursor.getBoundingClientRect().left - plot.getBoundingClientRect().left)
            / plot.getBoundingClientRect().width,
        };
      };
      const states = [state()];
      slider.value = "11"; slider.dispatchEvent(new window.Event("input")); states.push(state());
      const box = plot.getBoundingClientRect();
      plot.dispatchEvent(new window.PointerEvent("pointermove", { pointerType: "mouse",
        clientX: box.left + JSON.parse(figure.querySelector(".reel").dataset.reel).x[3] * box.width + 1 }));
      states.push(state());
      const shape = view.getBoundingClientRect();
      slider.focus();
      return { states, x: JSON.parse(figure.querySelector(".reel").dataset.reel).x,
        shape: shape.width / shape.height, focused: page.activeElement === slider };
    """)
    assert [s["at"] for s in answer["states"]] == [6, 11, 3]
    for state in answer["states"]:
        assert state["said"] == state["spoken"]
        assert (state["column"], state["row"]) == pytest.approx((state["at"] % 8, state["at"] // 8), abs=0.02)
        assert state["cursor"] == pytest.approx(answer["x"][state["at"]], abs=0.005)
    assert answer["shape"] == pytest.approx(32 / 20, rel=0.01)
    assert answer["focused"]


def test_on_a_phone_only_tables_scroll_sideways_and_figures_can_be_read(ask):
    answer = ask(
        """
      const texts = [...page.querySelectorAll("svg text")].map((text) => {
        const figure = text.ownerSVGElement;
        const scale = figure.getBoundingClientRect().width / figure.viewBox.baseVal.width;
        return scale * parseFloat(window.getComputedStyle(text).fontSize);
      });
      return {
        page: page.documentElement.scrollWidth,
        inner: window.innerWidth,
        boxes: [...page.querySelectorAll(".wide")].map((box) => getComputedStyle(box).overflowX),
        board: page.querySelector("#leaderboard .wide").scrollWidth,
        names: Math.max(...[...page.querySelectorAll(".wide td.method:first-child, #board td.method")]
          .map((cell) => cell.getBoundingClientRect().width)),
        figures: [...page.querySelectorAll("figure")].map((f) => f.getBoundingClientRect().right),
        smallest: Math.min(...texts),
        controls: [...page.querySelectorAll("#filters select, #filters button")]
          .map((c) => c.getBoundingClientRect().height),
      };
    """,
        width=390,
    )
    assert answer["inner"] == 390
    assert answer["page"] <= 390
    assert set(answer["boxes"]) == {"auto"}
    assert answer["board"] > 390
    assert answer["names"] < 190  # they stay in view, and leave the better half to numbers
    assert max(answer["figures"]) <= 390
    assert answer["smallest"] >= 8
    assert min(answer["controls"]) >= 32


LUMA = """
  const luma = (colour) => { const [r, g, b] = colour.match(/[0-9.]+/g).map(Number);
    return (0.2126 * r + 0.7152 * g + 0.0722 * b) / 255; };
  const style = (what, name) => window.getComputedStyle(what)[name];
"""


@pytest.mark.parametrize("dark", [False, True])
def test_the_page_and_its_figures_follow_the_readers_scheme(ask, dark):
    answer = ask(
        LUMA
        + """
      const text = page.querySelector("svg text");
      return { paper: luma(style(page.body, "backgroundColor")), ink: luma(style(page.body, "color")),
        figure: luma(style(text, "fill")) };
    """,
        flags=("--force-dark-mode",) if dark else (),
    )
    assert (answer["paper"] < 0.2) == dark
    assert (answer["ink"] > 0.8) == dark
    assert (answer["figure"] > 0.8) == dark


def test_without_script_the_tables_and_figures_are_there_and_nothing_dead(ask):
    answer = ask(
        """
      const seen = (what) => what.getBoundingClientRect().height > 0;
      return {
        rows: [...page.querySelectorAll("#leaderboard #board tbody tr, #conditions tbody tr")].every(seen),
        answers: (page.querySelector("#answers details").open = true,
          [...page.querySelectorAll("#answers tbody tr a")].filter(seen).map((a) => a.getAttribute("href"))),
        figures: [...page.querySelectorAll("figure svg")].every(seen),
        sheet: [...page.querySelectorAll(".view img")].map((i) => i.getBoundingClientRect())
          .map((b) => b.width / b.height),
        dead: [...page.querySelectorAll("input, select, button, output, label, .cursor")].filter(seen).length,
        text: page.querySelector("h1").textContent,
      };
    """,
        scripts=False,
    )
    assert answer["rows"]
    assert answer["answers"] == ["records.jsonl"] * len(make_records())
    assert answer["figures"]
    assert answer["sheet"] == pytest.approx([8 * 32 / (2 * 20)], rel=0.01)  # all pictures, as a sheet
    assert answer["dead"] == 0
    assert answer["text"] == "small"


def test_on_paper_there_are_no_controls_and_nothing_scrolls(ask, folder, tmp_path):
    answer = ask(
        LUMA
        + """
      for (const rule of page.styleSheets[0].cssRules) {
        if (rule.media && rule.media.mediaText === "print") rule.media.mediaText = "all";
      }
      const seen = (what) => what.getBoundingClientRect().height > 0;
      const long = page.querySelector("figure svg").cloneNode();
      long.setAttribute("viewBox", "0 0 300 3000");
      page.querySelector(".plot").append(long);
      return {
        long: long.getBoundingClientRect().height,
        controls: [...page.querySelectorAll("nav, form, .reel input, #answers")].filter(seen).length,
        boxes: [...page.querySelectorAll(".wide")].map((b) => window.getComputedStyle(b).overflowX),
        figures: [...page.querySelectorAll("figure svg")].every(seen),
        wide: page.getElementById("board").getBoundingClientRect().width,
      };
    """,
        width=980,  # the smaller of A4 and letter, on its side, less margins of 1 cm
    )
    assert answer["controls"] == 0
    assert 300 < answer["long"] < 19 * 96 / 2.54  # a figure of many methods is cut by no edge of the paper
    assert set(answer["boxes"]) == {"visible"}
    assert answer["figures"]
    assert answer["wide"] <= 980
    paper = tmp_path / "page.pdf"
    run_chromium(f"--print-to-pdf={paper}", (folder / "index.html").as_uri(), profile=tmp_path / "profile")
    assert paper.read_bytes().startswith(b"%PDF-")
    assert paper.stat().st_size > 20_000


def test_long_and_hostile_names_neither_run_nor_widen_the_page(tmp_path):
    nasty = "<img src=x onerror=ran=1>" + "long" * 40
    records = tuple(replace(r, scene=nasty + r.scene, sequence=nasty + r.sequence) for r in make_records())
    made = replace(make_evaluation(), records=records)
    out = tmp_path / "page"
    write_report(out, evaluation=made, rows=rank_methods(records), title=nasty)
    answer = run_in_page(
        out,
        "return { wide: page.documentElement.scrollWidth, ran: window.ran === 1, title: page.title };",
        profile=tmp_path / "profile",
        width=390,
    )
    assert answer["wide"] <= 390
    assert not answer["ran"]
    assert answer["title"] == f"{nasty}: leaderboard"


def test_shares_are_printed_as_python_prints_them(ask):
    shares = [n / 8 for n in range(9)] + [n / 200 for n in range(201)] + [1 / 3, 2 / 3, 0.125 - 1e-16]
    answer = ask(f"return {shares}.map((share) => window.inWords({{ digits: -1, rule: 'mean' }}, share));")
    assert answer == [format_percent(share) for share in shares]
