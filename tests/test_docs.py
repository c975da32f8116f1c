"""What pages show runs and is printed, their links lead somewhere, and their tables agree with the code.

The blocks of a page are run in order at a *desk*: a folder like a checkout, with small versions of the datasets that
pages name. A yaml or python block whose first line is a comment with a path in ``recipes/``, ``scenes/`` or
``my_method/``, or a file ``my_...py``, is first written there, so that the commands below it find it.

A block of ``output`` shows lines that the block of commands or of Python code before it prints, or their beginnings up
to ``…``. At a desk, other figures are printed, because renders are smaller, so words are compared, but for what needs
only the sample. A long test runs these pages at full size and compares figures, too: within 5 %, or one in the last
digit, or 12 % (one recording of nine) of a per cent; ranks may differ. ``pytest tests/test_docs.py -m long --accept``
rewrites the blocks.
"""

import io
import json
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from copy import deepcopy
from dataclasses import dataclass, is_dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from pydantic import TypeAdapter
from small_dataset import HERE, SCENES
from whole_scenes import write_whole_scene

import saf_gen.leaderboard.report.evaluation_folder  # noqa: F401  so that reports are made without figures
from saf_gen import SpikeWindows
from saf_gen.benchmark.method_folder import CARD, MethodCard
from saf_gen.benchmark.method_spec import DEFAULT_CLOSED_LOOP_METHODS, parse_method
from saf_gen.cli import _terminal, main, root_command
from saf_gen.core.config import registry
from saf_gen.generate import resolve
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.optics.lens_card import LensCard
from saf_gen.parts import commands as commands_lens
from saf_gen.plugins.lights import gains_at_readouts
from saf_gen.plugins.lights._product import multiply
from saf_gen.scene.scene_folder import SceneCard

ROOT = HERE.parent
FIRST = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "datasets/README.md")
PAGES = [p for p in (*(ROOT / n for n in FIRST), *sorted((ROOT / "docs").rglob("*.md"))) if p.exists()]
COMMAND = root_command()
TARGETS = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
FORMATS = r"saf-gen (stream|dataset|focal stack \d+|record \d+)"  # format names in files
ROOT_OPTIONS = {"--version", "--install-completion"}
ONLY_ON_THE_SITE = {"commands.md", "python.md"}
TEXTS = {".py", ".in", ".yaml", ".yml", ".md", ".xml", ".html", ".js", ".css", ".def", ".sh", ""}
"""Endings of files that may name a page."""
OPTIONAL = {"torch", "huggingface_hub"}
"""Packages without which a block that names them is not run, because no test needs them."""
PRINTED: dict[tuple[str, ...], str] = {}
"""Output of the commands that read the quickstart's dataset, which are not run again."""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language ('' if none is named), its text, and its page and line."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def where(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def path(self) -> str:
        """The path in its first line, '' if there is no path."""
        named = re.match(r"# ((?:recipes|scenes|my_method)/\S+|my_\w+\.py)\n", self.text)
        return named[1] if named else ""


def page_blocks(page: Path) -> Iterator[Block]:
    text = page.read_text(encoding="utf-8")
    for found in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        yield Block(page, text.count("\n", 0, found.start()) + 2, found[1], found[2])


BLOCKS = [block for page in PAGES for block in page_blocks(page)]


def blocks_in(language: str) -> list[Any]:
    return [pytest.param(b, id=b.where) for b in BLOCKS if b.language == language]


def words_of(text: str) -> set[str]:
    return set(re.findall(r"\w+", text))


