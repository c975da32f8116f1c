"""Docstrings follow numpydoc, and name what the signature names."""

import ast
import re

import pytest
from small_dataset import HERE

PACKAGE = HERE.parent / "saf_gen"
SECTIONS = ("Parameters", "Attributes", "Returns", "Yields", "Raises", "Notes", "References", "Examples")
LISTS = ("Parameters", "Attributes")
Documented = ast.Module | ast.ClassDef | ast.FunctionDef


def documented():
    """Yield ``where``, node and docstring of everything in the package that has a docstring."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, Documented) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(PACKAGE).as_posix()}: {getattr(node, 'name', 'module')}", node, text


def sections_of(text):
    """The bodies of the numpydoc sections of a docstring, by their titles."""
    parts = re.split(r"(?:^|\n)([A-Z]\w+(?: \w+)?)\n-{3,}\n", text)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def names_in(section):
    """The names of a section's entries, in order; stars of ``*args`` are left out."""
    heads = [line for line in section.split("\n") if line.strip() and not line.startswith(" ")]
    return [name.strip().lstrip("*") for head in heads for name in head.partition(" : ")[0].split(",")]


@pytest.fixture(scope="module")
def with_sections():
    return [(where, node, found) for where, node, text in documented() if (found := sections_of(text))]


@pytest.mark.slow
def test_sections_have_the_titles_and_the_order_of_numpydoc(with_sections):
    wrong = [
        where
        for where, node, found in with_sections
        if not isinstance(node, ast.Module)
        and (set(found) - set(SECTIONS) or list(found) != sorted(found, key=SECTIONS.index))
    ]
    assert len(with_sections) > 200
    assert not wrong


def test_an_entry_is_a_name_and_a_type_with_its_description_below(with_sections):
    """An entry that only refers to another docstring needs no type."""
    wrong = []
    for where, _, found in with_sections:
        for title in set(found) & {*LISTS, "Raises"}:
            for head, below in re.findall(r"^(\S.*)\n(.*)", found[title] + "\n", re.MULTILINE):
                typed = title == "Raises" or " : " in head or head.startswith("*") or below.startswith("    See ")
                wrong += [] if typed and below.startswith("    ") else [f"{where}: {head}"]
    assert not wrong


def parameters_of(function):
    arguments = function.args
    found = [*arguments.posonlyargs, *arguments.args, arguments.vararg, *arguments.kwonlyargs, arguments.kwarg]
    return {one.arg for one in found if one is not None} - {"self", "cls"}


def test_the_parameters_of_a_function_are_those_of_its_signature(with_sections):
    functions = [(w, n, f) for w, n, f in with_sections if isinstance(n, ast.FunctionDef) and "Parameters" in f]
    wrong = [where for where, node, found in functions if set(names_in(found["Parameters"])) != parameters_of(node)]
    assert len(functions) > 60
    assert not wrong


def members_of(cls):
    """Fields, attributes and the parameters of ``__init__`` of a class."""
    names = {
        node.target.id for node in cls.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    for node in ast.walk(cls):
        if isinstance(node, ast.FunctionDef):
            names |= {node.name} | (parameters_of(node) if node.name == "__init__" else set())
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            names.add(node.attr)
    return names


def test_a_class_has_what_its_docstring_lists(with_sections):
    """What a class inherits may be in its docstring, too; a dataclass has the fields that it lists itself."""
    wrong = []
    for where, node, found in with_sections:
        if isinstance(node, ast.ClassDef) and (node.decorator_list or not node.bases):
            listed = [name for title in LISTS for name in (names_in(found[title]) if title in found else ())]
            wrong += [] if set(listed) <= members_of(node) else [where]
    assert not wrong
