"""The page in Chromium: used through its controls, on a phone, in dark mode, printed, and without its script."""

import csv
import io
import re
from dataclasses import replace

import pytest
from browser import CHROMIUM, NO_CHROMIUM, run_in_page
from handmade_evaluations import board_of, make_delivered, make_evaluation, make_records, write_board
from handmade_records import record

from saf_gen.benchmark.evaluate import DEFAULT_RECORDED_METHODS
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.plugin_description import describe_plugins
from saf_gen.benchmark.results import Evaluation
from saf_gen.leaderboard import Leaderboard, rank_methods
from saf_gen.leaderboard.report import write_evaluation
from saf_gen.leaderboard.report.page import add_sources, choose_answers
from saf_gen.leaderboard.tables import ranking, shade

pytestmark = [pytest.mark.browser, pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)]

READ = """
const board = page.getElementById("board");
const read = () => [...board.tBodies].filter((body) => !body.hidden).flatMap((body) => [...body.rows])
  .filter((row) => !row.hidden).map((row) => [...row.cells].map((cell) => cell.textContent));
const form = page.getElementById("filters");
const type = (text) => {
  form.elements.text.value = text;
  form.elements.text.dispatchEvent(new window.Event("input", { bubbles: true }));
};
const choose = (axis, name) => {
  const options = [...form.querySelectorAll(`optgroup[label="${axis}"] option`)];
  form.elements.selection.value = options.find((option) => option.text === name).value;
  form.elements.selection.dispatchEvent(new window.Event("input", { bubbles: true }));
};
const reset = async () => { form.reset(); await new Promise((done) => setTimeout(done, 20)); };
const status = () => page.getElementById("shown").textContent;
const head = (text) => [...board.querySelectorAll("thead tr:last-child th")]
  .find((th) => th.textContent === text);
const click = (text) => head(text).querySelector("button").click();
const answers = () => [...page.querySelectorAll("#answers tbody tr")]
  .map((row) => [...row.cells].map((cell) => cell.textContent));
const openAll = () => page.querySelectorAll("details.fold").forEach((fold) => { fold.open = true; });
const shownChart = async (selector) => { // a figure whose chart has come into view
  openAll();
  const figure = page.querySelector(selector);
  figure.querySelector(".chart").scrollIntoView();
  while (!figure.querySelector(".chart canvas")) await new Promise((done) => setTimeout(done, 10));
  return figure;
};
const summary = () => page.querySelector("#answers [role=status]").textContent;
"""


BROKEN_WORDS = """
const brokenWords = (cell) => { // parts of a name, between its plus signs, that take more than one line
  const broken = [];
  const walk = page.createTreeWalker(cell, window.NodeFilter.SHOW_TEXT);
  for (let text = walk.nextNode(); text; text = walk.nextNode()) {
    for (const part of text.data.matchAll(/[^+:,]+/g)) {
      const range = page.createRange();
      range.setStart(text, part.index);
      range.setEnd(text, part.index + part[0].length);
      if (new Set([...range.getClientRects()].map((line) => Math.round(line.top))).size > 1) broken.push(part[0]);
    }
  }
  return broken;
};
"""
TIMES = {"time_to_focus_s": 0.2, "seconds": 0.01}


def python_rows(keep=lambda record: True):
    """The leaderboard's rows for some of the records, computed in Python."""
    records = make_records()
    shown = add_sources(shade(board_of(records).ranking), make_evaluation().plugins).shown
    return [[c.text(row) for c in shown] for row in rank_methods([r for r in records if keep(r)])]


@pytest.fixture(scope="module")
def folder(small_report):
    return small_report[0]


@pytest.fixture(scope="module")
def ask(folder):
    def run(script, **options):
        return run_in_page(folder, READ + script, **options)

    return run


