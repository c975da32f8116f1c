"""Add-ons are found by path, cost nothing until they are used, and can be deleted."""

import ast
import json
import os
import shutil
import subprocess
import sys
from importlib import import_module
from pkgutil import iter_modules

import pytest
from small_dataset import HERE

import saf_gen.addons
from saf_gen.cli import COMMANDS, GROUPS
from saf_gen.cli.command import addon_commands

ROOT = HERE.parent
ADDONS = [module.name for module in iter_modules(saf_gen.addons.__path__)]
IMPORT_ALL = """
import json, pkgutil, sys
from importlib import import_module
import saf_gen
from saf_gen.errors import BadInput
for module in pkgutil.walk_packages(saf_gen.__path__, "saf_gen.", onerror=lambda name: None):
    try:
        if module.name != "saf_gen.__main__":
            import_module(module.name)
    except BadInput as error:
        if "pip install" not in str(error):  # of an extra that is not installed here
            raise
print(json.dumps([saf_gen.__file__, *(name for name in sys.modules if name.startswith("saf_gen."))]))
"""


def run(code, *words, path=ROOT, folder=None):
    """Run Python code with arguments in another process, with the package that lies in the folder ``path``."""
    environment = {**os.environ, "PYTHONPATH": str(path)}
    command = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder or path, env=environment)


def saf(*words, path, folder):
    return run("from saf_gen.cli import main; main()", *words, path=path, folder=folder)


@pytest.mark.parametrize("addon", ADDONS)
def test_an_addon_has_its_commands_its_tests_and_its_page(addon):
    assert (ROOT / "saf_gen/addons" / addon / "commands.py").exists()
    assert list((ROOT / "tests/addons" / addon).glob("test_*.py"))
    pages = [page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs").glob("*.md"))]
    words = import_module(f"saf_gen.addons.{addon}.commands").COMMANDS
    assert all(any(f"saf-gen {word}" in page for page in pages) for word in words)
    tree = ast.parse((ROOT / "saf_gen/addons" / addon / "__init__.py").read_text())
    assert [type(node) for node in tree.body] == [ast.Expr]


def test_no_command_of_an_addon_has_the_name_of_another_command():
    commands, groups = addon_commands()
    core = {*COMMANDS, *GROUPS}
    assert not core & {*commands, *groups}
    assert all(words.rpartition(" ")[0] in ("", *GROUPS, *groups) for words in commands)


@pytest.mark.slow
@pytest.mark.parametrize("addon", ADDONS)
def test_the_commands_of_an_addon_can_be_imported_first(addon):
    done = run(f"import saf_gen.addons.{addon}.commands as it; from saf_gen.cli import main; main(['--version'])")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_a_start_of_the_command_line_imports_nothing_of_an_addon_but_its_commands():
    code = """
import sys
from saf_gen.cli import main
try:
    main(["--help"])
finally:
    print(*sys.modules, sep="\\n", file=sys.stderr)
"""
    loaded = run(code).stderr.splitlines()
    own = {name for name in loaded if name.startswith("saf_gen.addons.")}
    assert own == {f"saf_gen.addons.{name}{part}" for name in ADDONS for part in ("", ".commands")}
    assert not {"numba", "scipy", "h5py", "matplotlib", "saf_gen.benchmark", "saf_gen.render"} & set(loaded)


@pytest.mark.daily(1)
@pytest.mark.slow
@pytest.mark.parametrize("addon", ADDONS)
def test_without_an_addon_everything_else_works_and_its_commands_are_unknown(addon, tmp_path):
    path, folder = tmp_path / "path", tmp_path / "folder"
    folder.mkdir()
    shutil.copytree(ROOT / "saf_gen", path / "saf_gen", ignore=shutil.ignore_patterns("__pycache__"))
    for kind in ("scenes", "recipes", "datasets"):
        (path / kind).symlink_to(ROOT / kind)
    shutil.rmtree(path / "saf_gen/addons" / addon)

    done = run(IMPORT_ALL, path=path, folder=folder)
    assert done.returncode == 0, done.stderr
    package, *modules = json.loads(done.stdout.splitlines()[-1])
    assert package == str(path / "saf_gen/__init__.py")
    assert len(modules) > 100
    assert not [name for name in modules if name.startswith(f"saf_gen.addons.{addon}")]

    done = saf("--help", path=path, folder=folder)
    assert (done.returncode, done.stderr) == (0, "")
    done = saf("evaluate", "sample", path=path, folder=folder)
    assert done.returncode == 0, done.stderr
    for words in [
        words.split() for words, command in addon_commands()[0].items() if addon in command.function.__module__
    ]:
        done = saf(*words, path=path, folder=folder)
        group = " ".join(["saf-gen", *(word for word in words[:-1] if word in GROUPS)])
        assert done.returncode == 2
        assert done.stderr.startswith(f"saf-gen: No such command '{words[0 if group == 'saf-gen' else -1]}'")
        assert done.stderr.endswith(f"; see: {group} --help\n")
        assert done.stderr.count("\n") == 1
