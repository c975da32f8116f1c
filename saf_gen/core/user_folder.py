"""The folders of saf_gen for this user, and a secret that distinguishes this user's files from those of others."""

import hmac
import os
import secrets
from contextlib import suppress
from pathlib import Path

from saf_gen.core.files import atomic_file
from saf_gen.errors import BadInput

_SECRET_BYTES = 32


def user_folder() -> Path | None:
    """Return the folder ``saf_gen`` in ``$XDG_CONFIG_HOME`` or ``~/.config``, which need not exist.

    Returns None for a user without a home folder, such as the arbitrary user of a container.
    """
    return _folder_in("XDG_CONFIG_HOME", "~/.config")


def cache_folder() -> Path | None:
    """Return the folder ``saf_gen`` in ``$XDG_CACHE_HOME`` or ``~/.cache``, created if it is missing.

    Returns None if this user has none, or cannot write to it, such as the arbitrary user of a container.
    """
    folder = _folder_in("XDG_CACHE_HOME", "~/.cache")
    if folder is None:
        return None
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder if folder.is_dir() and os.access(folder, os.W_OK) else None


def _folder_in(variable: str, default: str) -> Path | None:
    configured = os.environ.get(variable, "")
    base = Path(configured if Path(configured).is_absolute() else os.path.expanduser(default))  # noqa: PTH111
    return base / "saf_gen" if base.is_absolute() else None


def sign_as_user(data: bytes) -> bytes | None:
    """Return a signature of the data that only this user can make: 32 bytes, HMAC-SHA-256.

    Returns None if the user's secret can be neither read nor created.
    """
    secret = _secret()
    return None if secret is None else hmac.digest(secret, data, "sha256")


def is_signed(data: bytes, signature: bytes) -> bool:
    """Return whether ``signature`` is this user's signature of the data."""
    expected = sign_as_user(data)
    return expected is not None and hmac.compare_digest(expected, signature)


def _secret() -> bytes | None:
    """Return the user's secret, created if it is missing; None if it can be neither read nor created."""
    folder = user_folder()
    if folder is None:
        return None
    path = folder / "secret"
    try:
        if not path.is_file() or path.stat().st_size != _SECRET_BYTES:
            with atomic_file(path) as part:
                part.touch(mode=0o600)
                part.write_bytes(secrets.token_bytes(_SECRET_BYTES))
        return path.read_bytes()
    except (OSError, BadInput):
        return None
