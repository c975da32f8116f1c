"""Write constraints.txt from outputs of `pip freeze`: python tools/merge_constraints.py 3.11=FILE 3.12=FILE ...

A package has a single line if its version is the same under all Pythons, and otherwise a line for each range of Python
versions.
"""

import re
import sys
from itertools import groupby
from pathlib import Path

HEAD = """\
# Versions that the tests ran with, under Python {pythons}: pip install --constraint constraints.txt ...
# Made by tools/merge_constraints.py from environments with the extras all, validation, docs and test.
"""


def read_freeze(text: str) -> dict[str, str]:
    """Return versions by package name, without packages that were not installed from an index."""
    found = dict(re.findall(r"^([A-Za-z0-9._-]+)==(\S+)$", text, re.MULTILINE))
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in found.items()}


def merge(frozen: dict[str, dict[str, str]]) -> str:
    """Return the text of constraints.txt; ``frozen`` gives versions of packages by Python version, oldest first."""
    pythons, lines = list(frozen), []
    for name in sorted(set().union(*frozen.values())):
        versions = {python: frozen[python].get(name) for python in pythons}
        for version, run in groupby(pythons, versions.__getitem__):
            first, *_, last = [*run] * 2
            if version is None:
                continue
            bounds = [f"python_version >= '{first}'"] if first != pythons[0] else []
            bounds += [f"python_version <= '{last}'"] if last != pythons[-1] else []
            lines.append(f"{name}=={version}" + (f" ; {' and '.join(bounds)}" if bounds else ""))
    return HEAD.format(pythons=", ".join(pythons)) + "\n".join(lines) + "\n"


def main(*given: str) -> None:
    files = dict(one.split("=", 1) for one in given)
    frozen = {python: read_freeze(Path(file).read_text(encoding="utf-8")) for python, file in files.items()}
    (Path(__file__).resolve().parent.parent / "constraints.txt").write_text(merge(frozen), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
