"""Packages that an installation may lack: those of the extras in pyproject.toml, imported only where they are used."""

from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from saf_gen.errors import BadInput

RENDERER = ("mitsuba", "drjit")


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
