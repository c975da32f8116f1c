"""Check that a tag may be released: python tools/check_release.py v1.2.3

The tag, saf_gen.__version__, CITATION.cff and the first version heading of CHANGELOG.md must name the same version.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLACES = {
    "saf_gen/__init__.py": r'^__version__ = "(.+)"$',
    "CITATION.cff": r"^version: (.+)$",
    "CHANGELOG.md": r"^## (\d\S*)",
}


def find_versions() -> dict[str, str]:
    """Return the first version in each file, or '' if it has none."""
    found = {}
    for name, pattern in PLACES.items():
        match = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
        found[name] = match[1] if match else ""
    return found


def main(tag: str) -> None:
    wrong = [f"{name} says {version or 'none'}" for name, version in find_versions().items() if f"v{version}" != tag]
    if wrong:
        sys.exit(f"the tag is {tag}, but {', '.join(wrong)}: name one version everywhere, and tag again")


if __name__ == "__main__":
    main(*sys.argv[1:])
