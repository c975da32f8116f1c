"""The package as it is installed from its wheel: scenes and recipes are found by name, in an empty folder."""

import json
import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

import saf_gen
from saf_gen.errors import BadInput
from saf_gen.generate.shipped_recipes import find_recipe, recipe_names

CHECKOUT = Path(saf_gen.__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The folder that the wheel was unpacked into, beside an empty one to work in."""
    folder = tmp_path_factory.mktemp("installed")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder]
    subprocess.run(build, cwd=CHECKOUT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    ZipFile(wheel).extractall(folder / "site")
    (folder / "empty").mkdir()
    return folder


def run(installed, *words):
    env = {**os.environ, "PYTHONPATH": str(installed / "site")}
    return subprocess.run(
        [sys.executable, "-m", "saf_gen", *words], cwd=installed / "empty", env=env, capture_output=True, text=True
    )


@pytest.mark.slow
def test_the_wheel_brings_every_scene_and_recipe_of_the_checkout(installed):
    for kind in ("scenes", "recipes"):
        own, shipped = CHECKOUT / kind, installed / "site" / "saf_gen" / "shipped" / kind
        files = {path.relative_to(own) for path in own.rglob("*") if path.is_file()}
        files = {path for path in files if not any(part.startswith((".", "__")) for part in path.parts)}  # caches
        assert files == {path.relative_to(shipped) for path in shipped.rglob("*") if path.is_file()}
        assert all((own / name).read_bytes() == (shipped / name).read_bytes() for name in files)


@pytest.mark.slow
def test_what_was_installed_lists_and_plans_in_an_empty_folder(installed):
    listed = run(installed, "recipes", "list")
    assert listed.returncode == 0
    assert all(name in listed.stdout for name in recipe_names())
    assert "usaf_microscope" in run(installed, "scenes", "list").stdout
    plan = run(installed, "generate", "quickstart", "--dry-run")
    assert plan.returncode == 0
    assert "usaf_target-sudden-00" in plan.stdout
    imported = "import saf_gen.core.shipped as s, json; print(json.dumps(str(s.shipped_folder('scenes'))))"
    env = {**os.environ, "PYTHONPATH": str(installed / "site")}
    found = subprocess.run(
        [sys.executable, "-c", imported], cwd=installed / "empty", env=env, capture_output=True, text=True, check=True
    )
    assert Path(json.loads(found.stdout)).is_relative_to(installed / "site")
    assert not list((installed / "empty").iterdir())


@pytest.mark.slow
def test_a_mistyped_recipe_is_one_line_with_the_nearest(installed):
    answer = run(installed, "generate", "quickstrat")
    assert answer.returncode == 2
    assert answer.stderr.startswith("saf-gen: unknown recipe 'quickstrat'; allowed: claims, ")
    assert "did you mean 'quickstart'?" in answer.stderr
    assert answer.stderr.count("\n") == 1


def test_a_recipe_is_a_name_or_a_path():
    assert find_recipe("sad_core") == CHECKOUT / "recipes" / "sad_core.yaml"
    for path in ("recipes/sad_core.yaml", "mine.yaml", "./mine", "folder/mine"):
        assert find_recipe(path) == Path(path)
    with pytest.raises(BadInput, match="or the path of a recipe file, such as ./mine.yaml"):
        find_recipe("mine")


WITHOUT_RENDERER = """
import json, sys
sys.modules["mitsuba"] = sys.modules["drjit"] = None
from saf_gen.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit as ended:
        print("exit code", ended.code, file=sys.stderr)
"""


@pytest.mark.slow
def test_without_the_renderer_what_needs_it_says_one_line_and_the_rest_works(tmp_path):
    refused = ["generate quickstart", "scenes check usaf_target", "scenes preview usaf_target", "validate --quick"]
    works = ["recipes check quickstart", "scenes list", "scenes new mine", "doctor"]
    commands = json.dumps([text.split() for text in (*refused, *works)])
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_RENDERER, commands], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    line = "rendering needs the packages mitsuba and drjit; pip install 'saf-gen[render]'"
    assert done.stderr.splitlines() == [
        *[f"saf-gen: {line}", "exit code 2"] * len(refused),
        *["exit code 0"] * len(works),
    ]
    assert "to render: pip install 'saf-gen[render]'" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["scenes"]


@pytest.mark.slow
def test_a_dry_run_without_the_renderer_tells_the_plan(tmp_path):
    commands = json.dumps([["generate", "quickstart", "--dry-run"]])
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_RENDERER, commands], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "focal stacks to render: usaf_target" in done.stdout
    assert done.stderr.splitlines()[0].startswith("scenes cannot be rendered here: ")
    assert not list(tmp_path.iterdir())
