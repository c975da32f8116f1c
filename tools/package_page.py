"""Give the package the address of its repository, and its page in an index a README whose links work there.

Hatchling runs this hook on each build. The address comes from the workflow that builds a release, so forks get their
own; a build elsewhere knows none, has no URLs, and shows the README as it is.

A build without one of the folders of the package is refused, because Hatchling would leave it out without a word.
"""

import os
import re
import tomllib
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PAGES = {"Documentation": "docs/README.md", "Changelog": "CHANGELOG.md", "Validation": "studies/results/validation.md"}
LINK = re.compile(r"(?P<picture>!?)\[(?P<text>(?:!\[[^\]]*\]\([^)]*\)|[^\]])*)\]\((?P<path>[^)\s]+)\)")


class RepositoryLinks(MetadataHookInterface):
    """Set `urls` and `readme`, where the package is complete."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add both to the metadata of the package, in place."""
        check_folders(Path(self.root))
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        address = find_address()
        if address is not None:
            text = link_to(text, *address)
            metadata["urls"] = urls_of(*address)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def check_folders(root: Path) -> None:
    """Raise FileNotFoundError if a folder of the wheel is missing."""
    tool = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    folders = tool["hatch"]["build"]["targets"]["wheel"]["only-include"]
    missing = [folder for folder in folders if not (root / folder).is_dir()]
    if missing:
        raise FileNotFoundError(f"the package needs {', '.join(missing)} in {root}; copy all of {', '.join(folders)}")


def find_address() -> tuple[str, str] | None:
    """Return the address of the repository and the name of the version that is built; None if no workflow says them."""
    names = ("GITHUB_SERVER_URL", "GITHUB_REPOSITORY", "GITHUB_REF_NAME")
    server, repository, version = (os.environ.get(name, "") for name in names)
    return (f"{server}/{repository}", version) if server and repository and version else None


def urls_of(repository: str, version: str) -> dict[str, str]:
    """Return the links that a package page lists."""
    files = {title: f"{repository}/blob/{version}/{path}" for title, path in PAGES.items()}
    return {"Repository": repository, "Issues": f"{repository}/issues", **files}


def link_to(text: str, repository: str, version: str) -> str:
    """Return Markdown whose links to files of the checkout are absolute, those of pictures to the files themselves."""

    def absolute(path: str, kind: str) -> str:
        if re.match(r"[a-z]+:|#", path):
            return path
        return (
            f"{repository}/{path.removeprefix('../../')}"
            if path.startswith("../../")
            else f"{repository}/{kind}/{version}/{path}"
        )

    def replace(link: re.Match[str]) -> str:
        kind = "raw" if link["picture"] else "blob"
        return f"{link['picture']}[{LINK.sub(replace, link['text'])}]({absolute(link['path'], kind)})"

    return LINK.sub(replace, text)
