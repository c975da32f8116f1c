"""Build the site of the documentation: ``python tools/build_site.py --out build/site``, or ``make docs``.

The pages of the repository are copied to a folder with the same layout, so that their links remain valid, and Sphinx
builds a site from them with a search that needs no server. Two pages are only on the site: every command with its
options, and every public name with its docstring. Then every link, anchor and resource in the built pages is
checked: all links must have a target, nothing may be loaded from another host, and the search must find what readers
look for. A warning is an error.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlparse

from public_names import commands_page, python_page

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("*.md", "docs/**/*.md", "studies/**/*.md", "scenes/*/SOURCE.md", "datasets/README.md")
MADE = {"docs/commands.md": commands_page, "docs/python.md": python_page}
"""Pages that are only on the site, and the functions that make them."""
LINK = re.compile(r"\]\(([^)\s#]+)")
WHOLE_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s#:]+)\)")
SEARCHED = {
    "1000": "docs/your-recordings.md",
    "1000 x 1000": "docs/your-recordings.md",
    "depth map": "docs/files.md",
    "ground truth": "docs/truth-and-ranking.md",
    "pytorch cpu": "docs/install.md",
}
"""What readers search for, and the page that the search of the site must list first.

The search orders pages by their titles and does not count words, so these become entries of the index of these pages.
"""
LOADING = {"img": "src", "script": "src", "iframe": "src", "source": "src", "video": "src"}
"""Attributes from which elements load resources, by tag."""


def stage(target: Path) -> None:
    """Copy every page, and every file to which a page links, to the same relative path under ``target``."""
    pages = [path for pattern in PAGES for path in sorted(ROOT.glob(pattern))]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        text = "".join(line for line in text.splitlines(keepends=True) if "](../../actions/" not in line)  # badges
        text = WHOLE_LINK.sub(partial(unlink_folder, page), text)
        text += "".join(f"\n```{{index}} ! {query}\n```\n" for query, name in SEARCHED.items() if page == ROOT / name)
        if page == ROOT / "README.md":
            text += toctrees(pages)
        copy = target / page.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(text, encoding="utf-8")
        for link in LINK.findall(text):
            linked = (page.parent / link).resolve()
            if "://" not in link and linked.is_file() and linked.suffix != ".md" and linked.is_relative_to(ROOT):
                beside = target / linked.relative_to(ROOT)
                beside.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(linked, beside)
    for name, make in MADE.items():
        (target / name).write_text(make(), encoding="utf-8")
    shutil.copytree(ROOT / "tools/site", target, dirs_exist_ok=True)


def unlink_folder(page: Path, link: re.Match[str]) -> str:
    """Return a link of a page as it is, or its text alone if it leads to a folder, of which the site has no page."""
    return link[1] if (page.parent / link[2]).is_dir() else link[0]


def toctrees(pages: list[Path]) -> str:
    """Return the menu: the sections of docs/README.md with the pages to which they link, and then all other pages."""
    index = (ROOT / "docs/README.md").read_text(encoding="utf-8")
    menu: dict[str, list[str]] = {}
    listed = {"README.md", "docs/README.md"}
    for section in index.split("\n## ")[1:]:
        links = [(ROOT / "docs" / link).resolve() for link in LINK.findall(section)]
        title = section.split("\n")[0].split(":")[0]
        named = dict.fromkeys(one.relative_to(ROOT).as_posix() for one in links if one.suffix == ".md")
        menu[title] = [one for one in named if one not in listed]
        listed.update(named)
        if title == "Reference":
            menu[title] += MADE
    others = [page.relative_to(ROOT).as_posix() for page in pages]
    menu = {
        "Start": ["docs/README.md", *menu.pop("Start")],
        **menu,
        "More": [one for one in others if one not in listed],
    }
    trees = [
        f"\n```{{toctree}}\n:hidden:\n:maxdepth: 1\n:titlesonly:\n:caption: {title}\n\n" + "\n".join(group) + "\n```\n"
        for title, group in menu.items()
    ]
    return "".join(trees)


class Page(HTMLParser):
    """The resources that a built page loads, the targets of its links, and the anchors in it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.names: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record the resources, links and anchors of an element."""
        given = {key: value or "" for key, value in attrs}
        self.names.update(given[key] for key in ("id", "name") if key in given)
        if tag in LOADING and LOADING[tag] in given:
            self.loads.append(given[LOADING[tag]])
        elif tag == "link" and given.get("rel", "") in ("stylesheet", "preload", "icon", "shortcut icon"):
            self.loads.append(given["href"])
        elif tag == "a" and "href" in given:
            self.links.append(given["href"])


def find_faults(site: Path) -> Iterator[str]:
    """Yield a line for each link or resource of the site without a target, and for each resource on another host."""
    pages = {path: Page(path) for path in sorted(site.rglob("*.html"))}
    for path, page in pages.items():
        for kind, urls in (("loads", page.loads), ("links", page.links)):
            for url in urls:
                parts = urlparse(url)
                if parts.scheme == "data" or (kind == "links" and parts.scheme):
                    continue
                target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
                if parts.scheme or parts.netloc or not target.exists():
                    yield f"{path.relative_to(site)} {kind} {url}"
                elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].names:
                    yield f"{path.relative_to(site)} {kind} {url}: no such heading"
    for path in sorted([*site.rglob("*.css"), *site.rglob("*.js")]):
        if found := re.search(r"(@import|url\()\s*['\"]?https?://[^)'\"\s]+", path.read_text(encoding="utf-8")):
            yield f"{path.relative_to(site)} loads {found[0]}"


def find_lost_searches(site: Path, searched: Mapping[str, str]) -> Iterator[str]:
    """Yield a line for each of these queries whose page is not the first that the search of the site lists.

    Node runs the search; without Node, nothing is checked.
    """
    node = shutil.which("node")
    if node is None:
        return
    command = [node, str(ROOT / "tools/search_site.js"), str(site), *searched]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    for (query, page), found in zip(searched.items(), json.loads(ran.stdout), strict=True):
        if [f"{name}.md" for name in found[:1]] != [page]:
            yield f"the search for {query!r} lists {found[0] if found else 'nothing'}, not {page}"


def build(target: Path) -> int:
    """Build the site into a folder, and return the number of faults, or the exit code of Sphinx if it fails."""
    from sphinx.cmd.build import build_main

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "pages"
        stage(source)
        made = Path(folder) / "site"
        code = build_main(["-q", "-W", "--keep-going", "-j", "auto", "-b", "html", str(source), str(made)])
        if code:
            return code
        shutil.copyfile(made / "README.html", made / "index.html")
        faults = [*find_faults(made), *find_lost_searches(made, SEARCHED)]
        sys.stdout.writelines(f"{fault}\n" for fault in faults)
        if not faults:
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(made, target, ignore=shutil.ignore_patterns(".doctrees", ".buildinfo"))
            sys.stdout.write(f"{len(list(target.rglob('*.html')))} pages: {target / 'index.html'}\n")
    return len(faults)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build/site")
    sys.exit(min(build(parser.parse_args().out), 1))
