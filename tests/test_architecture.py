"""The structure of the package, read from its imports; `lint-imports` enforces the layers."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import grimp
import pytest

from saf_gen.core.config.registry import PLUGIN_KINDS

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "saf_gen"
LAYERS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["layers"]
ADDON_COMMANDS = [f"addons.{path.parent.name}.commands" for path in PACKAGE.glob("addons/*/commands.py")]
IMPORTERS = {
    "mitsuba": ["render"],
    "drjit": ["render"],
    "OpenEXR": ["core.exr"],
    "h5py": [
        "stream.checked_file",
        "stream.event_file",
        "stream.frame_file",
        "stream.full_disk",
        "stream.stream_file",
        "stream.stream_writer",
        "stream.interop.array_files",
    ],
    "typer": ["cli", *ADDON_COMMANDS],
    "rich": ["cli", *ADDON_COMMANDS],
    "openpyxl": ["stream.interop.saf_folder"],
    "matplotlib": [
        "core.figure_style",
        "stream.pictures",
        "addons.calibrate.fit_files",
        "addons.lens_files.sheet",
        "addons.paper.figures",
        "addons.paper.page",
        "authoring.contact_sheet",
    ],
    "PIL": ["stream.pictures", "stream.interop.image_pages", "stream.interop.stack_positions", "authoring.meshes"],
    "av": ["stream.interop.video_frames"],
    "tifffile": ["stream.interop.image_pages"],
    "jinja2": ["leaderboard.report"],
    "distributed": ["core.execution.dask_cluster", "core.execution.dask_connection"],
    "trimesh": ["authoring.meshes"],
    "emva1288": [],
    "gymnasium": ["benchmark.gym"],
    "torch": ["torch"],
    "onnxruntime": ["core.onnx_network"],
    "yaml": ["core.config.yaml_document", "generate.run", "stack.recapture"],
}
"""Heavy dependencies, and the only folders or modules that import them."""

DIGESTED = {
    "plugins/measures/_spectrum.py: _band",
    "plugins/measures/structure_calibrated.py: _structure",
    "plugins/searches/_golden_narrowing.py: _score_inclusive",
}
"""Functions that must not change, because the digests of methods in published records cover their code."""


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph("saf_gen", include_external_packages=True)


def sources():
    return sorted(PACKAGE.rglob("*.py"))


@cache
def parsed(path):
    return ast.parse(path.read_text())


@pytest.mark.slow
def test_layers_and_circles_are_as_pyproject_states_them():
    run = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as run; run(['--no-cache'])"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout


def test_the_table_of_layers_in_contributing_is_the_list_in_pyproject():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`[^|]+) \|", text.split("| layer |")[1].split("\n\n")[0], re.MULTILINE)
    assert [" | ".join(re.findall(r"`(\w+)`", row)) for row in rows] == LAYERS


@pytest.mark.parametrize("dependency", IMPORTERS)
def test_a_heavy_dependency_is_imported_only_in_its_place(dependency, graph):
    importers = graph.find_modules_that_directly_import(dependency) if dependency in graph.modules else set()
    allowed = tuple(f"saf_gen.{importer}" for importer in IMPORTERS[dependency])
    others = {m for m in importers if not any(m == importer or m.startswith(f"{importer}.") for importer in allowed)}
    assert not others


def test_the_package_imports_nothing_of_the_checkout(graph):
    """What we run on ourselves, tests and tools are not in the wheel."""
    assert not {"studies", "tests", "tools"} & {module.partition(".")[0] for module in graph.modules}


def test_random_streams_come_from_seeds_alone():
    makers = ("default_rng(", "PCG64(", "np.random.seed(", "RandomState(", "import random")
    for path in sources():
        if path != PACKAGE / "core/seeds.py":
            found = [maker for maker in makers if maker in path.read_text()]
            assert not found, f"{path} makes its own random stream"


@pytest.mark.slow
def test_only_the_command_line_prints():
    for path in (path for path in sources() if "print" in path.read_text()):
        calls = (n.func for n in ast.walk(parsed(path)) if isinstance(n, ast.Call))
        printed = any(isinstance(f, ast.Name) and f.id == "print" for f in calls)
        assert not printed or path.is_relative_to(PACKAGE / "cli"), path


MESH_CALLS = {"Mesh", "parameters_changed", "recompute_vertex_normals", "add_attribute", "vertex_count", "face_count"}
MESH_CALLS |= {"has_vertex_normals", "has_vertex_texcoords", "has_face_normals", "has_flipped_normals"}
MESH_WORDS = {"vertex_positions", "vertex_normals", "vertex_texcoords"}


@pytest.mark.slow
def test_mesh_calls_to_mitsuba_stand_in_one_file():
    """Mitsuba 3.10 renames all of them."""
    callers = set()
    for path in (path for path in sources() if path.parent != PACKAGE / "authoring/meshes"):  # it has words of trimesh
        for node in ast.walk(parsed(path)):
            called = isinstance(node, ast.Attribute) and node.attr in MESH_CALLS
            if called or (isinstance(node, ast.Constant) and node.value in MESH_WORDS):
                callers.add(path.relative_to(PACKAGE).as_posix())
    assert callers == {"render/meshes.py"}


@pytest.mark.parametrize("kind", PLUGIN_KINDS)
def test_a_plugin_imports_core_and_numeric_libraries_alone(kind, graph):
    allowed = {"numpy", "numba", "scipy", "dataclasses", "typing", "collections", "math", "functools"}
    allowed |= {"numbers", "itertools"}
    inside = ("saf_gen.core.", "saf_gen.errors", "saf_gen.parts", f"saf_gen.plugins.{kind}._")
    for path in (PACKAGE / "plugins" / kind).glob("[!_]*.py"):
        imported = graph.find_modules_directly_imported_by(f"saf_gen.plugins.{kind}.{path.stem}")
        others = {m for m in imported if m not in allowed and not m.startswith(inside)}
        assert not others, f"{path.name} imports {others}"


def defined_functions(path):
    """The functions and methods of a module, without callbacks inside functions, whose signature the caller sets."""
    tree = parsed(path)
    bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
    return [node for body in bodies for node in body if isinstance(node, ast.FunctionDef)]


def takes_positions(function, protocol_members):
    """Return whether more than two arguments may be positional, although nothing requires it."""
    names = [a.arg for a in (*function.args.posonlyargs, *function.args.args)]
    kernel = any(re.search("njit|compiled|dr.syntax", ast.unparse(d)) for d in function.decorator_list)
    special = function.name.startswith("__") or function.name in protocol_members
    return len(names) - (names[:1] in (["self"], ["cls"])) > 2 and not (kernel or special)


def test_arguments_after_the_second_are_keyword_only():
    members = {function.name for function in defined_functions(PACKAGE / "parts.py")}
    found = {
        f"{path.relative_to(PACKAGE).as_posix()}: {function.name}"
        for path in sources()
        for function in defined_functions(path)
        if takes_positions(function, members)
    }
    assert sorted(found - DIGESTED) == []
