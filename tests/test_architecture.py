"""The house, read from its imports: floors, doors, rooms."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from saf_gen import registry

PACKAGE = Path(__file__).resolve().parent.parent / "saf_gen"

FLOORS = (
    ("ground", "errors files host signals seeds registry sources parts region tables passes"),
    ("intent", "documents ranges written schedules recipe plan"),
    ("world", "optics keyframes scene scene_digest scene_xml lights motions render exr focal_stack reel"),
    ("camera", "camera actuators"),
    ("contract", "bits slabs metadata stream dataset"),
    ("film", "exposed truth take"),
    (
        "work",
        "cluster record jobs card preview checks skeleton gallery work generate "
        "methods tuned rig scores records record_rules statistics curve_quality contest conformance "
        "evaluate measures searches",
    ),
    ("publication", "leaderboard tune figures report interop inspection machine bench gym cli __main__"),
)
FLOOR = {name: i for i, (_, names) in enumerate(FLOORS) for name in names.split()}
GENERATE = set("cluster record jobs card preview checks skeleton gallery work generate".split())
EVALUATE = {
    "methods",
    "tuned",
    "rig",
    "scores",
    "records",
    "record_rules",
    "statistics",
    "curve_quality",
    "contest",
    "conformance",
    "evaluate",
    "measures",
    "searches",
}
DOORS = {
    "mitsuba": {"render"},
    "drjit": {"render"},
    "OpenEXR": {"exr"},
    "h5py": {"stream"},
    "typer": {"cli"},
    "rich": {"cli"},
    "matplotlib": {"figures", "preview"},
    "PIL": {"figures"},
    "distributed": {"cluster"},
    "gymnasium": {"gym"},
    "yaml": {"documents", "generate"},
    "multiprocessing": {"cluster"},
}


def room(path: Path) -> str:
    """The module or room that a file belongs to: 'stream', 'lights', ..."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def files():
    return sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def imports(path: Path):
    """Dotted names that a file imports, those within functions too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            if node.module == "saf_gen":
                yield from (f"saf_gen.{alias.name}" for alias in node.names)
            else:
                yield node.module


def own_imports(path: Path):
    """Rooms of saf_gen that a file imports from."""
    return {name.split(".")[1] for name in imports(path) if name.startswith("saf_gen.")} - {"__version__"}


def test_every_module_stands_on_a_floor():
    assert {room(p) for p in files()} == set(FLOOR)


@pytest.mark.parametrize("path", files(), ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_imports_point_down(path):
    above = {name for name in own_imports(path) if FLOOR[name] > FLOOR[room(path)]}
    assert not above, f"{room(path)} imports from floors above it: {above}"


@pytest.mark.parametrize("path", files(), ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_the_halves_do_not_know_each_other(path):
    halves = ((GENERATE, EVALUATE), (EVALUATE, GENERATE))
    for mine, other in halves:
        assert room(path) not in mine or not own_imports(path) & other


@pytest.mark.parametrize("package", DOORS)
def test_a_heavy_dependency_has_one_door(package):
    through = {room(p) for p in files() if any(n.split(".")[0] == package for n in imports(p))}
    assert through <= DOORS[package]


def test_random_streams_come_from_seeds_alone():
    for path in files():
        text = path.read_text()
        if room(path) != "seeds":
            for maker in ("default_rng(", "PCG64(", "np.random.seed(", "RandomState(", "import random"):
                assert maker not in text, f"{path.name} makes its own random stream"


def test_only_the_command_line_prints():
    for path in files():
        calls = (n.func for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call))
        printed = any(isinstance(f, ast.Name) and f.id == "print" for f in calls)
        assert not printed or room(path) == "cli", path


@pytest.mark.parametrize("name", registry.ROOMS)
def test_a_part_imports_the_ground_and_numeric_libraries_alone(name):
    allowed = {"numpy", "numba", "scipy", "dataclasses", "typing", "collections", "math", "functools"}
    allowed |= {"numbers", "itertools"}
    for path in sorted((PACKAGE / name).glob("*.py")):
        if path.name == "__init__.py":
            continue
        for imported in imports(path):
            top, _, rest = imported.partition(".")
            ground = top == "saf_gen" and (FLOOR[rest.split(".")[0]] == 0 or rest.startswith(f"{name}._"))
            assert ground or top in allowed, f"{path.name} imports {imported}"


def test_modules_stay_small():
    long = {p.name: n for p in files() if (n := len(p.read_text().splitlines())) > 400}
    assert not long


def test_the_contest_runs_without_a_renderer(tmp_path):
    """Evaluating imports nothing of mitsuba, drjit or OpenEXR: they are made to fail here."""
    code = (
        "import sys\n"
        "for name in ('mitsuba', 'drjit', 'OpenEXR'): sys.modules[name] = None\n"
        "import numpy as np, saf_gen\n"
        "from saf_gen.evaluate import evaluate\n"
        "frames = (np.random.default_rng(0).random((400, 16, 24)) < 0.3).astype('uint8')\n"
        f"saf_gen.write_stream({str(tmp_path / 'a.h5')!r}, frames)\n"
        f"result = evaluate({str(tmp_path / 'a.h5')!r}, methods=['sd+argmax'])\n"
        "assert len(result.records) == 1\n"
        "import saf_gen.leaderboard, saf_gen.report, saf_gen.camera\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
