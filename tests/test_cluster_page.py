"""The manual steps of docs/how-to/machines.md, with certificates, are run on this machine as written."""

import os
import re
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from dask_processes import end_session
from planted_sweeps import list_streams, write_sweep

PAGE = (Path(__file__).resolve().parent.parent / "docs/how-to/machines.md").read_text(encoding="utf-8")


def block_with(words: str) -> str:
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    (found,) = (text for language, text in blocks if words in text and not language)
    return found


@pytest.mark.slow
def test_a_cluster_by_hand_with_certificates_evaluates_and_refuses_who_has_none(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])

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
        refused = run(evaluate, plain)
    assert (refused.returncode, len(refused.stderr.splitlines())) == (2, 1), refused.stderr
    assert f"no Dask scheduler answers at 'tls://127.0.0.1:{port}': no certificates are set" in refused.stderr
