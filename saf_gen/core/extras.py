"""Packages that an installation may lack: those of the extras in pyproject.toml, imported only when they are used."""

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from saf_gen.errors import BadInput

RENDERER = ("mitsuba", "drjit")
RESULT_PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "h5py", "isal", "OpenEXR")
"""Packages whose versions may change results; every stream therefore records them."""


def require_extra(extra: str, *packages: str, of: str) -> None:
    """Check that the packages of an extra are installed, without importing them.

    ``of`` says what needs them, such as "rendering". Raises BadInput, with the command that installs them, if one is
    missing.
    """
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        raise BadInput(
            f"{of} needs the package{'s' * (len(missing) > 1)} {' and '.join(missing)}",
            hint=f"pip install 'saf-gen[{extra}]'",
        )


def installed_version(package: str) -> str:
    """Return the version of a package, or "not installed"."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


@cache
def installed_versions() -> dict[str, str]:
    """Return the versions that results may depend on: those of Python, of RESULT_PACKAGES and of saf_gen.

    The version under the key ``saf_gen`` is the first 12 digits of the SHA-256 of its source, because two checkouts
    may have the same version number and different code.
    """
    package = Path(__file__).resolve().parent.parent
    sha = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        sha.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    python = ".".join(platform.python_version_tuple()[:2])
    versions = {name: installed_version(name) for name in RESULT_PACKAGES}
    return {"saf_gen": sha.hexdigest()[:12], "python": python, **versions}
