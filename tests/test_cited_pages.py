"""Pages of the documentation that code, templates and error messages name exist, and say what they are named for."""

import re

import pytest
import yaml
from small_dataset import HERE

ROOT = HERE.parent
PAGE = re.compile(r"(?<![\w/])docs/([\w/-]+\.md)(#[\w-]+)?")
WRITTEN = ("saf_gen", "recipes", "scenes", "studies", "tools", "Makefile", "Dockerfile", "saf-gen.def")
ONLY_ON_THE_SITE = {"commands.md", "python.md"}
TEXTS = {".py", ".in", ".yaml", ".yml", ".md", ".xml", ".html", ".js", ".css", ".def", ".sh", ""}


def heading_anchors(text):
    """Return the anchors of the headings of a page, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL), re.MULTILINE)
    return {"#" + re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def find_dead_citations(files):
    """Yield the file and the page for each page or heading that is named and does not exist."""
    for file in files:
        for page, anchor in PAGE.findall(file.read_text(encoding="utf-8")):
            path = ROOT / "docs" / page
            if page in ONLY_ON_THE_SITE:
                continue
            if not path.is_file() or (anchor and anchor not in heading_anchors(path.read_text(encoding="utf-8"))):
                yield f"{file.name} names docs/{page}{anchor}"


def written_files():
    for name in WRITTEN:
        top = ROOT / name
        for path in [top] if top.is_file() else sorted(top.rglob("*")):
            cached = any(part.startswith((".", "__pycache__")) for part in path.relative_to(ROOT).parts)
            if path.is_file() and path.suffix in TEXTS and not cached:
                yield path


def test_every_page_that_a_file_names_exists():
    assert list(find_dead_citations(written_files())) == []


@pytest.mark.parametrize(
    ("cited", "dead"),
    [
        ("docs/lenses.md", False),
        ("docs/lense.md", True),
        ("docs/renderer.md#grain", False),
        ("docs/renderer.md#grains", True),
    ],
)
def test_a_page_or_heading_that_does_not_exist_is_found(cited, dead, tmp_path):
    (tmp_path / "a.py").write_text(f'HINT = "see {cited}"\n', encoding="utf-8")
    assert list(find_dead_citations([tmp_path / "a.py"])) == ([f"a.py names {cited}"] if dead else [])


@pytest.mark.parametrize("kind", ["script", "xml"])
def test_the_template_of_a_scene_cites_the_page_that_lists_all_its_keys(kind):
    card = (ROOT / f"saf_gen/authoring/templates/{kind}/scene.yaml").read_text(encoding="utf-8")
    cited = re.search(r"Every key is listed in\s+#\s+(docs/[\w/-]+\.md)", card)[1]
    listed = re.findall(r"`([\w.]+)`", (ROOT / cited).read_text(encoding="utf-8"))
    tops = {key.partition(".")[0] for key in listed}
    assert set(yaml.safe_load(card)) <= tops
