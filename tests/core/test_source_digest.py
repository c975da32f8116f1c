"""The source files of a plug-in, and the digest of a method's code."""

import subprocess
import sys
from pathlib import Path

import pytest

from saf_gen.benchmark.method_spec import parse_method
from saf_gen.core.config.source_digest import class_source_digests
from saf_gen.plugins.measures import get_measure
from saf_gen.plugins.searches import get_search

USES = """\
{imports}
from dataclasses import dataclass
from typing import ClassVar

import numpy as np


@dataclass(frozen=True)
class Mine:
    degree: ClassVar[int] = 1
    source: ClassVar[str] = "a test"

    def __call__(self, counts):
        {late}
        return float(np.sum(counts)) * {scale}
"""
HELPER = '''"""A number."""

SCALE = 2.0
"""It scales."""


def double(x):
    """Return twice x."""
    return 2 * x
'''


def write_files(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def mine(imports: str, scale: str = "1", late: str = "pass") -> str:
    return USES.format(imports=imports, scale=scale, late=late)


def names(*plugins: object) -> list[str]:
    return [name for name, _ in class_source_digests(map(type, plugins))]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder on Python's path, whose modules are unloaded afterwards."""
    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_private_modules_next_to_a_file_are_sources_wherever_it_imports_them(folder):
    files = {
        "src_a.py": mine("import _src_b, statistics\nfrom _src_c import SCALE as s", "s", "import _src_d"),
        "_src_b.py": "import src_public\n",
        "_src_c.py": "import _src_b\nSCALE = 2.0\n",
        "_src_d.py": "print 'Python 2'\n",
        "_src_unused.py": "",
        "src_public.py": "",
        "statistics.py": "",
    }
    write_files(folder, files)
    own = get_measure(f"{folder / 'src_a.py'}:Mine")
    assert names(own) == ["_src_b.py", "_src_c.py", "_src_d.py", "src_a.py"]


@pytest.mark.parametrize(
    "imports", ["from ._util import SCALE", "from . import _util", "from {package}.one._util import SCALE"]
)
def test_private_modules_of_a_package_are_behind_its_plugins(folder, imports):
    files = {"__init__.py": "", "one/__init__.py": "", "one/_util.py": HELPER, "_util.py": "", "_other.py": ""}
    package = f"src_pkg_{len(imports)}"
    files["one/measure.py"] = mine(f"{imports.format(package=package)}\nfrom .. import _other")
    write_files(folder / package, files)
    assert names(get_measure(f"{package}.one.measure:Mine")) == ["_util.py", "measure.py"]


def code_of(spec: str, folder: Path) -> str:
    """Return the digest of a method as computed by another process that also finds modules in ``folder``."""
    run = f"import sys; sys.path.insert(0, {str(folder)!r})\n"
    run += f"from saf_gen.benchmark.method_spec import parse_method\nprint(parse_method({spec!r}).code)"
    done = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, check=True, cwd=folder)
    return done.stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("own", "helper", "spec"),
    [("src_e.py", "_src_f.py", "src_e.py:Mine"), ("src_p/e.py", "src_p/_src_f.py", "src_p.e:Mine")],
    ids=["file", "package"],
)
def test_the_digest_follows_the_code_of_a_helper_and_not_its_text_or_place(tmp_path, own, helper, spec):
    imports = "from _src_f import SCALE" if own == "src_e.py" else "from ._src_f import SCALE"
    files = {own: mine(imports, "SCALE"), helper: HELPER}
    here, there = write_files(tmp_path / "here", files), write_files(tmp_path / "elsewhere" / "there", files)
    first = code_of(f"{spec}+argmax", here)
    assert len(first) == 12
    reformatted = "SCALE = (  # two\r\n    2.0\r\n)\r\ndef double(x): return (2*x)\r\n"
    (there / helper).write_bytes(reformatted.encode())
    assert code_of(f"{spec}+argmax", there) == first
    (there / helper).write_text(HELPER.replace("2.0", "3.0"))
    assert code_of(f"{spec}+argmax", there) != first


def test_behind_our_plugins_are_the_private_modules_of_their_folder():
    found = names(get_measure("sd_code"), get_search("egs_code"))
    assert found == ["_counts.py", "_golden_narrowing.py", "_moments.py", "egs_code.py", "sd_code.py"]


def test_the_digest_did_not_change_when_our_plugins_moved_to_a_folder(folder):
    late = "from saf_gen{}.measures._counts import as_integers"
    digests = []
    for name, inside in (("old", ""), ("new", ".plugins")):
        write_files(folder, {f"{name}/src_moved.py": mine("import math", late=late.format(inside))})
        digests += class_source_digests([type(get_measure(f"{folder / name / 'src_moved.py'}:Mine"))])
    assert digests[0] == digests[1]


def test_a_class_without_a_file_is_named_by_its_module():
    made: dict[str, object] = {"__name__": "src_nowhere"}
    exec("class Part: pass", made)
    assert class_source_digests([made["Part"]]) == [["src_nowhere", ""]]
    assert parse_method("sd+argmax").code == parse_method("sd+argmax").code