def test_the_page_loads_alone_and_its_policy_stops_what_would_ask_the_network_or_run_another_script(ask):
    answer = ask("""
      const loaded = window.performance.getEntriesByType("resource").map((e) => e.name);
      const stopped = [];
      page.addEventListener("securitypolicyviolation", (e) => stopped.push(e.effectiveDirective));
      const script = page.createElement("script");
      script.textContent = "window.ran = true";
      page.body.append(script);
      const image = page.createElement("img");
      image.src = "other.png";
      page.body.append(image);
      const wait = () => new Promise((done) => setTimeout(done, 20));
      for (let waited = 0; stopped.length < 2 && waited < 100; waited++) await wait();
      await wait();
      return { loaded, stopped: stopped.sort(), ran: window.ran === true };
    """)
    assert answer == {"loaded": [], "stopped": ["img-src", "script-src-elem"], "ran": False}


def test_a_column_sorts_both_ways_and_says_so(ask):
    answer = ask("""
      const at = [...page.querySelectorAll("#board thead tr:last-child th")].indexOf(head("err DoF"));
      const values = () => read().map((cells) => cells[at]);
      const sorted = () => [...page.querySelectorAll("#board th[aria-sort]")]
        .map((th) => [th.textContent, th.getAttribute("aria-sort")]);
      click("err DoF"); const up = [values(), sorted()];
      click("err DoF"); const down = [values(), sorted()];
      click("≤1 DoF"); const share = [read().map((c) => c[4]), sorted()];
      click("method"); const names = [read().map((c) => c[2]), sorted()];
      const table = page.querySelector("#conditions table");
      const row = table.tBodies[0].rows[0];
      row.cells[1].textContent = "–";
      const unknown = [1, 2].map(() => {
        table.querySelectorAll("th button")[1].click();
        return [...table.tBodies[0].rows].at(-1) === row;
      });
      return { up, down, share, names, unknown };
    """)
    errors = [float(v) for v in answer["up"][0]]
    assert errors == sorted(errors)
    assert answer["up"][1] == [["err DoF", "ascending"]]
    assert answer["down"] == [answer["up"][0][::-1], [["err DoF", "descending"]]]
    assert answer["share"][1] == [["≤1 DoF", "descending"]]  # fractions start with the best
    assert answer["names"][0] == sorted(answer["names"][0])
    assert answer["unknown"] == [True, True]  # an unknown value stays last


def test_a_selection_shows_the_rows_that_python_ranked_and_stays_sorted(ask):
    answer = ask("""
      const whole = read();
      choose("Light schedule", "ramp");
      const [ramp, said] = [read(), status()];
      choose("Split", "train"); const train = read();
      click("method"); const sorted = read().map((cells) => cells[2]);
      choose("Scene", "usaf"); const still = read().map((cells) => cells[2]);
      await reset();
      return { whole, ramp, said, train, sorted, still, again: read(), all: status() };
    """)
    assert answer["whole"] == answer["again"] == python_rows()  # a reset also clears the order
    assert answer["ramp"] == python_rows(lambda r: r.what.light == "ramp")
    assert answer["train"] == python_rows(lambda r: r.what.split == "train")
    assert (answer["said"], answer["all"]) == (
        "4 of 4 methods, 6 of 12 sequences.",
        "4 of 4 methods, 12 of 12 sequences.",
    )
    assert answer["sorted"] == answer["still"] == sorted(answer["sorted"])


def test_methods_are_found_by_words_of_their_names(ask):
    answer = ask("""
      const names = () => read().map((cells) => cells[2]).sort();
      type("ER egs"); const words = names();
      type("sd+"); const measure = [names(), status()];
      choose("Split", "train"); const both = names();
      await reset(); type("nothing"); const none = [names(), status(), answers()];
      await reset();
      return { words, measure, both, none, all: names().length };
    """)
    assert answer["words"] == ["er_count+egs_code"]
    assert answer["measure"] == [["sd+argmax", "sd+egs_code"], "2 of 4 methods, 12 of 12 sequences."]
    assert answer["both"] == ["sd+argmax", "sd+egs_code"]
    assert answer["none"] == [[], "0 of 4 methods, 12 of 12 sequences.", []]
    assert answer["all"] == 4


