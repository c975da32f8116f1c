"""Abandoned words do not occur in the package, and the names that the glossary explains do."""

import ast
import re

import pytest
from small_dataset import HERE

ROOT = HERE.parent
PACKAGE = ROOT / "saf_gen"
GIVEN_UP = {
    "reel": "time-resolved focal stack",
    "footage": "plane source",
    "slab": "time block",
    "film": "sensor grid, or captured frames",
    "exposed": "charge source",
    "twin": "brightness-normalised measure, or slow reference",
    "contest": "benchmark",
    "referee": "evaluator",
    "rig": "view, or evaluator",
    "bill": "cost",
    "house": "package",
    "ground floor": "core",
    "told(?! apart)": "reported, named or given",
    "stranger": "untrusted",
    "whoever": "the one who",
    "thereof": "of it",
    "anew": "again",
    "goes as": "is proportional to",
    "room of": "folder",
    "share of": "fraction",
    "(counts|frames|readouts|samples|spikes) an? (pixel|readout|second|window)": "per",
}
"""Words and phrases, and what to write instead."""
KEPT = {
    "film": ("render/", "scene/xml/"),  # Mitsuba's word for the pixels of a camera
    "rig": ("benchmark/", "leaderboard/"),  # a key of records
    "anew": ("scene/library/",),  # frozen files
}
"""Folders in which a word is allowed, and why."""


@pytest.fixture(scope="module")
def words_by_file():
    """The words of each module in lower case; names are split at underscores and capitals."""
    texts = {p.relative_to(PACKAGE).as_posix(): p.read_text() for p in PACKAGE.rglob("*.py")}
    apart = {path: re.sub("(?<=[a-z])(?=[A-Z])", " ", text) for path, text in texts.items()}
    return {path: " ".join(re.findall("[a-z]+|[.:;]", text.lower())) for path, text in apart.items()}


@pytest.mark.parametrize("phrase", GIVEN_UP)
def test_a_word_that_was_given_up_is_not_in_the_package(phrase, words_by_file):
    found = {path for path, words in words_by_file.items() if re.search(rf"\b{phrase}s?\b", words)}
    found = {path for path in found if not path.startswith(KEPT.get(phrase, ("nowhere/",)))}
    assert not found, f"write {GIVEN_UP[phrase]}"


def test_no_function_is_named_by_a_participle():
    names = {name for _, name in public_functions()}
    assert not names & {"asked", "told", "running", "ended", "spent", "given", "led", "take", "taken"}


def test_the_names_that_the_glossary_explains_are_in_the_package():
    table = (ROOT / "docs/glossary.md").read_text(encoding="utf-8").split("## Names in the code")[1]
    defined = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef):
                defined.add(node.name)
            elif isinstance(node, ast.Assign):
                defined.update(target.id for target in node.targets if isinstance(target, ast.Name))
    explained = set(re.findall(r"\*\*(\w+)\*\*", table))
    assert len(explained) > 40
    assert explained <= defined


def words_of_layers():
    """The words of each layer in the table of CONTRIBUTING.md, upper layers first."""
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("| layer |")[1].split("\n\n")[0]
    words = {}
    for row in table.splitlines()[2:]:
        layers, _, listed = (cell.strip() for cell in row.strip("|").split("|"))
        of_each = listed.split(";") if ";" in listed else [listed]
        for layer, some in zip(re.findall(r"`(\w+)`", layers), of_each, strict=True):
            words[layer] = [word.strip() for word in some.split(",") if word.strip()]
    return words


def public_functions():
    """Layer and name of each public function of a module; files of scenes are left out."""
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE).parts
        if not {"templates", "library"} & set(parts):
            for node in ast.parse(path.read_text()).body:
                if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                    yield parts[0].removesuffix(".py"), node.name


def layer_by_name(name, words):
    """The uppermost layer one of whose words, singular or plural, is in the name; otherwise core."""
    for layer, listed in words.items():
        if any(re.search(f"_{word}s?_", f"_{name}_") for word in listed):
            return layer
    return "core"


def test_a_public_function_has_a_word_of_its_layer_in_its_name():
    """Names that users rely on, such as those of saf_gen.errors, may be exceptions: one in twenty."""
    words = words_of_layers()
    functions = list(public_functions())
    astray = sorted((layer, name) for layer, name in functions if layer_by_name(name, words) != layer)
    assert len(functions) > 600
    assert len(astray) <= len(functions) / 20, astray