def commands(block: Block) -> list[list[str]]:
    """The words of every command in a shell block."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def split_env(words: list[str]) -> tuple[dict[str, str], list[str]]:
    """Leading NAME=VALUE words, and the rest."""
    count = next(i for i, word in enumerate(words) if not re.match(r"[A-Z_]+=", word))
    return dict(word.split("=", 1) for word in words[:count]), words[count:]


# --- what needs no dataset ---------------------------------------------------------------------------


def test_every_language_of_a_block_is_one_that_is_tested():
    assert {b.language for b in BLOCKS} <= {"", "sh", "output", "yaml", "python", "toml", "csv"}


@pytest.mark.parametrize("block", blocks_in("yaml"))
def test_a_yaml_block_is_read_by_the_code_it_is_for(block, tmp_path):
    """A recipe, the card of a scene or method, or some keys of a card or recipe, added to an example."""
    data = yaml.safe_load(block.text)
    if set(data) == {"lens"}:
        TypeAdapter(LensCard).validate_python(data["lens"]).build_drive()
        return
    if "lens" in data:
        assert SceneCard.model_validate(data).id == Path(block.path).parent.name
        return
    if "lights" not in data and set(data) <= set(SceneCard.model_fields) - {"camera"}:
        card = next(b for b in BLOCKS if b.path == "scenes/printed_card/scene.yaml")
        SceneCard.model_validate(yaml.safe_load(card.text) | data)
        return
    if block.path.endswith(CARD):
        MethodCard.model_validate(data)
        return
    if "splits" not in data:
        assert set(data) <= set(Recipe.model_fields), "neither a recipe nor a part of one"
        data = yaml.safe_load((ROOT / "recipes/quickstart.yaml").read_text()) | data
        for split in data["splits"].values():
            split["lights"] = list(data["lights"])
    path = tmp_path / "recipe.yaml"
    path.write_text(yaml.safe_dump(data))
    for csv_block in (b for b in BLOCKS if b.page == block.page and b.language == "csv"):
        path.with_name(Path(csv_block.path).name).write_text(csv_block.text)
    recipe = read_recipe(path)
    assert block.path in ("", f"recipes/{recipe.name}.yaml")


@cache
def anchors(page: Path) -> frozenset[str]:
    """The anchors that a link may name after #: headings, as GitHub and the site of `make docs` write them."""
    headings = re.findall(r"^#+ (.*)$", without_blocks(page.read_text(encoding="utf-8")), re.MULTILINE)
    return frozenset(re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings)


def without_blocks(text: str) -> str:
    return re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def links_of(file: Path) -> Iterator[str]:
    """Yield the links of a page, and the pages of docs/ that any other file names."""
    text = file.read_text(encoding="utf-8")
    up = os.path.relpath(ROOT, file.parent)
    if file.suffix == ".md":
        yield from (link for link in re.findall(r"\]\(([^)]+)\)", without_blocks(text)) if "://" not in link)
    yield from (f"{up}/{name}" for name in re.findall(r"(?<![\w/.])docs/[\w/-]+\.md(?:#[\w-]+)?", text))


def leads_somewhere(page: Path, link: str) -> bool:
    path, _, anchor = link.partition("#")
    target = page.parent / path if path else page
    return target.exists() and (not anchor or anchor in anchors(target))


def test_every_link_leads_somewhere():
    """Links of pages and notes, and names of pages in code, messages, templates, cards and workflows."""
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True).stdout.splitlines()
    if not tracked:
        pytest.skip("this is no checkout")
    texts = [ROOT / name for name in tracked if Path(name).suffix in TEXTS and not name.startswith("tests/")]
    missing = [
        f"{file.relative_to(ROOT)}: {link}"
        for file in texts
        if file.is_file()
        for link in links_of(file)
        if not link.startswith("../../actions/")  # badges, relative to the site
        and Path(link).name not in ONLY_ON_THE_SITE
        and not leads_somewhere(file, link)
    ]
    assert missing == []


def test_a_link_to_a_page_or_heading_that_does_not_exist_is_dead(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A page\n\n[one](page.md#a-page) [two](#b-page) [three](pages.md)\n")
    assert [link for link in links_of(page) if not leads_somewhere(page, link)] == ["#b-page", "pages.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_paths_and_commands_that_a_page_names_exist(page):
    """Also in blocks without a language, which are not run."""
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`((?:saf_gen|tests|tools)/[^`]*|(?:recipes|scenes|docs)/\w[^`]*)`", without_blocks(text))
    made = {path for block in page_blocks(page) for path in (Path(block.path), Path(block.path).parent)}
    real = [n for n in named if not re.search(r"[A-Z]{3}|[*<]|/my_", n) and not {Path(n), Path(n).parent} & made]
    missing = [name for name in real if not (ROOT / name).exists()]
    spans = re.findall(r"`(saf-gen\s\w[^`]*)`", without_blocks(text))
    silent = [b for b in page_blocks(page) if not b.language and "saf-gen " in b.text and "saf-gen: " not in b.text]
    spans += [shlex.join(words) for block in silent for words in commands(block)]
    missing += [span for span in spans if not (re.fullmatch(FORMATS, span) or is_known(span.split()))]
    assert missing == []


def is_known(words: list[str]) -> bool:
    """Return whether these are words of another program, or a command of saf-gen with options that it has."""
    if words[0] != "saf-gen":
        return True
    command, rest = COMMAND, [word for word in words[1:] if not word.startswith("[")]
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        if rest[0] not in command.commands:
            return False
        command = command.commands[rest.pop(0)]
    known = {option for parameter in command.params for option in parameter.opts} | {"--help"}
    return {word.split("=")[0] for word in rest if word.startswith("--")} <= known | ROOT_OPTIONS


def test_every_page_is_in_the_index():
    index, docs = (ROOT / "docs/README.md").read_text(encoding="utf-8"), ROOT / "docs"
    pages = [p.relative_to(docs).as_posix() for p in docs.rglob("*.md")]
    assert [page for page in pages if f"({page})" not in index] == ["README.md"]


# --- tables ------------------------------------------------------------------------------------------


def table(page: str, heading: str, another: str = "|") -> list[list[str]]:
    """The rows of the table with this first heading and, if given, another one; cells are stripped."""
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(f"| {heading} |") and another in line)
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]])
    return rows


