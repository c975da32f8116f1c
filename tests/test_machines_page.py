"""Steps of docs/machines.md are run as written: job arrays, certificates."""

import os
import re
import shlex
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from dask_processes import end_session
from planted_sweeps import list_streams, write_sweep
from small_dataset import SCENES, SMALL_RECIPE

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs/machines.md").read_text(encoding="utf-8")

ONE_LIGHT = SMALL_RECIPE.replace("[constant, continuous, lamp_only]", "[constant]")
RECIPE = ONE_LIGHT.replace("name: small", "name: quickstart")


def block_with(words: str) -> str:
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    (found,) = (text for language, text in blocks if words in text and not language)
    return found


def find_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@pytest.mark.long
@pytest.mark.parametrize("words", ["for shard in 1 2 3", "--from shard1", "SLURM_ARRAY_TASK_ID"])
def test_a_job_array_of_the_page_makes_the_dataset(words, tmp_path):
    """The recipe is replaced by one of a small still scene, which one shard makes; the batch system by a loop."""
    (tmp_path / "quickstart.yaml").write_text(RECIPE)
    text = block_with(words).replace("quickstart", "./quickstart.yaml", 1 if "SLURM" in words else -1)
    text = text.replace("datasets/./quickstart.yaml", "datasets/quickstart")
    if "SLURM" in words:
        (tmp_path / "array.sh").write_text(text)
        tasks = "for n in 1 2 8; do SLURM_ARRAY_TASK_ID=$n sh array.sh; done\n"
        text = tasks + "saf-gen generate ./quickstart.yaml\nsaf-gen verify datasets/quickstart\n"
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin/saf-gen"
    command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m saf_gen "$@"\n')
    command.chmod(0o755)
    path = os.pathsep.join([str(command.parent), os.environ["PATH"]])
    changes = {"PATH": path, "PYTHONPATH": os.pathsep.join(sys.path), "SAF_GEN_SCENES": str(SCENES)}
    ran = subprocess.run(["sh", "-ec", text], cwd=tmp_path, env=os.environ | changes, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.count("pieces of focal stacks rendered") == ran.stdout.count("has nothing to make") + 2
    assert ran.stdout.count("3 pieces of focal stacks rendered") == 1
    assert ran.stdout.endswith("1 of 1 sequence is intact\n")


def test_the_recipe_of_the_container_for_clusters_installs_what_the_other_does():
    docker, apptainer = ((ROOT / name).read_text(encoding="utf-8") for name in ("Dockerfile", "saf-gen.def"))
    for pattern in (r"^F(?:ROM|rom):? (python:\S+)", r"(apt-get install --yes .*?)(?: \\)?$", r"(NUMBA_CACHE_DIR=.*)$"):
        assert {*re.findall(pattern, apptainer, re.MULTILINE)} == {*re.findall(pattern, docker, re.MULTILINE)} != set()
    for folder in ("saf_gen", "scenes", "recipes", "constraints.txt", "pyproject.toml"):
        assert f"    {folder} /src/{folder}\n" in apptainer
        assert (ROOT / folder).exists()


@pytest.mark.slow
def test_a_cluster_by_hand_with_certificates_evaluates_and_refuses_who_has_none(call, tmp_path, monkeypatch):
    port = str(find_port())

    def localise(text):
        return text.replace("HEAD", "127.0.0.1").replace("8786", port).replace("tcp://", "tls://")

    def run(command, environment):
        return subprocess.run(["sh", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True)

    write_sweep(tmp_path / "datasets/quickstart/test/one.h5", 300.0)
    list_streams(tmp_path / "datasets/quickstart", {"id": "one", "split": "test", "scene": "board"})
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    plain = os.environ | {"PATH": path, "PYTHONPATH": os.pathsep.join(sys.path)}
    made = run(block_with("openssl") + "env", plain)
    assert made.returncode == 0, made.stderr
    secure = dict(line.split("=", 1) for line in made.stdout.splitlines() if "=" in line)
    start_scheduler, start_worker = localise(block_with("dask scheduler")).splitlines()
    evaluate = next(line for line in localise(block_with("saf-gen tune")).splitlines() if "evaluate" in line)
    with ExitStack() as undo:
        for command in (start_scheduler + " --protocol tls", start_worker):
            process = subprocess.Popen(
                ["sh", "-c", f"exec {command}"],
                cwd=tmp_path,
                env=secure,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
            undo.callback(end_session, process)
        found = run(evaluate + " --method sd+argmax", secure)
        assert found.returncode == 0, found.stderr
        assert "sd+argmax" in found.stdout
        monkeypatch.chdir(tmp_path)
        code, _, refused = call(*shlex.split(evaluate)[1:])
    assert (code, refused.count("\n")) == (2, 1), refused
    assert f"no Dask scheduler answers at 'tls://127.0.0.1:{port}': no certificates are set" in refused
