"""Packages that an installation may lack: those of the extras in pyproject.toml, imported only where they are used."""

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from saf_gen.errors import BadInput

RENDERER = ("mitsuba", "drjit")
RESULT_PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "h5py", "isal", "OpenEXR")
"""Packages whose versions may change results, and which every stream therefore names."""


def require_extra(extra: str, *packages: str, of: str) -> None:
    """Check that the packages of an extra are installed, without importing them.

    ``of`` says what needs them, such as "rendering". Raises BadInput with the installation that brings them.
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
    """Return what results may depend on: the version of Python and of each of RESULT_PACKAGES, and of saf_gen.

    ``saf_gen`` is 12 digits of a sha256 over its source: two checkouts may have one version, and other code.
    """
    package = Path(__file__).resolve().parent.parent
    sha = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        sha.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    python = ".".join(platform.python_version_tuple()[:2])
    versions = {name: installed_version(name) for name in RESULT_PACKAGES}
    return {"saf_gen": sha.hexdigest()[:12], "python": python, **versions}
