"""Every command prints its help, or fails in one line, whatever becomes of the standard streams."""

import json
import subprocess
import sys

import pytest

PROGRAM = """\
import json, os, sys, traceback
from saf_gen.cli import _terminal, main, root_command

def paths(command, at=()):
    yield at
    for name, child in sorted(getattr(command, "commands", {}).items()):
        yield from paths(child, (*at, name))

NAMES = ("stdin", "stdout", "stderr")

def run(words, number, how):
    out, into = os.pipe()
    child = os.fork()
    if not child:
        code = 70
        try:
            os.dup2(into, 1), os.dup2(into, 2)
            sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)
            if how == "full":
                os.dup2(os.open("/dev/full", os.O_WRONLY), number)
            else:  # as Python finds them when it starts
                os.close(number)
                setattr(sys, NAMES[number], None)
                _terminal._prepare_streams()
            main([*words])
        except SystemExit as ended:
            code = int(ended.code or 0)
        except BaseException:
            os.write(into, traceback.format_exc().encode())
        os._exit(code)
    os.close(into)
    with open(out, "rb") as file:
        said = file.read().decode(errors="replace")
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), said

WAYS = [(0, "closed"), (1, "closed"), (2, "closed"), (1, "full"), (2, "full")]
every, found = int(sys.argv[1]), []
commands = [*((*path, "--help") for path in paths(root_command())), ("nonsense",), ("scenes", "list"), ("methods",)]
for at, words in enumerate(commands):
    for way in range(len(WAYS)):
        if (at + way) % every == 0:
            found.append([" ".join(words), NAMES[WAYS[way][0]], WAYS[way][1], *run(words, *WAYS[way])])
print(json.dumps(found))
"""


@pytest.mark.slow
@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.long)])
def test_no_command_fails_on_a_closed_or_full_stream_but_in_one_line(every):
    """Each way for one command in five, or for all; one process forks for each, as starting anew takes far longer."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(every)], capture_output=True, text=True, check=True)
    endings = json.loads(done.stdout)
    assert len({words for words, *_ in endings}) > 35
    for words, stream, how, code, said in endings:
        expected = 2 if words == "nonsense" else 1 if (stream, how) == ("stdout", "full") else 0
        lines = [line for line in said.splitlines() if line.startswith("saf-gen:")]
        told = expected > 0 and stream != "stderr"
        assert ("Traceback" in said, code, len(lines)) == (False, expected, int(told)), (words, stream, how, code, said)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["methods", "methods show sd", "scenes list", "evaluate --help", "recipes list"])
def test_a_reader_that_goes_away_ends_a_command_quietly(command):
    words = f"set -o pipefail; {sys.executable} -m saf_gen {command} | head -1"
    done = subprocess.run(["bash", "-c", words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr, len(done.stdout.splitlines())) == (0, "", 1)
