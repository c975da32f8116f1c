"""The package as installed from its wheel: scenes and recipes are found by name, in an empty folder."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

import saf_gen
from saf_gen.errors import BadInput
from saf_gen.generate.recipe import find_recipe, recipe_names

CHECKOUT = Path(saf_gen.__file__).resolve().parents[1]


def build_wheel(source, target, **environment):
    """Build a wheel of the files in ``source`` into the folder ``target`` and return its path."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", target]
    done = subprocess.run(build, cwd=source, capture_output=True, text=True, env={**os.environ, **environment})
    assert done.returncode == 0, done.stderr
    (wheel,) = target.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the unpacked wheel and an empty working folder."""
    folder = tmp_path_factory.mktemp("installed")
    ZipFile(build_wheel(CHECKOUT, folder)).extractall(folder / "site")
    (folder / "empty").mkdir()
    return folder


@pytest.mark.slow
def test_links_of_the_package_page_lead_into_the_released_version_of_the_checkout(tmp_path):
    where = {"GITHUB_SERVER_URL": "https://host.example", "GITHUB_REPOSITORY": "lab/saf", "GITHUB_REF_NAME": "v9"}
    wheel = build_wheel(CHECKOUT, tmp_path, **where)
    metadata = ZipFile(wheel).read(f"{wheel.name.removesuffix('-py3-none-any.whl')}.dist-info/METADATA").decode()
    head, page = metadata.split("\n\n", 1)
    assert "Project-URL: Issues, https://host.example/lab/saf/issues" in head
    links = re.findall(r"\]\(([^)\s]+)\)", page)
    assert [link for link in links if not re.match("https?:|#", link)] == []
    of_files = [re.sub(r"^https://host.example/lab/saf/(blob|raw)/v9/|#.*", "", link) for link in links]
    of_files = [path for path in of_files if path and not path.startswith("http")]
    assert len(of_files) > 20
    assert [path for path in of_files if not (CHECKOUT / path).exists()] == []
    assert "![What the lens sees of the camel](https://host.example/lab/saf/raw/v9/docs/pictures/" in page


AFTER_EACH = "=== after a command ===\n"
RUN_EACH = f"""
import json, sys
from saf_gen.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main(words.split())
    except SystemExit as ended:
        print("exit code", ended.code, file=sys.stderr)
        print({AFTER_EACH!r}, end="")
