"""Code on pages runs, names on pages exist, and tables on pages agree with the code.

The blocks of a page are run in order at a *desk*: a folder like a checkout, with small versions of the datasets that
pages name. A yaml or python block whose first line is a comment with a path in ``recipes/``, ``scenes/`` or
``my_method/``, or a file ``my_...py``, is first written there, so that the commands below it find it.
"""

import csv
import io
import json
import re
import shlex
import shutil
import tomllib
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

import saf_gen.leaderboard.report.evaluation_folder  # noqa: F401  so that reports are made without figures
from saf_gen import SpikeWindows
from saf_gen.benchmark.method_folder import CARD, MethodCard
from saf_gen.benchmark.method_spec import DEFAULT_CLOSED_LOOP_METHODS, parse_method
from saf_gen.cli import main, root_command
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
OPTIONAL = {"torch", "pymmcore_plus"}
"""Packages without which a block that names them is not run, because no test needs them."""
RUN_ALREADY: list[list[str]] = []


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


def inline_commands() -> Iterator[Any]:
    """Every `saf-gen ...` in prose and in blocks without a language, which are not run."""
    for page in PAGES:
        prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for span in re.findall(r"`(saf-gen \w[^`]*)`", prose):
            if not re.fullmatch(FORMATS, span):
                yield pytest.param(span.split()[1:], id=f"{page.name}: {span}")
    for block in BLOCKS:
        for words in commands(block) if block.language == "" and "saf-gen " in block.text else ():
            if words[0] == "saf-gen":
                yield pytest.param(words[1:], id=f"{block.where}: {' '.join(words)}")


def split_env(words: list[str]) -> tuple[dict[str, str], list[str]]:
    """Leading NAME=VALUE words, and the rest."""
    count = next(i for i, word in enumerate(words) if not re.match(r"[A-Z_]+=", word))
    return dict(word.split("=", 1) for word in words[:count]), words[count:]


# --- what needs no dataset ---------------------------------------------------------------------------


@pytest.mark.parametrize("words", list(inline_commands()))
def test_a_command_that_is_named_exists_with_its_options(words):
    command, rest = COMMAND, [word for word in words if not word.startswith("[")]
    while hasattr(command, "commands") and rest:
        name = rest.pop(0)
        assert name in command.commands, f"there is no command {' '.join(words)!r}"
        command = command.commands[name]
    known = {option for parameter in command.params for option in parameter.opts} | {"--help"}
    assert {word.split("=")[0] for word in rest if word.startswith("--")} <= known


@pytest.mark.parametrize("block", blocks_in("sh"))
def test_a_block_of_the_shell_holds_commands_that_the_tests_can_judge(block):
    markers = [m.split(":")[0] for m in pyproject()["tool"]["pytest"]["ini_options"]["markers"]]
    for words in commands(block):
        _, (program, *rest) = split_env(words)
        if program == "make":
            assert set(rest) <= set(TARGETS), f"the Makefile has no target {rest}"
        elif program == ".venv/bin/pytest":
            options = [w for i, w in enumerate(rest) if rest[i - 1] == "-m"]
            assert set(options) <= set(markers)
            assert all((ROOT / w).exists() for w in rest if w.startswith("tests/"))
        elif program == "pip":
            (package,) = rest[1:]
            name, _, extras = package.removesuffix("]").partition("[")
            assert (rest[0], name) == ("install", "saf-gen")
            assert set(filter(None, extras.split(","))) <= set(pyproject()["project"]["optional-dependencies"])
        else:
            assert program == "saf-gen", f"no test knows what {program!r} does"


def pyproject() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_language_of_a_block_is_one_that_is_tested():
    assert {b.language for b in BLOCKS} <= {"", "sh", "yaml", "python", "toml", "csv"}


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
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return frozenset(re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings)


def leads_somewhere(page: Path, link: str) -> bool:
    path, _, anchor = link.partition("#")
    target = page.parent / path if path else page
    return target.exists() and (not anchor or anchor in anchors(target))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_and_paths_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    links = [link for link in re.findall(r"\]\(([^)]+)\)", prose) if "://" not in link]
    links = [link for link in links if not link.startswith("../../actions/")]  # badges, relative to the site
    missing = [link for link in links if not leads_somewhere(page, link)]
    named = re.findall(r"`((?:saf_gen|tests|tools)/[^`]*|(?:recipes|scenes|docs)/\w[^`]*)`", prose)
    made = {path for block in page_blocks(page) for path in (Path(block.path), Path(block.path).parent)}
    real = [n for n in named if not re.search(r"[A-Z]{3}|[*<]|/my_", n) and not {Path(n), Path(n).parent} & made]
    missing += [name for name in real if not (ROOT / name).exists()]
    assert not missing


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
    for searches, measures, how in table("docs/reference/methods.md", "search", "how it moves the lens"):
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
    rows = table("docs/how-to/generate.md", "you change")
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
    run(folder, ["saf-gen", "generate", recipe.name, "--out", "datasets/quickstart"])
    shutil.copy(folder / "datasets/quickstart/test/usaf_target-sudden-00.h5", folder / "sequence.h5")
    return folder


