"""Steps of docs/how-to/machines.md and cluster.md are run as written: job arrays, certificates, an object store."""

import os
import re
import shlex
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from dask_processes import end_session
from planted_sweeps import list_streams, write_sweep
from small_dataset import SCENES, SMALL_RECIPE

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs/how-to/cluster.md").read_text(encoding="utf-8")
STEPS = (ROOT / "docs/how-to/machines.md").read_text(encoding="utf-8").split("## Keep datasets in an object store")[1]

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
@pytest.mark.parametrize("words", ["for shard in 1 2 3", "dataset merge", "SLURM_ARRAY_TASK_ID"])
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


@pytest.mark.slow
def test_a_dataset_is_generated_into_a_store_and_evaluated_from_it_as_the_page_says(
    tmp_path, monkeypatch, call, capsys, forget_store_clients
):
    """Port and recipe are replaced, for a local server and a render of seconds; pip is not run.

    The server and the creation of the bucket are separate processes; saf-gen and Python code run in this one.
    """
    port = find_port()
    (tmp_path / "quickstart.yaml").write_text(RECIPE)
    blocks = [
        re.sub(r"generate quickstart", "generate ./quickstart.yaml", text)
        .replace("5000", str(port))
        .replace("usaf_target-constant-00", "plane-constant-00")
        for text in re.findall(r"^```\n(.*?)^```$", STEPS, re.DOTALL | re.MULTILINE)
    ]
    install, variables, server, generate, evaluate, python = blocks
    assert install == "pip install 'saf-gen[s3]'\n"
    start, make_bucket = server.splitlines()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    monkeypatch.setenv("SAF_GEN_SCENES", str(SCENES))
    for name, value in re.findall(r"(\w+)=(\S+)", variables):
        monkeypatch.setenv(name, value)

    def run(block):
        printed = ""
        for program, *words in map(shlex.split, block.splitlines()):
            assert program == "saf-gen"
            code, out, err = call(*words)
            assert code == 0, err
            printed += out
        return printed

    command = start.partition("&& ")[2].removesuffix(" &").replace("moto_server", f"{sys.executable} -m moto.server")
    process = subprocess.Popen(["sh", "-c", f"exec {command}"], stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        for _ in range(600):
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
                break
            time.sleep(0.1)
        subprocess.run(["sh", "-ec", make_bucket], check=True)
        generated = run(generate)
        assert "to upload to s3://lab/quickstart: about" in generated
        assert "1 sequence recorded, 0 kept from before" in generated
        assert "1 of 1 sequence is intact" in generated
        assert "s3://lab/quickstart/test/plane-constant-00.h5" in run(evaluate)
        assert (tmp_path / "results/leaderboard.json").is_file()
        assert (tmp_path / "target.png").stat().st_size > 1_000
        exec(compile(python, str(tmp_path / "read.py"), "exec"), {"__name__": "__main__"})
        assert capsys.readouterr().out.startswith("(400, 40, 64) ")
        assert not list((tmp_path / "datasets").iterdir())
    finally:
        end_session(process)
