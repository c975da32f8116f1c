"""Finds parts by name: light schedules, lens motions, focus measures, searches.

A part is a frozen dataclass in a file of its own, ``saf_gen/<room>/<name>.py``, or anybody's: offered
under the entry point ``saf_gen.<room>``, or named as ``package.module:Class`` or ``file.py:Class``. Its
fields are the keys that a recipe or a method may set (a trailing underscore is dropped: ``from_`` is
the key ``from``). Listing imports nothing, so a part with a missing dependency cannot break the others.
"""

import hashlib
import pkgutil
import sys
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from saf_gen.errors import BadInput, unknown

__all__ = ["PLUGIN_KINDS", "build", "names", "option_fields", "plugin_class"]

PLUGIN_KINDS = {
    "lights": "light schedule",
    "motions": "lens motion",
    "measures": "focus measure",
    "searches": "search",
}


@cache
def _own(plugin_kind: str) -> frozenset[str]:
    folder = Path(__file__).parents[2] / plugin_kind
    return frozenset(m.name for m in pkgutil.iter_modules([str(folder)]) if not m.name.startswith("_"))


@cache
def _offered(plugin_kind: str) -> dict[str, EntryPoint]:
    return {e.name: e for e in entry_points(group=f"saf_gen.{plugin_kind}")}


def names(plugin_kind: str) -> list[str]:
    """Every registered name of a room, sorted; nothing is imported."""
    return sorted(_own(plugin_kind) | set(_offered(plugin_kind)))


@cache
def plugin_class(plugin_kind: str, name: str) -> type:
    """The dataclass behind a name.

    Raises BadInput for an unknown name, and for a file or entry point that does not hold one dataclass.
    """
    if name in _own(plugin_kind):
        module = import_module(f"saf_gen.{plugin_kind}.{name}")
        found = [v for v in vars(module).values() if isinstance(v, type) and v.__module__ == module.__name__]
        parts = [c for c in found if is_dataclass(c)]
        if len(parts) != 1:
            raise BadInput(
                f"{module.__name__} holds {len(parts)} dataclasses",
                allowed="one part a file, a frozen dataclass",
            )
        return parts[0]
    if name in _offered(plugin_kind):
        offered = _offered(plugin_kind)[name]
        try:
            part = offered.load()
        except Exception as error:  # anybody's package may raise anything as it is imported
            raise BadInput(
                f"{PLUGIN_KINDS[plugin_kind]} {name!r} of the entry point {offered.value!r} "
                f"cannot be loaded: {type(error).__name__}: {error}",
                hint="mend or remove the package that offers it",
            ) from error
        if not (isinstance(part, type) and is_dataclass(part)):
            raise BadInput(f"the entry point {offered.value!r} is no part", allowed="a frozen dataclass")
        return part
    if ":" in name:
        return _named(plugin_kind, name)
    raise unknown(PLUGIN_KINDS[plugin_kind], name, allowed=names(plugin_kind))


def _named(plugin_kind: str, name: str) -> type:
    """The class that ``package.module:Class`` or ``file.py:Class`` names; its module is run."""
    place, _, cls = name.rpartition(":")
    where = f"{PLUGIN_KINDS[plugin_kind]} {name!r}"
    try:
        module = _from_file(Path(place)) if place.endswith(".py") else import_module(place)
        part = getattr(module, cls)
    except Exception as error:  # anybody's module may raise anything, and it is told in one line
        raise BadInput(
            f"{where} cannot be loaded: {type(error).__name__}: {error}",
            allowed="package.module:Class that Python finds, or file.py:Class",
        ) from error
    if not (isinstance(part, type) and is_dataclass(part)):
        raise BadInput(f"{where} is no part", allowed="a frozen dataclass; see docs/add-a-method.md")
    return part


def _from_file(path: Path) -> ModuleType:
    """The module of a file, by a name that no installed module has. Raises what the file raises."""
    name = f"saf_gen_of_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is no Python file")
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up while it is run
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def option_fields(plugin_kind: str, name: str) -> dict[str, str]:
    """The keys that a part takes, each with the dataclass field that holds it."""
    return {f.name.rstrip("_"): f.name for f in fields(plugin_class(plugin_kind, name)) if f.init}


def build(plugin_kind: str, name: str, /, **options: Any) -> Any:
    """The part ``name`` with these options.

    Raises BadInput for an unknown name or key, a missing key, or a value the part itself refuses.
    """
    cls, known = plugin_class(plugin_kind, name), option_fields(plugin_kind, name)
    for key in options:
        if key not in known:
            raise unknown(f"key of {PLUGIN_KINDS[plugin_kind]} {name!r}:", key, allowed=known)
    try:
        return cls(**{known[k]: v for k, v in options.items()})
    except BadInput:
        raise
    except TypeError as error:  # a missing key, or a value of the wrong type
        raise BadInput(
            f"{PLUGIN_KINDS[plugin_kind]} {name!r}: {error}", allowed=", ".join(known) or "no keys"
        ) from error
    except Exception as error:  # anybody's part may refuse a value as it likes
        given = ", ".join(f"{key}={value!r}" for key, value in options.items()) or "no options"
        raise BadInput(
            f"{PLUGIN_KINDS[plugin_kind]} {name!r} with {given}: {type(error).__name__}: {error}",
            hint="give values that it takes, or mend it",
        ) from error
