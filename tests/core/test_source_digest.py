"""Which files are behind a part, and what moves the digest of a method's code."""

import subprocess
import sys
from pathlib import Path

import pytest
from own_plugins import PARTS

import saf_gen
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.core.config.source_digest import source_digests
from saf_gen.measures import get_measure
from saf_gen.searches import get_search

USES = """\
{imports}
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import saf_gen.stream.stream_file


@dataclass(frozen=True)
class Mine:
    degree: ClassVar[int] = 1
    source: ClassVar[str] = "a test"

    def __call__(self, counts):
        {late}
        return float(np.sum(counts)) * {scale}
"""


def written(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def mine(imports: str, scale: str, late: str = "pass") -> str:
    return USES.format(imports=imports, scale=scale, late=late)


def names(*parts: object) -> list[str]:
    return [name for name, _ in source_digests(map(type, parts))]


def code_of(spec: str, folder: Path) -> str:
    """The digest of a method as another process sees it, which finds modules in ``folder`` too."""
    run = f"import sys; sys.path.insert(0, {str(folder)!r})\n"
    run += f"from saf_gen.benchmark.method_spec import parse_method\nprint(parse_method({spec!r}).code)"
    done = subprocess.run([sys.executable, "-c", run], capture_output=True, text=True, check=True, cwd=folder)
    return done.stdout.strip()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder that Python looks into; what is loaded from it is forgotten afterwards."""
    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_helpers_beside_a_file_are_behind_it_by_whatever_way_they_are_imported(folder):
    written(
        folder,
        {
            "src_a.py": mine("import src_b\nfrom src_c import SCALE as s", "s * src_b.SCALE", "import src_d"),
            "src_b.py": "SCALE = 2.0\n",
            "src_c.py": "from src_set.deep import SCALE\n",
            "src_d.py": "from src_set import other\n",
            "src_set/__init__.py": "",
            "src_set/deep.py": "from . import sibling\nSCALE = 3.0\n",
            "src_set/sibling.py": "import src_b\n",
            "src_set/other.py": "import src_b\n",
            "src_unused.py": "",
        },
    )
    assert names(get_measure(f"{folder / 'src_a.py'}:Mine")) == [
        "src_a.py",
        "src_b.py",
        "src_c.py",
        "src_d.py",
        "src_set/__init__.py",
        "src_set/deep.py",
        "src_set/other.py",
        "src_set/sibling.py",
    ]


def test_helpers_of_a_package_are_behind_its_parts_and_no_other_package(folder):
    written(
        folder,
        {
            "src_pkg/__init__.py": "",
            "src_pkg/one/__init__.py": "",
            "src_pkg/one/measure.py": mine("from ..util import SCALE\nimport src_other", "SCALE"),
            "src_pkg/util.py": "from src_pkg import far\nSCALE = 2.0\n",
            "src_pkg/far.py": "",
            "src_pkg/unused.py": "",
            "src_other/__init__.py": "",
        },
    )
    assert names(get_measure("src_pkg.one.measure:Mine")) == [
        "src_pkg/__init__.py",
        "src_pkg/far.py",
        "src_pkg/one/measure.py",
        "src_pkg/util.py",
    ]


@pytest.mark.parametrize(
    ("part", "helper", "spec"),
    [("src_e.py", "src_f.py", "src_e.py:Mine"), ("src_p/e.py", "src_p/f.py", "src_p.e:Mine")],
    ids=["file", "package"],
)
@pytest.mark.slow
def test_the_digest_follows_a_helper_and_not_the_place(tmp_path, part, helper, spec):
    imports = "from src_f import SCALE" if part == "src_e.py" else "from .f import SCALE"
    files = {part: mine(imports, "SCALE"), helper: "SCALE = 2.0\n"}
    here, there = written(tmp_path / "here", files), written(tmp_path / "elsewhere" / "there", files)
    first = code_of(f"{spec}+argmax", here)
    assert len(first) == 12
    assert code_of(f"{spec}+argmax", there) == first
    (there / "beside.py").write_text("SCALE = 4.0\n")
    (there / helper).write_bytes(b"SCALE = 2.0\r\n")
    assert code_of(f"{spec}+argmax", there) == first
    (there / helper).write_text("SCALE = 3.0\n")
    assert code_of(f"{spec}+argmax", there) != first


def test_the_same_file_in_two_folders_is_the_same_code(tmp_path):
    files = {"parts.py": PARTS}
    here, there = (written(tmp_path / name, files) / "parts.py" for name in ("a", "b"))
    assert (
        parse_method(f"{here}:Range+{here}:Middle").code == parse_method(f"{there}:Range+{there}:Middle").code
    )


def test_ours_are_their_room_and_not_the_package():
    assert names(get_measure("sd_code"), get_search("egs_code")) == [
        "saf_gen/measures/_counts.py",
        "saf_gen/measures/_moments.py",
        "saf_gen/measures/sd_code.py",
        "saf_gen/searches/_golden_narrowing.py",
        "saf_gen/searches/egs_code.py",
    ]


def test_a_helper_of_ours_that_somebody_takes_is_behind_their_part(folder, monkeypatch):
    """The folder holds a saf_gen too, as a checkout does: it is not one of the neighbours."""
    (folder / "saf_gen").symlink_to(Path(saf_gen.__file__).parent)
    written(folder, {"src_g.py": mine("from saf_gen.measures._moments import variance", "1")})
    assert names(get_measure(f"{folder / 'src_g.py'}:Mine")) == [
        "saf_gen/measures/_counts.py",
        "saf_gen/measures/_moments.py",
        "src_g.py",
    ]


def test_neighbours_of_an_installed_file_are_strangers(folder, monkeypatch):
    monkeypatch.syspath_prepend(folder / "site-packages")
    home = written(
        folder / "site-packages",
        {"src_h.py": mine("import src_i, statistics", "1"), "src_i.py": ""},
    )
    assert names(get_measure(f"{home / 'src_h.py'}:Mine")) == ["src_h.py"]


def test_a_module_of_pythons_own_is_not_mistaken_for_a_neighbour(folder):
    import statistics  # noqa: F401 loaded before, so this is what the file gets

    written(folder, {"src_j.py": mine("import statistics", "1"), "statistics.py": ""})
    assert names(get_measure(f"{folder / 'src_j.py'}:Mine")) == ["src_j.py"]


def test_a_helper_that_is_not_python_counts_by_its_text(folder):
    written(folder, {"src_k.py": mine("", "1", "import src_l"), "src_l.py": "print 'of another age'\n"})
    assert names(get_measure(f"{folder / 'src_k.py'}:Mine")) == ["src_k.py", "src_l.py"]


def test_a_part_without_a_file_is_named_by_its_module():
    made: dict[str, object] = {"__name__": "src_nowhere"}
    exec("class Part: pass", made)
    assert source_digests([made["Part"]]) == [["src_nowhere", ""]]
