"""What docs/how-to/object-store.md says to do is done on this machine, word for word."""

import os
import re
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from dask_processes import end_session
from small_dataset import SCENES, SMALL_RECIPE

PAGE = (Path(__file__).resolve().parent.parent / "docs/how-to/object-store.md").read_text(encoding="utf-8")

ONE_LIGHT = SMALL_RECIPE.replace("[constant, continuous, lamp_only]", "[constant]")
RECIPE = ONE_LIGHT.replace("name: small", "name: quickstart")


@pytest.mark.slow
def test_a_dataset_is_generated_into_a_store_and_evaluated_from_it_as_the_page_says(tmp_path):
    """Port and recipe are others, so that the server is ours and the render takes seconds; pip is not run."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    (tmp_path / "quickstart.yaml").write_text(RECIPE)
    blocks = [
        re.sub(r"generate quickstart", "generate ./quickstart.yaml", text)
        .replace("5000", str(port))
        .replace("usaf_target-constant-00", "plane-constant-00")
        for text in re.findall(r"^```\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    ]
    install, variables, server, generate, evaluate, python = blocks
    assert install == "pip install 'saf-gen[s3]'\n"
    start, make_bucket = server.splitlines()
    tools = Path(sys.executable).parent
    environment = os.environ | {
        "PATH": os.pathsep.join([str(tools), *(f"{p}/bin" for p in sys.path if p), os.environ["PATH"]]),
        "PYTHONPATH": os.pathsep.join(sys.path),
        "SAF_GEN_SCENES": str(SCENES),
    }

    def run(script):
        command = ["sh", "-ec", f"{variables}{script}"]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)

    command = start.partition("&& ")[2].removesuffix(" &").replace("moto_server", f"{sys.executable} -m moto.server")
    process = subprocess.Popen(
        ["sh", "-c", f"exec {command}"],
        cwd=tmp_path,
        env=environment,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        for _ in range(600):
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
                break
            time.sleep(0.1)
        made = run(f"{make_bucket}\n{generate}")
        assert made.returncode == 0, made.stderr
        assert "to upload to s3://lab/quickstart: about" in made.stdout
        assert "1 sequences recorded, 0 kept from before" in made.stdout
        assert "1 of 1 sequences are whole" in made.stdout
        looked = run(evaluate)
        assert looked.returncode == 0, looked.stderr
        assert (tmp_path / "results/leaderboard.json").is_file()
        assert "s3://lab/quickstart/test/plane-constant-00.h5" in looked.stdout
        assert (tmp_path / "target.png").stat().st_size > 1_000
        (tmp_path / "read.py").write_text(python)
        read = run(f"{sys.executable} read.py")
        assert read.stdout.startswith("(400, 40, 64) "), read.stderr
        assert not list((tmp_path / "datasets").iterdir())
    finally:
        end_session(process)