def ticked(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def test_the_methods_that_run_in_the_closed_loop_are_those_of_the_code():
    shown = {}
    for searches, measures, how in table("docs/methods.md", "search", "how it moves the lens"):
        shown |= {f"{m}+{s}": how for s in ticked(searches) for m in ticked(measures)}
    real = {name: commands_lens(parse_method(name).search) for name in DEFAULT_CLOSED_LOOP_METHODS}
    assert shown == {name: "by its own commands" if own else "by a sweep" for name, own in real.items()}


def change(*keys: str, to: Any) -> Callable[[dict[str, Any]], None]:
    def apply(recipe: dict[str, Any]) -> None:
        for key in keys[:-1]:
            recipe = recipe.setdefault(key, {})
        recipe[keys[-1]] = to

    return apply


CHANGES = {
    "seed": change("seed", to=12),
    "camera.sensor": change("camera", "sensor", to="ideal"),
    "camera.frames": change("camera", "frames", to=4008),
    "camera.exposure.mean_rate": change("camera", "exposure", "mean_rate", to=0.25),
    "camera.noise.shot": change("camera", "noise", "shot", to=False),
    "lights.flicker": change("lights", "flicker", "hz", to=120),
    "splits.test.repeats": change("splits", "test", "repeats", to=3),
    "camera.exposure.f_number": change("camera", "exposure", "f_number", to=4.0),
    "focus.motion": change("focus", "motion", to={"kind": "sweep", "to": 0.9}),
    "focus.positions": change("focus", "positions", to=33),
    "render.samples": change("render", "samples", to=32),
    "render.max_depth": change("render", "max_depth", to=3),
}


def test_what_is_kept_after_a_change_is_what_the_table_says(tmp_path):
    shown = next(b for b in BLOCKS if b.path == "recipes/lamp_study.yaml")

    def fingerprints(apply: Callable[[dict[str, Any]], None]) -> tuple[dict[str, str], dict[str, str]]:
        recipe = deepcopy(yaml.safe_load(shown.text))
        apply(recipe)
        path = tmp_path / "recipe.yaml"
        path.write_text(yaml.safe_dump(recipe))
        work = resolve.resolve_recipe(path)
        stacks = {s.planned.id: s.time_stack.specs[0].key for s in work.sequences}
        made = {s.planned.id: s.fingerprint(stacks[s.planned.id]) for s in work.sequences}
        return {s.scene.id: stacks[s.planned.id] for s in work.sequences}, made

    stacks, before = fingerprints(lambda recipe: None)
    rows = table("docs/recipes.md", "you change")
    assert {ticked(row[0])[0] for row in rows} == set(CHANGES)
    for first, of_stacks, of_sequences in rows:
        key = ticked(first)[0]
        new_stacks, after = fingerprints(CHANGES[key])
        assert of_stacks == ("kept" if new_stacks == stacks else "rendered again"), key
        moved = {name for name in before if before[name] != after[name]}
        expected = {
            "all made again": set(before),
            "the old ones kept": set(),
            "those under that light": {name for name in before if "-flicker-" in name},
        }
        assert moved == expected[of_sequences], key


def test_the_light_schedule_shown_is_a_part(tmp_path):
    text = next(b.text for b in BLOCKS if b.path == "my_decay.py")
    space: dict[str, Any] = {"__name__": "shown"}
    exec(compile(text, "my_decay.py", "exec"), space)
    (part,) = (v for v in space.values() if is_dataclass(v) and isinstance(v, type))
    gains = gains_at_readouts(part(after_s=0.02), 400, readout_hz=20_000)
    assert gains == pytest.approx(np.exp(-(np.arange(400) + 0.5) / 20_000 / 0.02), rel=1e-4)
    squared = gains_at_readouts(multiply([part(after_s=0.02), part(after_s=0.02)]), 400, readout_hz=20_000)
    assert squared == pytest.approx(np.exp(-(np.arange(400) + 0.5) / 20_000 / 0.01), rel=1e-4)


# --- what is run -------------------------------------------------------------------------------------


def shrunk(text: str) -> str:
    """A recipe with a sixth of the pixels, half of the frames, few positions and few samples."""
    recipe = yaml.safe_load(text)
    recipe["camera"] |= {"sensor": "quarter.yaml", "frames": recipe["camera"]["frames"] // 2}
    if "stacks" in recipe:
        return yaml.safe_dump(recipe, sort_keys=False)
    recipe["focus"]["positions"] = 9
    recipe["render"] = {"samples": 4, "max_depth": 3}
    return yaml.safe_dump(recipe, sort_keys=False)


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder like a checkout, with a small version of the quickstart's dataset."""
    folder = tmp_path_factory.mktemp("desk")
    shutil.copytree(ROOT / "recipes", folder / "recipes")
    (folder / "scenes").mkdir()
    sensor = yaml.safe_load((HERE / "small_sensor.yaml").read_text())
    sensor |= {"rows": 100, "columns": 160, "pitch_m": 5e-5}
    for parent in (folder, folder / "recipes"):  # a recipe looks for its sensor in its folder
        (parent / "quarter.yaml").write_text(yaml.safe_dump(sensor))
    recipe = folder / "quickstart.yaml"
    text = (ROOT / "recipes/quickstart.yaml").read_text()
    assert ", low_texture, camel" in text  # one scene is enough for the pages
    recipe.write_text(shrunk(text.replace(", low_texture, camel", "")))
    shutil.copytree(SCENES / "workbench", folder / "exported", ignore=shutil.ignore_patterns("*.yaml", "*.md"))
    trimesh.creation.box().export(folder / "crate.glb")
    write_whole_scene(folder / "desk.glb")
    run(folder, ["saf-gen", "generate", recipe.name, "--out", "datasets/quickstart"])
    shutil.copy(folder / "datasets/quickstart/test/usaf_target-sudden-00.h5", folder / "sequence.h5")
    return folder


def run(folder: Path, words: list[str], where: str = "", *, small: bool = True) -> str:
    """Run a saf-gen command, and return what it prints.

    At a small size, recipes of the project are only planned, but for quickstart, which is small at a desk; scenes get a
    sixth of the pixels and few samples; at most one sequence gets charts, and a fitted sensor no plots. A live camera
    ends at once.
    """
    environment, (_, *arguments) = split_env(words)
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(folder)
        patch.setattr(_terminal.out, "width", 120)
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        if small:
            shrink(arguments, patch)
        for name, value in environment.items():
            patch.setenv(name, value)
        with pytest.raises(SystemExit) as stop:
            main(arguments)
    assert stop.value.code == 0, f"{where}: saf-gen {shlex.join(arguments)}\n{err.getvalue()}"
    return out.getvalue()


def shrink(arguments: list[str], patch: pytest.MonkeyPatch) -> None:
    """Change the arguments of a command, and what it calls, so that it ends soon."""
    full_size = [name for p in (ROOT / "recipes").glob("*.yaml") for name in (p.stem, f"recipes/{p.name}")]
    if arguments[0] == "generate" and arguments[1] in full_size and "--dry-run" not in arguments:
        if arguments[2:] == ["--out", "datasets/quickstart"]:
            arguments[1] = "quickstart.yaml"
        else:
            arguments.append("--dry-run")
    if arguments[0] == "scenes" and arguments[1] in ("check", "preview"):
        arguments += ["--sensor", "quarter.yaml"]
    if arguments[0] == "live":
        arguments += [] if Path(arguments[1]).exists() else ["--sensor", "quarter.yaml", "--samples", "1"]
        patch.setattr("saf_gen.addons.live.commands._stay", lambda: None)
        patch.setattr("webbrowser.open", lambda address: None)
    patch.setattr("saf_gen.leaderboard.report.charts.DRAWN_SEQUENCES", 1)
    patch.setattr("saf_gen.authoring.checks.subject.NEAR_SAMPLES", 4)
    if arguments[0] == "sensors" and arguments[1] == "fit":
        patch.setattr("saf_gen.addons.calibrate.fit_files.draw_fit", lambda fit: [])


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_what_a_page_shows_runs_in_its_order_and_is_printed(page, desk, monkeypatch):
    """A command that only reads the quickstart's dataset is not run again if another page has run it."""
    assert list(follow_page(page, desk, monkeypatch)) == []


def follow_page(page, desk, monkeypatch, *, small=True, accept=False):
    """Write the files and run the commands of a page in order in the folder ``desk``, and yield what is not printed.

    At full size, the page is followed up to its last block of output, and only the lines of output that are printed
    with other figures are yielded or, with ``accept``, replaced on the page.
    """
    monkeypatch.chdir(desk)
    # Functions that a page evaluates are forgotten.
    monkeypatch.setattr(registry, "_registered_here", {kind: {} for kind in registry.PLUGIN_KINDS})
    blocks, printed, exact, is_compared = list(page_blocks(page)), "", False, True
    outputs = [k for k, block in enumerate(blocks) if block.language == "output"]
    for block in blocks if small else blocks[: max(outputs) + 1]:
        if block.path:
            target = desk / block.path
            target.parent.mkdir(parents=True, exist_ok=True)
            is_recipe = small and block.path.startswith("recipes/") and block.language == "yaml"
            target.write_text(shrunk(block.text) if is_recipe else block.text, encoding="utf-8")
        if block.language == "sh":
            shown = [made for words in commands(block) for made in commands_of(words)]
            exact = not small or any("sample" in words for words in shown)
            # scenes are checked with another sensor at a desk, which has other results
            is_compared = not small or not any("scenes" in words for words in shown)
            printed = "".join(run_once(desk, words, block.where, small=small) for words in shown)
        elif block.language == "python" and not block.path and all(map(find_spec, OPTIONAL & words_of(block.text))):
            out, exact, is_compared = io.StringIO(), not small or "saf_gen.sample" in block.text, True
            with redirect_stdout(out):
                exec(compile("\n" * (block.line - 1) + block.text, str(page), "exec"), {"__name__": "shown"})
            printed = out.getvalue()
        elif block.language == "output":
            lost = not_printed(block.text, printed, exact=exact) if is_compared else []
            if lost and accept:
                text = page.read_text(encoding="utf-8")
                page.write_text(text.replace(block.text, as_printed(block.text, printed)), encoding="utf-8")
            else:
                yield from (f"{block.where}: {line}" for line in lost)


def commands_of(words: list[str]) -> list[list[str]]:
    """Return the commands of saf-gen that a shown command runs: itself, or those of a target of the Makefile."""
    program, *rest = split_env(words)[1]
    if program == "saf-gen":
        return [words]
    if program != "make":
        return []
    assert set(rest) <= set(TARGETS), f"the Makefile has no target {rest}"
    (recipe,) = re.findall(rf"^{rest[0]}:.*\n((?:\t.*\n)*)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    return [["saf-gen", *shlex.split(line)] for line in re.findall(r"\t\$\(BIN\)/saf-gen (.*)", recipe)]


def run_once(desk: Path, words: list[str], where: str, *, small: bool) -> str:
    key = (str(desk), *words)
    if key not in PRINTED:
        printed = run(desk, words, where, small=small)
        if "datasets/quickstart" not in words:
            return printed
        PRINTED[key] = printed
    return PRINTED[key]


FIGURE = re.compile(r"\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")
RANK = re.compile(r"^ *\d+[=~]* ")


def mask(line: str) -> str:
    """Return the words of a line, with # for each figure and each rank."""
    words = re.sub(r"─+", "─", FIGURE.sub("#", RANK.sub("# ", line)))
    return " ".join(words.split())


def is_line(shown: str, printed: str, *, exact: bool) -> bool:
    """Return whether a line is printed as shown, with its figures if ``exact``."""
    start = mask(shown.rstrip(" …"))
    if mask(printed) != start and not (shown.endswith("…") and mask(printed).startswith(start)):
        return False
    texts = (RANK.sub("", line) for line in (shown, printed))
    figures = (re.findall(rf"({FIGURE.pattern})( ?%)?", text) for text in texts)
    pairs = zip(*figures, strict=False)  # a line that is cut shows only some of them
    return not exact or all(is_near(a, b, bool(percent)) for (a, percent), (b, _) in pairs)


def is_near(shown: str, printed: str, percent: bool) -> bool:
    a, b = (float(text.replace(",", "")) for text in (shown, printed))
    digit = 10.0 ** -len(shown.partition(".")[2]) if "e" not in shown else 0.0
    return abs(a - b) <= max(1.01 * digit, 0.05 * abs(b), 12 * percent)


def not_printed(shown: str, printed: str, *, exact: bool) -> list[str]:
    """Return the shown lines that are not printed."""
    lines = printed.splitlines()
    return [s for s in shown.splitlines() if s.strip() and not any(is_line(s, line, exact=exact) for line in lines)]


def as_printed(shown: str, printed: str) -> str:
    """Return the printed lines with the words of those that are shown, in printed order and cut at as many letters."""
    lines, kept = printed.splitlines(), {}
    for line in filter(str.strip, shown.splitlines()):
        number = next((n for n, other in enumerate(lines) if is_line(line, other, exact=False)), None)
        assert number is not None, f"no line like this is printed: {line}"
        cut = lines[number][: len(line) - 1].rpartition(" ")[0] + " …" if line.endswith("…") else lines[number].rstrip()
        kept[number] = cut
    return "".join(f"{kept[number]}\n" for number in sorted(kept))


@pytest.mark.long
def test_at_full_size_the_figures_that_pages_show_are_printed(tmp_path, monkeypatch, request):
    """``--accept`` writes them to the pages."""
    accept = request.config.getoption("accept")
    shutil.copytree(ROOT / "recipes", tmp_path / "recipes")
    showing = {block.page for block in BLOCKS if block.language == "output"}
    pages = sorted(showing, key=lambda page: page.name == "README.md")  # what it shows is made on the other pages
    lost = [list(follow_page(page, tmp_path, monkeypatch, small=False, accept=accept)) for page in pages]
    assert [line for lines in lost for line in lines] == []


def test_figures_are_compared_within_their_tolerance_and_accepted():
    shown = "   1=   a+b   100%   0.13\nit took 3.2 s …\n"
    printed = "   2~   a+b   89%   0.14\nit took 3.9 s of 12\nend\n"
    assert not_printed(shown, printed, exact=False) == []
    assert not_printed(shown, printed, exact=True) == ["it took 3.2 s …"]
    assert not_printed("b+a 100%\n", printed, exact=False) == ["b+a 100%"]
    assert as_printed(shown, printed) == "   2~   a+b   89%   0.14\nit took 3.9 s …\n"


def test_a_mistake_is_reported_as_the_first_page_shows_it(tmp_path, monkeypatch, capsys):
    page = ROOT / "docs/start.md"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipes").mkdir()
    (recipe,) = (block for block in page_blocks(page) if block.path == "recipes/desk_study.yaml")
    (tmp_path / recipe.path).write_text(recipe.text.replace("frames", "framse"))
    with pytest.raises(SystemExit) as stop:
        main(["recipes", "check", recipe.path])
    assert stop.value.code == 2
    assert f"```\n{capsys.readouterr().err}```" in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_dataset_and_its_evaluation_hold_what_the_pages_list(desk):
    made = desk / "datasets/quickstart"
    layout = (ROOT / "docs/files.md").read_text(encoding="utf-8")
    folder = layout.split("## A dataset folder")[1].split("```")[1]
    SpikeWindows(made, window=100)[0]  # writes the counts that it reads
    for line in folder.strip().splitlines():
        pattern = re.sub(r"<\w+>", "*", line.split()[0])
        assert list(made.glob(pattern)), f"{pattern} is not there"
    run(desk, ["saf-gen", "evaluate", str(made), "--out", "made", "--method", "sd+argmax"])
    for row in table("docs/files.md", "file", "| content |"):
        assert list((desk / "made").glob(ticked(row[0])[0].replace("SPLIT-SCENE", "*")))
    record = json.loads((desk / "made/records.jsonl").read_text().splitlines()[0])
    keys = {key for row in table("docs/files.md", "part") for key in ticked(row[1])}
    assert keys | {"format", "checksum"} == set(record)
