"""The checks of `make docs` on the finished site find faults; only `make docs` builds the site itself."""

import sys

import pytest
from small_dataset import HERE

ROOT = HERE.parent


@pytest.fixture(scope="module")
def site():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "tools"))
        import build_site

        yield build_site
        del sys.modules["build_site"]


PAGE = """<html><head><link rel="stylesheet" href="page.css"><script src="page.js"></script></head>
<body><h1 id="top">Top</h1><a href="#top">up</a> <a href="other.html#there">other</a>
<a href="https://doi.org/10.1103/PhysRev.36.823">a source</a> <img src="picture.png"></body></html>"""


@pytest.fixture
def made(tmp_path):
    (tmp_path / "page.html").write_text(PAGE)
    (tmp_path / "other.html").write_text("<p id='there'>There</p>")
    (tmp_path / "page.css").write_text("body { background: url(picture.png); }")
    (tmp_path / "page.js").write_text("const source = 'https://example.org';")
    (tmp_path / "picture.png").write_bytes(b"")
    return tmp_path


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("other.html#there", "other.html", None),
        ("other.html#there", "nowhere.html", "page.html links nowhere.html"),
        ("other.html#there", "other.html#here", "page.html links other.html#here: no such heading"),
        ("#top", "#bottom", "page.html links #bottom: no such heading"),
        ("picture.png", "lost.png", "page.html loads lost.png"),
        ("page.js", "https://example.org/page.js", "page.html loads https://example.org/page.js"),
    ],
)
def test_a_link_or_resource_that_leads_nowhere_or_away_is_a_fault(right, wrong, fault, site, made):
    (made / "page.html").write_text(PAGE.replace(right, wrong))
    assert list(site.find_faults(made)) == ([fault] if fault else [])


def test_pages_are_laid_out_like_the_repository_and_all_are_in_the_menu(site, tmp_path):
    site.stage(tmp_path)
    front = (tmp_path / "README.md").read_text(encoding="utf-8")
    staged = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.md")}
    assert {path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")} <= staged
    menu = front.split("```{toctree}", 1)[1].splitlines()
    assert staged - {"README.md"} == {line for line in menu if line.endswith(".md")}
    assert (tmp_path / "docs/pictures/stack-camel.png").exists()
    assert "../../actions/" not in front
