"""Draw a test split that nobody has seen: its seed is determined by the commit that fixes a method.

    python -m studies.sealed draw RECIPE COMMIT        writes RECIPE-drawn.yaml into the working folder

The seed of a recipe determines every random number. That of the drawn recipe is a digest of the recipe's text and of
the commit, so it does not exist before the method does, and another method would meet other members.
"""

import argparse
import hashlib
import re
from pathlib import Path

import yaml

from saf_gen.errors import BadInput

SEED_LINE = re.compile(r"^seed:[ \t]*[^\s#]+", re.MULTILINE)


def draw(recipe: Path, commit: str) -> Path:
    """Write a copy of a recipe whose seed its text and a commit determine into the working folder; return its path.

    Raises BadInput if the commit is not given in full, the recipe has no line with a seed, or the file exists.
    """
    if not re.fullmatch(r"[0-9a-f]{40}|[0-9a-f]{64}", commit):
        raise BadInput(f"{commit!r:.20} is not a commit", allowed="40 hexadecimal digits: git rev-parse HEAD")
    text, drawn = recipe.read_text(encoding="utf-8"), Path(f"{recipe.stem}-drawn.yaml")
    if drawn.exists():
        raise BadInput(f"{drawn} exists already", hint="remove it, or work in another folder")
    digest = hashlib.sha256(f"saf-gen drawn seed\n{commit}\n{text}".encode()).digest()
    seed = int.from_bytes(digest[:8]) >> 1  # 63 bits, like that of any recipe
    text, count = SEED_LINE.subn(f"seed: {seed}", text)
    if count != 1:
        raise BadInput(f"{recipe} has no line with its seed", allowed="a line such as seed: 7")
    name = f"name: {yaml.safe_load(text)['name']}_drawn"
    drawn.write_text(re.sub(r"^name:.*", lambda _: name, text, flags=re.MULTILINE), encoding="utf-8")
    return drawn


def main(arguments: list[str] | None = None) -> None:
    """Read the command line, and print the path of the file written."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=["draw"])
    parser.add_argument("recipe", type=Path)
    parser.add_argument("commit", help="of the method, in full")
    given = parser.parse_args(arguments)
    try:
        print(draw(given.recipe, given.commit))
    except (BadInput, OSError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