def run(folder: Path, words: list[str], where: str = "") -> str:
    """Run a saf-gen command at a small size.

    Recipes of the project are only planned, scenes get a sixth of the pixels and few samples, and sensors are compared
    over 400 frames. At most one sequence gets charts, and a fitted sensor no plots. A live camera ends at once.
    """
    environment, (_, *arguments) = split_env(words)
    full_size = [name for p in (ROOT / "recipes").glob("*.yaml") for name in (p.stem, f"recipes/{p.name}")]
    if arguments[0] == "generate" and arguments[1] in full_size and "--dry-run" not in arguments:
        arguments.append("--dry-run")
    if arguments[0] == "scenes" and arguments[1] in ("check", "preview"):
        arguments += ["--sensor", "quarter.yaml"]
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(folder)
        patch.setattr("saf_gen.leaderboard.report.charts.DRAWN_SEQUENCES", 1)
        if arguments[0] == "live":
            arguments += [] if Path(arguments[1]).exists() else ["--sensor", "quarter.yaml", "--samples", "1"]
            patch.setattr("saf_gen.addons.live.commands._stay", lambda: None)
            patch.setattr("webbrowser.open", lambda address: None)
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        patch.setattr("saf_gen.authoring.checks.subject.NEAR_SAMPLES", 4)
        if arguments[0] == "sensors" and arguments[1] == "fit":
            patch.setattr("saf_gen.addons.calibrate.fit_files.draw_fit", lambda fit: [])
        for name, value in environment.items():
            patch.setenv(name, value)
        with pytest.raises(SystemExit) as stop:
            main(arguments)
    assert stop.value.code == 0, f"{where}: saf-gen {shlex.join(arguments)}\n{err.getvalue()}"
    return out.getvalue()


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_what_a_page_shows_runs_in_its_order(page, desk, monkeypatch):
    """A command that only reads the quickstart's dataset is not run again if another page has run it."""
    follow_page(page, desk, monkeypatch)


def follow_page(page, desk, monkeypatch):
    """Write the files and run the commands of a page, in order, in the folder ``desk``."""
    monkeypatch.chdir(desk)
    for block in page_blocks(page):
        if block.path:
            target = desk / block.path
            target.parent.mkdir(parents=True, exist_ok=True)
            is_recipe = block.path.startswith("recipes/") and block.language == "yaml"
            target.write_text(shrunk(block.text) if is_recipe else block.text, encoding="utf-8")
        if block.language == "sh":
            for words in commands(block):
                if split_env(words)[1][0] == "saf-gen" and words not in RUN_ALREADY:
                    run(desk, words, block.where)
                    RUN_ALREADY.extend([words] if "datasets/quickstart" in words else [])
        elif block.language == "python" and not block.path and all(map(find_spec, OPTIONAL & words_of(block.text))):
            exec(compile("\n" * (block.line - 1) + block.text, str(page), "exec"), {"__name__": "shown"})


@pytest.mark.slow
def test_a_dataset_and_its_evaluation_hold_what_the_pages_list(desk):
    made = desk / "datasets/quickstart"
    layout = (ROOT / "docs/reference/file-layout.md").read_text(encoding="utf-8")
    folder = layout.split("## A dataset folder")[1].split("```")[1]
    SpikeWindows(made, window=100)[0]  # writes the counts that it reads
    for line in folder.strip().splitlines():
        pattern = re.sub(r"<\w+>", "*", line.split()[0])
        assert list(made.glob(pattern)), f"{pattern} is not there"
    run(desk, ["saf-gen", "evaluate", str(made), "--out", "made", "--method", "sd+argmax"])
    for row in table("docs/reference/leaderboard.md", "file"):
        assert list((desk / "made").glob(ticked(row[0])[0].replace("SPLIT-SCENE", "*")))
    record = json.loads((desk / "made/records.jsonl").read_text().splitlines()[0])
    keys = {key for row in table("docs/reference/records.md", "part") for key in ticked(row[1])}
    assert keys | {"format", "checksum"} == set(record)
    with (desk / "made/leaderboard.csv").open() as file:
        header = next(csv.reader(file))
    lights = [f"answerable_1dof_light_{light}" for light in ("constant", "continuous", "sudden")]
    named = [key for row in table("docs/reference/leaderboard.md", "column") for key in ticked(row[1])]
    named.remove("success_least_blur")  # only of lenses with aberrations
    at = named.index("answerable_1dof_light_LIGHT")
    assert sorted(header) == sorted(named[:at] + lights + named[at + 1 :])