def test_single_answers_follow_what_is_shown_and_a_methods_name_lists_its_own(ask):
    answer = ask("""
      const all = answers();
      choose("Split", "train"); type("sd+");
      const [some, said] = [answers(), summary()];
      board.querySelector("tbody:not([hidden]) tr:not([hidden]) a").click();
      const [own, whose, open] = [answers(), summary(), page.querySelector("#answers details").open];
      const notes = page.querySelectorAll("#answers td b").length;
      return { all, some, said, own, whose, open, notes, first: read()[0][2] };
    """)
    records = make_records()
    kept = [r for r in records if r.what.split == "train" and r.who.method.startswith("sd+")]
    own = [r for r in kept if r.who.method == answer["first"]]
    assert len(answer["all"]) == len(records)
    for shown, expected in ((answer["some"], kept), (answer["own"], own)):
        assert sorted(line[:2] for line in shown) == sorted([r.who.method, r.what.sequence] for r in expected)
        lines = [records[int(line[7]) - 1] for line in shown]
        assert [[r.who.method, r.judgement.note] for r in lines] == [line[::8] for line in shown]
    assert answer["said"] == f"{len(kept)} answers, the worst first."
    assert answer["whose"].startswith(f"{len(own)} answers of {answer['first']}, the worst first.")
    assert (answer["open"], answer["notes"]) == (True, 0)


