"""Seal a recipe, or open a sealed one with its secret: a test split that nobody has seen before it is opened.

    python -m studies.sealed seal RECIPE        writes RECIPE-sealed.yaml, to publish, and RECIPE.secret, to keep
    python -m studies.sealed open RECIPE-sealed.yaml SECRET        writes RECIPE-open.yaml, to generate
    python -m studies.sealed draw RECIPE COMMIT        writes RECIPE-drawn.yaml into this folder, to generate

The seed of a recipe determines every random number. A sealed seed is a commitment, the SHA-256 of a secret and a salt.
``saf-gen generate`` refuses it, because it is not a number. Whoever gets the secret later can check that it fits, and
generate the split. Scenes, lights and sizes of a sealed split are never hidden.

``draw`` needs no secret: the seed is a digest of the recipe's text and of the commit that fixes the method, so it does
not exist before the method does, and another method would meet other members.
"""

import argparse
import hashlib
import re
import secrets
from pathlib import Path

import yaml

from saf_gen.errors import BadInput

SEED_LINE = re.compile(r"^seed:[ \t]*(\{[^{}\n]*\}|[^\s#]+)", re.MULTILINE)


def seal(recipe: Path) -> tuple[Path, Path]:
    """Write a copy of a recipe with a sealed seed, and its new secret; return the two paths.

    Raises BadInput if the recipe is sealed already or has no line with a seed, or if one of the files exists.
    """
    text = recipe.read_text(encoding="utf-8")
    sealed, secret_file = recipe.with_stem(f"{recipe.stem}-sealed"), recipe.with_suffix(".secret")
    if isinstance(yaml.safe_load(text)["seed"], dict):
        raise BadInput(f"{recipe} is sealed already")
    for path in (sealed, secret_file):
        if path.exists():
            raise BadInput(f"{path} exists already", hint="sealed recipes and secrets are never overwritten")
    salt, secret = secrets.token_hex(16), secrets.token_hex(32)
    seed = f'{{sealed: "{commitment(secret, salt)}", salt: "{salt}"}}'
    published = _replace_seed(text, seed, where=recipe)
    secret_file.touch(mode=0o600)
    secret_file.write_text(f"{secret}\n", encoding="utf-8")
    sealed.write_text(published, encoding="utf-8")
    return sealed, secret_file


def open_sealed(recipe: Path, secret: str) -> Path:
    """Write a sealed recipe with the number that its seed hides, and return its path.

    Raises BadInput if the recipe is not sealed, the secret is not the sealed one, or the file exists.
    """
    text = recipe.read_text(encoding="utf-8")
    seed = yaml.safe_load(text)["seed"]
    opened = recipe.with_stem(f"{recipe.stem.removesuffix('-sealed')}-open")
    if not isinstance(seed, dict):
        raise BadInput(f"{recipe} is not sealed", hint="generate it as it is")
    if not re.fullmatch(r"[0-9a-f]{64}", secret):
        raise BadInput(f"{secret!r:.20} is not a secret", allowed="64 hexadecimal digits")
    if commitment(secret, seed["salt"]) != seed["sealed"]:
        raise BadInput(
            f"the secret {secret:.8}… is not that of {recipe}", allowed=f"the secret of {seed['sealed']:.8}…"
        )
    if opened.exists():
        raise BadInput(f"{opened} exists already", hint="remove it, or copy the sealed recipe under another name")
    opened.write_text(_replace_seed(text, str(hidden_seed(secret, seed["salt"])), where=recipe), encoding="utf-8")
    return opened


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
    text = _replace_seed(text, str(int.from_bytes(digest[:8]) >> 1), where=recipe)
    name = f"name: {yaml.safe_load(text)['name']}_drawn"
    drawn.write_text(re.sub(r"^name:.*", lambda _: name, text, flags=re.MULTILINE), encoding="utf-8")
    return drawn


def commitment(secret: str, salt: str) -> str:
    """Return the SHA-256 of secret and salt, which are given and returned in hexadecimal digits."""
    return hashlib.sha256(bytes.fromhex(secret) + bytes.fromhex(salt)).hexdigest()


def hidden_seed(secret: str, salt: str) -> int:
    """Return the seed, of 63 bits like that of any recipe, which secret and salt determine."""
    digest = hashlib.sha256(b"saf-gen sealed seed" + bytes.fromhex(salt) + bytes.fromhex(secret)).digest()
    return int.from_bytes(digest[:8]) >> 1


def _replace_seed(text: str, seed: str, *, where: Path) -> str:
    """Return the text of a recipe, including its comments, with another seed."""
    text, count = SEED_LINE.subn(lambda _: f"seed: {seed}", text)
    if count != 1:
        raise BadInput(f"{where} has no line with its seed", allowed="a line such as seed: 7")
    return text


def main(arguments: list[str] | None = None) -> None:
    """Read the command line, and print the paths of the files written."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("seal").add_argument("recipe", type=Path)
    opening = commands.add_parser("open")
    opening.add_argument("recipe", type=Path)
    opening.add_argument("secret", help="64 hexadecimal digits, or the file that holds them")
    drawing = commands.add_parser("draw")
    drawing.add_argument("recipe", type=Path)
    drawing.add_argument("commit", help="of the method, in full")
    given = parser.parse_args(arguments)
    try:
        if given.command == "seal":
            sealed, secret_file = seal(given.recipe)
            print(f"{sealed}   (publish it)\n{secret_file}   (show it to nobody, and do not lose it)")
        elif given.command == "draw":
            print(draw(given.recipe, given.commit))
        else:
            file = Path(given.secret)
            print(open_sealed(given.recipe, (file.read_text() if file.is_file() else given.secret).strip()))
    except (BadInput, OSError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