"""


def run_commands(code, commands, **how):
    """Run code that contains RUN_EACH in another process, with these commands."""
    command = [sys.executable, "-c", code, json.dumps(commands)]
    return subprocess.run(command, capture_output=True, text=True, check=True, **how)


@pytest.mark.slow
def test_the_wheel_brings_every_scene_and_recipe_of_the_checkout(installed):
    for kind in ("scenes", "recipes", "datasets/sample"):
        own, shipped = CHECKOUT / kind, installed / "site" / "saf_gen" / "shipped" / kind
        files = {path.relative_to(own) for path in own.rglob("*") if path.is_file()}
        files = {path for path in files if not any(part.startswith((".", "__")) for part in path.parts)}  # caches
        assert files == {path.relative_to(shipped) for path in shipped.rglob("*") if path.is_file()}
        assert all((own / name).read_bytes() == (shipped / name).read_bytes() for name in files)


@pytest.mark.slow
def test_what_was_installed_lists_and_plans_in_an_empty_folder(installed):
    """In one process, because starting it takes longer than any of the commands."""
    commands = ["recipes list", "scenes list", "generate quickstart --dry-run", "generate quickstrat"]
    folder = "from saf_gen.core.shipped import shipped_folder; print(shipped_folder('scenes'))"
    env = {**os.environ, "PYTHONPATH": str(installed / "site")}
    done = run_commands(f"{RUN_EACH}\n{folder}", commands, cwd=installed / "empty", env=env)
    *codes, mistyped, last = done.stderr.splitlines()
    assert (codes, last) == (["exit code 0"] * 3, "exit code 2")
    assert mistyped.startswith("saf-gen: unknown recipe 'quickstrat'; allowed: ")
    assert "did you mean 'quickstart'?" in mistyped
    recipes, scenes, plan, _, found = done.stdout.split(AFTER_EACH)
    assert all(name in recipes for name in recipe_names())
    assert "usaf_microscope" in scenes
    assert "usaf_target-sudden-00" in plan
    assert Path(found.strip()).is_relative_to(installed / "site")
    assert not list((installed / "empty").iterdir())


def docker_copies():
    """Return the files and folders that the Dockerfile copies before it builds the wheel, each with its target."""
    _, stage, _ = (CHECKOUT / "Dockerfile").read_text().split("\nFROM ")
    for words in re.findall(r"^COPY (.+)$", stage, re.MULTILINE):
        *sources, target = words.split()
        yield from ((source, target + Path(source).name if target.endswith("/") else target) for source in sources)


def apptainer_copies():
    """Return the files and folders that saf-gen.def copies, each with its target in the folder of the build."""
    section = (CHECKOUT / "saf-gen.def").read_text().split("%files\n")[1].split("\n\n")[0]
    for line in section.splitlines():
        source, target = line.split()
        yield source, target.removeprefix("/src/")


def copy_all(copies, folder):
    """Copy these files and folders of the checkout into a folder, each to its target."""
    for source, target in copies:
        (folder / target).parent.mkdir(parents=True, exist_ok=True)
        copy = shutil.copytree if (CHECKOUT / source).is_dir() else shutil.copy
        copy(CHECKOUT / source, folder / target)


@pytest.mark.slow
@pytest.mark.parametrize("copies", [docker_copies, apptainer_copies])
def test_a_wheel_of_what_a_container_copies_is_the_wheel_of_the_checkout(copies, tmp_path):
    copy_all(copies(), tmp_path / "src")
    part = ZipFile(build_wheel(tmp_path / "src", tmp_path / "part")).namelist()
    assert sorted(part) == sorted(ZipFile(build_wheel(CHECKOUT, tmp_path / "whole")).namelist())
    for kind in ("scenes", "recipes", "datasets/sample"):
        assert any(name.startswith(f"saf_gen/shipped/{kind}/") for name in part)


@pytest.mark.parametrize("folder", ["scenes", "datasets/sample"])
def test_a_build_without_a_folder_of_the_package_is_refused(folder, tmp_path):
    """Hatchling leaves out what is not there."""
    copy_all((copy for copy in docker_copies() if copy[0] != folder), tmp_path)
    with pytest.raises(AssertionError, match=f"the package needs {folder} in .*; copy all of saf_gen, scenes, recipes"):
        build_wheel(tmp_path, tmp_path / "wheel")


def test_a_recipe_is_a_name_or_a_path():
    assert find_recipe("sad_core") == CHECKOUT / "recipes" / "sad_core.yaml"
    for path in ("recipes/sad_core.yaml", "mine.yaml", "./mine", "folder/mine"):
        assert find_recipe(path) == Path(path)
    with pytest.raises(BadInput, match="or the path of a recipe file, such as ./mine.yaml"):
        find_recipe("mine")


@pytest.mark.slow
def test_without_the_renderer_what_needs_it_says_one_line_and_the_rest_works(tmp_path):
    """Evaluating does not import mitsuba and drjit from the extra `render`; here their import fails."""
    stream, empty = tmp_path / "a.h5", tmp_path / "empty"
    empty.mkdir()
    saf_gen.write_stream(stream, np.random.default_rng(0).random((400, 16, 24)) < 0.3)
    refused = ["generate quickstart", "scenes check usaf_target", "scenes preview usaf_target"]
    works = ["recipes check quickstart", "scenes list", "scenes new mine"]
    works.append(f"evaluate {stream} --method sd+argmax --out {tmp_path / 'out'}")
    works.append("evaluate sample --method sd+argmax")
    works.append("evaluate sample --track closed_loop --method sd+golden_section")
    works.append("recapture sample --sensor davis346 --sequence usaf_target-constant-00")
    without = f"import sys\nsys.modules['mitsuba'] = sys.modules['drjit'] = None\n{RUN_EACH}"
    done = run_commands(without, [*refused, *works, "generate quickstart --dry-run"], cwd=empty)
    line = "rendering needs the packages mitsuba and drjit; pip install 'saf-gen[render]'"
    *lines, dry_run, last = done.stderr.splitlines()
    lines = [text for text in lines if not text.startswith(("evaluate ", "record with "))]  # their progress
    assert lines == [*[f"saf-gen: {line}", "exit code 2"] * len(refused), *["exit code 0"] * len(works)]
    assert dry_run.startswith("scenes cannot be rendered here: ")
    assert last == "exit code 0"
    assert "focal stacks to render: usaf_target" in done.stdout.split(AFTER_EACH)[-2]
    assert len((tmp_path / "out/records.jsonl").read_text().splitlines()) == 1
    made = ["sample-davis346", "sample-evaluation", "sample-evaluation-closed-loop", "scenes"]
    assert sorted(path.name for path in empty.iterdir()) == made
    assert len((empty / "sample-evaluation/records.jsonl").read_text().splitlines()) == 3
