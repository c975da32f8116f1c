"""The checks of `make docs` on the finished site find faults; only `make docs` builds the site itself."""

import shutil
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


def test_a_link_to_a_folder_is_only_text_on_the_site(site, tmp_path):
    site.stage(tmp_path)
    for page in tmp_path.rglob("*.md"):
        for link in site.LINK.findall(page.read_text(encoding="utf-8")):
            assert not (ROOT / page.relative_to(tmp_path)).parent.joinpath(link).is_dir(), f"{page.name}: {link}"


def test_pages_that_readers_search_for_exist_and_have_entries_of_the_index(site, tmp_path):
    site.stage(tmp_path)
    for query, page in site.SEARCHED.items():
        assert f"\n```{{index}} ! {query}\n```\n" in (tmp_path / page).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def small_site(tmp_path_factory):
    """A site of three pages, built with the settings of the real one."""
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    pytest.importorskip("myst_parser", reason="the extra docs is not installed")
    from sphinx.cmd.build import build_main

    source, made = tmp_path_factory.mktemp("pages"), tmp_path_factory.mktemp("site")
    shutil.copytree(ROOT / "tools/site", source, dirs_exist_ok=True)
    menu = "```{toctree}\nlayout\ntruth\n```\n"
    (source / "README.md").write_text(f"# Top\n\nA depth and a map, and much that has 7 words.\n\n{menu}")
    (source / "layout.md").write_text("# Files\n\nThe layout sps1000 has 2,048 columns, and sd_code.\n")
    (source / "truth.md").write_text("# Truth\n\nWhat is known.\n\n```{index} ! depth map\n```\n")
    assert build_main(["-q", "-W", "-b", "html", str(source), str(made)]) == 0
    return made


@pytest.mark.skipif(shutil.which("node") is None, reason="Node runs the search")
@pytest.mark.parametrize(
    ("query", "page"),
    [("1000", "layout"), ("2048", "layout"), ("sd_code", "layout"), ("code", "layout"), ("7", "README"),
     ("depth map", "truth"), ("depth map 7", "README")],
)  # fmt: skip
def test_the_search_finds_numbers_parts_of_names_and_entries(query, page, site, small_site):
    assert list(site.find_lost_searches(small_site, {query: f"{page}.md"})) == []
    other = {"layout": "truth"}.get(page, "layout")
    lost = f"the search for {query!r} lists {page}, not {other}.md"
    assert list(site.find_lost_searches(small_site, {query: f"{other}.md"})) == [lost]


def test_a_query_that_finds_nothing_is_lost(site, small_site):
    assert list(site.find_lost_searches(small_site, {"nowhere": "truth.md"})) == [
        "the search for 'nowhere' lists nothing, not truth.md"
    ]
