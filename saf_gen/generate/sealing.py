"""Sealed recipes: a test split whose members and noise nobody knows until its secret is published.

The ``seed`` of a recipe determines every random number. A sealed seed is a commitment, the SHA-256 of secret and salt,
which is published before anybody submits. Everyone who receives the secret later can check that it fits, generate the
split, and compare digests. The scenes, lights and sizes of the split are never hidden.
"""

import hashlib
import hmac
import re
import secrets
from pathlib import Path
from typing import Annotated

from pydantic import Field

from saf_gen.core.config.document import Document, FrozenModel, validate_document
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.core.files import refuse_link, write_text
from saf_gen.errors import BadInput

_DIGITS = 32
"""Hexadecimal digits of a salt; a secret and a commitment have twice as many."""
UNSEAL = "run saf-gen recipes unseal RECIPE --secret FILE once the secret is published"


class SealedSeed(FrozenModel):
    """The ``seed`` of a sealed recipe; together with its ``secret`` it determines a number."""

    sealed: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """SHA-256 of the bytes of the secret, followed by the bytes of the salt."""
    salt: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
    """16 random bytes, public from the beginning."""
    secret: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    """32 random bytes, published at the end."""


class _WithSealedSeed(FrozenModel):
    seed: SealedSeed


def open_seed(document: Document) -> None:
    """Replace the sealed ``seed`` of a recipe by the number that it hides; leave other recipes unchanged.

    Raises BadInput, with the line, if a sealed seed has no secret, or a secret that does not fit.
    """
    if not _is_sealed(document):
        return
    seed = _read_seed(document)
    if seed.secret is None:
        raise BadInput("this recipe is sealed", where=document.locate("seed"), hint=UNSEAL)
    _check_secret(seed, seed.secret, where=document.locate("seed", "secret"))
    digest = hashlib.sha256(b"saf-gen sealed seed" + bytes.fromhex(seed.salt) + bytes.fromhex(seed.secret)).digest()
    document.data["seed"] = int.from_bytes(digest[:8]) >> 1  # 63 bits, like the seed of any recipe


def seal_recipe(recipe: Path, sealed: Path, *, secret_file: Path) -> SealedSeed:
    """Write a copy of a recipe with a sealed seed, and the new secret to a file that only its owner may read.

    Returns the sealed seed, without its secret. Raises BadInput if the recipe is sealed already, if its seed is not on
    a line of its own, or if one of the files exists already.
    """
    document = read_yaml(recipe)
    if _is_sealed(document):
        raise BadInput("this recipe is sealed already", where=document.locate("seed"))
    for path in (sealed, secret_file):
        refuse_link(path)
        if path.exists():
            hint = "choose another name: sealed recipes and secrets are never overwritten"
            if not sealed.exists():  # the secret is written first: a run was stopped, or the sealed recipe was moved
                hint += f"; or remove it if no recipe was published with it: there is no {sealed}"
            raise BadInput(f"{path} exists already", hint=hint)
    salt, secret = secrets.token_hex(_DIGITS // 2), secrets.token_hex(_DIGITS)
    seed = SealedSeed(sealed=_commitment(secret, salt), salt=salt)
    text = _replace_seed(document, f'{{sealed: "{seed.sealed}", salt: "{seed.salt}"}}')
    secret_file.parent.mkdir(parents=True, exist_ok=True)
    secret_file.touch(mode=0o600)
    secret_file.write_text(f"{secret}\n", encoding="utf-8")
    write_text(sealed, text)
    return seed


def unseal_recipe(recipe: Path, opened: Path, *, secret: str) -> None:
    """Write a sealed recipe together with its secret, as ``saf-gen generate`` accepts it.

    Raises BadInput if the recipe is not sealed, the secret does not fit, or the file exists already.
    """
    document = read_yaml(recipe)
    if not _is_sealed(document):
        raise BadInput("this recipe is not sealed", where=str(recipe), hint="generate it as it is")
    seed = _read_seed(document)
    _check_secret(seed, secret, where=document.locate("seed"))
    if opened.exists():
        raise BadInput(f"{opened} exists already", hint="choose another name with --out")
    text = f'{{sealed: "{seed.sealed}", salt: "{seed.salt}", secret: "{secret}"}}'
    write_text(opened, _replace_seed(document, text))


def _is_sealed(document: Document) -> bool:
    return isinstance(document.data, dict) and isinstance(document.data.get("seed"), dict)


def _read_seed(document: Document) -> SealedSeed:
    return validate_document(_WithSealedSeed, document.only("seed")).seed


def _commitment(secret: str, salt: str) -> str:
    return hashlib.sha256(bytes.fromhex(secret) + bytes.fromhex(salt)).hexdigest()


def _check_secret(seed: SealedSeed, secret: str, *, where: str) -> None:
    if not re.fullmatch(rf"[0-9a-f]{{{2 * _DIGITS}}}", secret):
        raise BadInput(f"{secret!r:.20} is not a secret", where=where, allowed="64 hexadecimal digits")
    if not hmac.compare_digest(_commitment(secret, seed.salt), seed.sealed):
        raise BadInput(
            f"the secret {secret:.8}… is not the sealed secret", where=where, allowed=f"the secret of {seed.sealed:.8}…"
        )


def _replace_seed(document: Document, seed: str) -> str:
    """Return the text of a recipe, including its comments, with another ``seed``."""
    lines = document.path.read_text(encoding="utf-8").splitlines(keepends=True)
    at = int(document.locate("seed").rpartition(":")[2]) - 1
    found = re.fullmatch(r"(seed:\s*)(\{[^{}]*\}|[^\s#]+)(\s*(?:#.*)?\n?)", lines[at])
    if found is None:
        raise BadInput("the seed is not on a line of its own", where=document.locate("seed"), allowed="seed: 7")
    lines[at] = f"{found[1]}{seed}{found[3]}"
    return "".join(lines)