def test_the_slider_and_the_pointer_choose_the_picture_and_move_the_cursor(ask):
    answer = ask("""
      const figure = await shownChart("figure:has(.viewer)");
      const [slider, said, image, view, over, cursor] =
        ["input", "output", "img", ".view", ".u-over", ".u-cursor-x"].map((s) => figure.querySelector(s));
      const state = async () => {
        await new Promise((done) => setTimeout(done, 50));
        const [seen, whole] = [view.getBoundingClientRect(), image.getBoundingClientRect()];
        return {
          at: Number(slider.value), said: said.textContent, spoken: slider.getAttribute("aria-valuetext"),
          column: (seen.left - whole.left) / seen.width, row: (seen.top - whole.top) / seen.height,
          cursor: (cursor.getBoundingClientRect().right - over.getBoundingClientRect().left)
            / over.getBoundingClientRect().width,
        };
      };
      const states = [await state()];
      slider.value = "11"; slider.dispatchEvent(new window.Event("input")); states.push(await state());
      const box = over.getBoundingClientRect();
      const { x } = JSON.parse(figure.querySelector(".viewer").dataset.viewer);
      const chart = JSON.parse(figure.querySelector(".chart").dataset.chart);
      const ends = [chart.area.x[0], chart.area.x[chart.area.x.length - 1]];
      const along = x.map((place) => (place - ends[0]) / (ends[1] - ends[0]));
      over.dispatchEvent(new window.MouseEvent("mousemove", { bubbles: true,
        clientX: box.left + along[3] * box.width + 1, clientY: box.top + 20 }));
      states.push(await state());
      const shape = view.getBoundingClientRect();
      slider.focus();
      return { states, along,
        shape: shape.width / shape.height, focused: page.activeElement === slider };
    """)
    assert [s["at"] for s in answer["states"]] == [6, 11, 3]
    for state in answer["states"]:
        assert state["said"] == state["spoken"]
        assert (state["column"], state["row"]) == pytest.approx((state["at"] % 8, state["at"] // 8), abs=0.02)
        assert state["cursor"] == pytest.approx(answer["along"][state["at"]], abs=0.02)
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
        names: Math.max(...[...page.querySelectorAll(".wide td.name:first-child, #board td.name")]
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
    assert answer["board"] <= 390  # its main columns fit
    assert answer["names"] < 190  # they stay in view, and leave more than half of the width to numbers
    assert max(answer["figures"]) <= 390
    assert answer["smallest"] >= 8
    assert min(answer["controls"]) >= 32


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """A page as of the usual methods on ten scenes."""
    methods = (*DEFAULT_RECORDED_METHODS, "fine_structure+bell_vote:area=true,block=7")
    records = [
        record(method, f"{scene}-{light}", 0.06 * number + 0.1 * scene, scene=f"scene{scene}", light=light, **TIMES)
        for number, method in enumerate(methods)
        for scene in range(10)
        for light in ("constant", "continuous", "sudden")
    ]
    made = Evaluation(tuple(records), (), (), plugins=describe_plugins(map(parse_method, methods)))
    out = tmp_path_factory.mktemp("usual")
    write_evaluation(out, Leaderboard.of(made), title="usual", delivered=make_delivered())
    return out


@pytest.mark.parametrize(("width", "height", "rows"), [(1280, 800, 8), (390, 844, 4)])
def test_the_first_screen_has_the_answer_and_the_page_few_screens(usual, width, height, rows):
    answer = run_in_page(
        usual,
        """
      const seen = (what) => what.getBoundingClientRect();
      const texts = [...page.querySelectorAll("svg text")].map(seen);
      const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
      return {
        rows: [...page.querySelectorAll("#board tbody:not([hidden]) tr")].map((row) => seen(row).bottom),
        lead: seen(page.querySelector(".lead")).bottom,
        long: page.documentElement.scrollHeight,
        overlaps: texts.flatMap((a, at) => texts.slice(at + 1).filter((b) => meet(a, b))).length,
        texts: texts.length,
        words: [...page.querySelectorAll("#board td.name, .delivered code")].filter((cell) => seen(cell).height > 0)
          .flatMap((cell) => brokenWords(cell)),
      };
    """.replace("const seen", BROKEN_WORDS + "const seen", 1),
        width=width,
    )
    assert sum(bottom <= height for bottom in answer["rows"]) >= rows
    assert answer["lead"] < height / 3
    assert answer["long"] <= (6 if width == 1280 else 9) * height
    assert answer["texts"] > 8
    assert answer["overlaps"] == 0
    assert answer["words"] == []


def test_a_page_that_holds_some_of_the_answers_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(choose_answers, "__kwdefaults__", {"max_answers": 24})
    monkeypatch.setattr("saf_gen.leaderboard.report.page.MAX_ANSWERS", 3)
    made = replace(make_evaluation(), sweeps=())
    write_evaluation(tmp_path / "some", Leaderboard.of(made), title="some")
    script = """
      const all = summary();
      page.querySelector("#board tbody a").click();
      const own = [summary(), answers().length];
      await reset(); choose("Split", "test"); const part = [summary(), status()];
      return { all, own, part };
    """
    answer = run_in_page(tmp_path / "some", READ + script)
    assert answer["all"] == "The 3 worst of 48 answers."
    assert re.match(r"The \d+ worst of the \d+ answers of .* in this page; records.jsonl has 12\.", answer["own"][0])
    assert re.match(r"The \d+ worst of the \d+ answers in this page; records.jsonl has 32\.", answer["part"][0])
    assert answer["part"][1] == "4 of 4 methods, 8 of 12 sequences."


MAIN = ["#", "method", "≤1 DoF", "err DoF"]
MANY_LIGHTS = tuple(f"a rather long name of a light {number}" for number in range(8))


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """A page with long method names and more lights than fit on any screen."""
    methods = ("structure_calibrated+photon_aware", "sd+argmax", "mfdct_code_n_tfi+sgfs_code:dt=50,window=100")
    records = [
        record(method, f"{scene}-{light}", 0.1, scene=scene, light=light, time_to_focus_s=0.1)
        for method in methods
        for scene in "abc"
        for light in MANY_LIGHTS
    ]
    out = tmp_path_factory.mktemp("crowded")
    write_board(out, records)
    return out, [column.header for column in ranking(rank_methods(records)).shown]


COLUMNS = """
const box = page.querySelector("#leaderboard .wide");
const columns = () => [...page.querySelectorAll("#board thead tr:last-child th")]
  .filter((head) => head.getBoundingClientRect().width > 0).map((head) => head.textContent);
const groups = () => [...page.querySelectorAll("#board .groups > *")].filter((cell) => !cell.hidden)
  .reduce((total, cell) => total + cell.colSpan, 0);
const narrow = [columns(), box.scrollWidth - box.clientWidth, groups()];
page.querySelector("[name=whole]").click();
return { narrow, wide: [columns(), groups()] };
"""


@pytest.mark.parametrize("width", [1280, 390])
def test_the_main_columns_need_no_sideways_scrolling_and_all_can_be_asked_for(crowded, tmp_path, width):
    out, every = crowded
    answer = run_in_page(out, COLUMNS, width=width)
    columns, beyond, spanned = answer["narrow"]
    assert beyond <= 0
    assert spanned == len(columns)
    assert [name for name in columns if name in MAIN] == MAIN
    assert (len(columns) > len(MAIN)) == (width == 1280)
    assert answer["wide"] == [every, len(every)]


def test_a_table_can_be_saved_as_csv_of_what_it_shows(ask):
    answer = ask("""
      const files = [];
      window.URL.createObjectURL = (blob) => { files.push(blob); return "#"; };
      window.HTMLAnchorElement.prototype.click = function () { files.push(this.download); };
      const csv = (table) => table.closest(".wide").nextElementSibling.click();
      type("sd+"); choose("Split", "train"); click("method"); csv(board);
      const rows = read();
      const columns = [...board.querySelectorAll("thead tr:last-child th")]
        .map((head) => window.getComputedStyle(head).display !== "none");
      const table = page.querySelector("#conditions table");
      [table.tBodies[0].rows[0].cells[0], table.tBodies[0].rows[0].cells[1]]
        .forEach((cell, at) => { cell.textContent = ["=1+1", 'a "b", c'][at]; });
      csv(table);
      return { name: files[1], text: await files[0].text(), rows, columns, hostile: await files[2].text() };
    """)
    assert answer["name"] == "Leaderboard.csv"
    lines = list(csv.reader(io.StringIO(answer["text"])))
    assert lines[1:] == [
        [text for text, is_shown in zip(row, answer["columns"], strict=True) if is_shown] for row in answer["rows"]
    ]
    assert len(lines) == 3
    assert {"success: ≤1 DoF", "≤1 DoF by light: ramp", "error: err DoF"} <= set(lines[0])
    assert list(csv.reader(io.StringIO(answer["hostile"])))[1][:2] == ["'=1+1", 'a "b", c']


def test_a_sweep_plays_and_is_shown_as_tfp_tfi_or_spikes(ask):
    answer = ask("""
      const viewer = page.querySelector(".viewer");
      const [play, slider, kind] = ["button", "input", "select"].map((name) => viewer.querySelector(name));
      const seen = () => [...viewer.querySelectorAll("img")].filter((i) => i.getBoundingClientRect().width > 0)
        .map((i) => i.className);
      const kinds = [...kind.options].map((option) => {
        kind.value = option.value; kind.dispatchEvent(new window.Event("input", { bubbles: true }));
        return [option.value, seen(), viewer.querySelector(".box").hidden];
      });
      const from = Number(slider.value), at = [], pace = [], real = window.setInterval;
      window.setInterval = (show, ms) => { pace.push(ms); return real(show, ms / 10); }; // ten times as fast
      const watch = new window.MutationObserver(() => at.push(Number(slider.value)));
      watch.observe(slider, { attributes: true, attributeFilter: ["aria-valuetext"] });
      play.click();
      const pressed = play.getAttribute("aria-pressed");
      while (at.length < 12) await new Promise((done) => setTimeout(done, 10));
      play.click();
      await new Promise((done) => setTimeout(done, 0));
      const played = at.length;
      await new Promise((done) => setTimeout(done, 200));
      return { kinds, from, pace, at: at.slice(0, 12), pressed, stopped: play.getAttribute("aria-pressed"),
        still: at.length === played, names: [play, slider, kind].map((c) => c.getAttribute("aria-label")) };
    """)
    assert answer["kinds"] == [["TFP", ["TFP"], False], ["TFI", ["TFI"], False], ["spikes", ["spikes"], True]]
    assert answer["at"] == [(answer["from"] + step) % 16 for step in range(1, 13)]  # and then starts again
    assert len(answer["pace"]) == 1
    assert 50 <= answer["pace"][0] <= 500
    assert (answer["pressed"], answer["stopped"], answer["still"]) == ("true", "false", True)
    assert all("camel-constant" in name for name in answer["names"])


def test_a_link_to_a_measure_or_its_code_opens_it(ask):
    answer = ask("""
      const open = async (link) => {
        link.click();
        await new Promise((done) => window.addEventListener("hashchange", () => setTimeout(done, 20), { once: true }));
        return page.querySelector(link.getAttribute("href")).open;
      };
      board.querySelector("tbody:not([hidden]) a").click();
      const link = page.querySelector("#answers [role=status] a");
      const plugin = page.querySelector(link.getAttribute("href"));
      const before = plugin.open;
      return [before, await open(link), await open(plugin.querySelector("a[href^='#code']"))];
    """)
    assert answer == [False, True, True]


AUDIT = """
page.querySelectorAll("details").forEach((details) => { details.open = true; });
const channels = (colour) => colour.match(/[0-9.]+/g).slice(0, 3).map((c) => Number(c) / 255)
  .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
const light = (colour) => channels(colour).reduce((sum, c, at) => sum + c * [0.2126, 0.7152, 0.0722][at], 0);
const contrast = (a, b) => { const [low, high] = [light(a), light(b)].sort((p, q) => p - q);
  return (high + 0.05) / (low + 0.05); };
const style = (what) => window.getComputedStyle(what);
const probe = page.body.appendChild(page.createElement("i"));
const named = (name) => { probe.style.color = `var(${name})`; return style(probe).color; };
const papers = [named("--paper"), named("--raised")];
const isClear = (colour) => colour === "transparent" || /, 0\\)$/.test(colour);
const behind = (what) => { while (what && isClear(style(what).backgroundColor)) what = what.parentElement;
  return what ? style(what).backgroundColor : papers[0]; };
const shown = [...page.body.querySelectorAll("*")].filter((what) => what.checkVisibility());
const plain = shown.filter((what) => !what.closest("svg, td[style]")
  && [...what.childNodes].some((node) => node.nodeType === 3 && node.data.trim()));
const ratios = [
  ...plain.map((what) => contrast(style(what).color, behind(what))),
  ...[...page.querySelectorAll("svg text")].map((text) => contrast(style(text).fill, papers[0])),
  ...[...page.querySelectorAll("td[style]")].flatMap((cell) =>
    [...papers, named("--bar")].map((paper) => contrast(style(cell).color, paper))),
];
const nameOf = (what) => (what.getAttribute("aria-label") || what.getAttribute("alt") || what.textContent.trim()
  || [...(what.labels || [])].map((label) => label.textContent.trim()).join("") || what.title
  || (what.getAttribute("aria-labelledby") || "").split(" ")
    .map((id) => (page.getElementById(id) || {}).textContent).join(""));
const controls = "a[href], button, input, select, textarea, summary, img, [role=img], [role=slider], [role=group]";
const nameless = shown.filter((what) => what.matches(controls) && !nameOf(what))
  .map((what) => what.outerHTML.slice(0, 200));
const ids = [...page.querySelectorAll("[id]")].map((what) => what.id);
const levels = shown.filter((what) => /^H[1-6]$/.test(what.tagName)).map((what) => Number(what.tagName[1]));
const headless = [...page.querySelectorAll("table")].filter((table) => !table.querySelector("th")).length;
return {
  nameless, headless, texts: ratios.length, contrast: Math.min(...ratios), lang: page.documentElement.lang,
  mains: page.querySelectorAll("main").length, titles: levels.filter((level) => level === 1).length,
  twice: ids.filter((id, at) => ids.indexOf(id) !== at),
  skips: levels.filter((level, at) => at && level > levels[at - 1] + 1).length,
};
"""


@pytest.mark.parametrize("dark", [False, True])
def test_an_audit_of_accessibility_finds_nothing(folder, dark):
    """What WCAG 2.2 AA requires and a program can see: names, headings, a language, and a contrast of 4.5 of all texts.

    That colours stand out in the other scheme, too, is computed from the style sheet in test_report_page.py.
    """
    found = run_in_page(folder, READ + AUDIT, width=390, dark=dark)
    assert found.pop("texts") > 500
    assert found.pop("contrast") >= 4.5
    nothing = {"nameless": [], "headless": 0, "twice": [], "skips": 0}
    assert found == {**nothing, "lang": "en", "mains": 1, "titles": 1}


def test_the_page_can_be_used_by_keyboard_in_visible_order(ask):
    """Every control and folded section gets the focus by Tab, in the order of the page, and shows it."""
    answer = ask("""
      const reached = [...page.querySelectorAll("a[href], button, input, select, summary, [tabindex]")]
        .filter((what) => what.getBoundingClientRect().height > 0 && what.checkVisibility());
      const shown = reached.map((what) => {
        what.focus({ focusVisible: true });
        const { outlineStyle, outlineWidth } = window.getComputedStyle(what);
        return [page.activeElement === what, outlineStyle !== "none" && parseFloat(outlineWidth) > 0];
      });
      const places = reached.map((what) => what.tabIndex);
      const heights = [...page.querySelectorAll("main section[id]")].map((what) => what.getBoundingClientRect().top);
      return { count: reached.length, shown, places, heights };
    """)
    assert answer["count"] > 40
    assert all(focused and outlined for focused, outlined in answer["shown"])
    assert set(answer["places"]) == {0}  # nothing is left out of the order or moved to its front
    assert answer["heights"] == sorted(answer["heights"])


@pytest.mark.parametrize("dark", [False, True])
def test_the_page_and_its_figures_follow_the_readers_scheme(ask, dark):
    answer = ask(
        """
      const luma = (colour) => { const [r, g, b] = colour.match(/[0-9.]+/g).map(Number);
        return (0.2126 * r + 0.7152 * g + 0.0722 * b) / 255; };
      const style = (what, name) => window.getComputedStyle(what)[name];
      const text = page.querySelector("svg text");
      return { paper: luma(style(page.body, "backgroundColor")), ink: luma(style(page.body, "color")),
        figure: luma(style(text, "fill")) };
    """,
        dark=dark,
    )
    assert (answer["paper"] < 0.2) == dark
    assert (answer["ink"] > 0.8) == dark
    assert (answer["figure"] > 0.5) == dark


def test_without_script_the_tables_and_figures_are_there_and_nothing_dead(ask):
    answer = ask(
        """
      const seen = (what) => what.getBoundingClientRect().height > 0;
      return {
        rows: [...page.querySelectorAll("#board tbody:not([hidden]) tr, #conditions tbody tr")].every(seen),
        selections: [...page.querySelectorAll("#board tbody[hidden] tr")].some(seen),
        answers: (page.querySelector("#answers details").open = true,
          [...page.querySelectorAll("#answers tbody tr a")].filter(seen).map((a) => a.getAttribute("href"))),
        figures: [...page.querySelectorAll("figure svg")].every(seen),
        sheet: [...page.querySelectorAll(".view img")].filter(seen).map((i) => i.getBoundingClientRect())
          .map((b) => b.width / b.height),
        dead: [...page.querySelectorAll("input, select, button, output, label, .cursor")].filter(seen).length,
        text: page.querySelector("h1").textContent,
      };
    """,
        scripts=False,
    )
    assert answer["rows"]
    assert not answer["selections"]
    assert answer["answers"] == ["records.jsonl"] * len(make_records())
    assert answer["figures"]
    assert answer["sheet"] == pytest.approx([8 * 32 / (2 * 20)], rel=0.01)  # all pictures, as a sheet
    assert answer["dead"] == 0
    assert answer["text"] == "small"
