"""The registry, which finds plug-ins by name: light schedules, lens motions, focus measures, searches.

A plug-in is a frozen dataclass. It has its own file ``saf_gen/plugins/<plug-in kind>/<name>.py``, or a package offers
it under the entry point ``saf_gen.<plug-in kind>``, or it is named as ``package.module:NAME`` or ``file.py:NAME``. A
plain function or class is converted to a plug-in (:mod:`saf_gen.core.config.plain_plugins`). The fields of a plug-in
are the keys that a recipe or a method may set, without a trailing underscore: ``from_`` is the key ``from``.

Listing names imports nothing, so a plug-in that cannot be imported does not break the others. Names from files are
resolved under :func:`refuse_code`, so that only code that is registered, or that the command line names
too, is run.
"""

import hashlib
import pkgutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, get_args, get_type_hints

import numpy as np

from saf_gen.core.config.plain_plugins import wrap_plain_code
from saf_gen.core.user_code import named_user_code, user_code
from saf_gen.errors import BadInput, closest, some_of, unknown

PLUGIN_KINDS = {"lights": "light schedule", "motions": "lens motion", "measures": "focus measure", "searches": "search"}

WHERE_LISTED = {
    **dict.fromkeys(("lights", "motions"), "docs/recipe-keys.md lists all"),
    **dict.fromkeys(("measures", "searches"), "`saf-gen methods list` shows all"),
}
"""Where all names of a kind stand."""
FORM_SUFFIXES = ("_n", "_tfi")
"""Endings of the names of measures that say in which form a measure is used."""
_registered_here: dict[str, dict[str, type]] = {plugin_kind: {} for plugin_kind in PLUGIN_KINDS}  # by this process
_CODE_REFUSED_IN: ContextVar[str] = ContextVar("code refused in", default="")


@contextmanager
def refuse_code(where: str) -> Iterator[None]:
    """Refuse to load ``package.module:Class`` and ``file.py:Class`` while names come from the file ``where``.

    The file may be untrusted. Code that this process has loaded before, because its command line named it, is accepted.
    """
    token = _CODE_REFUSED_IN.set(where)
    try:
        yield
    finally:
        _CODE_REFUSED_IN.reset(token)


def allow_code(name: str) -> None:
    """Allow files to name ``package.module:Class``, ``file.py:Class`` or a folder, because the command line did."""
    _ALLOWED.update((name, _without_form(name)))


def check_code_allowed(name: str) -> None:
    """Raise BadInput if a file names code that the command line did not name."""
    if not {name, _without_form(name)} & _ALLOWED and (where := _CODE_REFUSED_IN.get()):
        raise BadInput(
            f"{where} names the code {name!r}",
            allowed="registered names in files; code is run only if the command line names it",
            hint="read the code; if you trust it, name it in a separate --method before the one with the file",
        )


def _without_form(name: str) -> str:
    while name.endswith(FORM_SUFFIXES):
        name = name[: name.rindex("_")]
    return name


_ALLOWED: set[str] = set()


@cache
def _builtin_names(plugin_kind: str) -> frozenset[str]:
    folder = Path(__file__).parents[2] / "plugins" / plugin_kind
    return frozenset(m.name for m in pkgutil.iter_modules([str(folder)]) if not m.name.startswith("_"))


@cache
def _entry_points(plugin_kind: str) -> dict[str, EntryPoint]:
    return {e.name: e for e in entry_points(group=f"saf_gen.{plugin_kind}")}


def names(plugin_kind: str) -> list[str]:
    """Return every registered name of a kind, sorted, without importing anything."""
    return sorted({*_builtin_names(plugin_kind), *_entry_points(plugin_kind), *_registered_here[plugin_kind]})


def entry_point_names(plugin_kind: str) -> frozenset[str]:
    """Return the names of the plug-ins of a kind that packages offer."""
    return frozenset(_entry_points(plugin_kind))


def is_builtin_name(plugin_kind: str, name: str) -> bool:
    """Return whether a plug-in of this name is part of saf_gen itself."""
    return name in _builtin_names(plugin_kind)


def add_plugin(plugin_kind: str, plain: object, *, name: str) -> None:
    """Register a function or class of this process under a name, replacing one that was added under it before.

    Raises BadInput if the name cannot be part of a method's name or already belongs to saf_gen or a package, or if
    ``plain`` cannot be a plug-in.
    """
    if not name.isidentifier():
        raise BadInput(f"a {PLUGIN_KINDS[plugin_kind]} cannot be called {name!r}", allowed="a Python identifier")
    if name in _builtin_names(plugin_kind) or name in _entry_points(plugin_kind):
        raise BadInput(f"there is a {PLUGIN_KINDS[plugin_kind]} {name!r} already", hint="choose another name")
    plugin = wrap_plain_code(plain, plugin_kind)
    if plugin is None:
        raise _no_plugin_error(f"{PLUGIN_KINDS[plugin_kind]} {name!r}")
    _registered_here[plugin_kind][name] = plugin


def plugin_class(plugin_kind: str, name: str) -> type:
    """Return the dataclass of the plug-in with this name.

    Raises BadInput if the name is unknown, or if the file or entry point does not hold a plug-in.
    """
    return _registered_here[plugin_kind].get(name) or _find_plugin_class(plugin_kind, name)


@cache
def _find_plugin_class(plugin_kind: str, name: str) -> type:
    if name in _builtin_names(plugin_kind):
        module = import_module(f"saf_gen.plugins.{plugin_kind}.{name}")
        classes = [v for v in vars(module).values() if isinstance(v, type) and v.__module__ == module.__name__]
        plugins = [cls for cls in classes if is_dataclass(cls)]
        if len(plugins) != 1:
            raise BadInput(
                f"{module.__name__} holds {len(plugins)} dataclasses",
                allowed="one plug-in per file, a frozen dataclass",
            )
        return plugins[0]
    if name in _entry_points(plugin_kind):
        source = _entry_points(plugin_kind)[name]
        what = f"{PLUGIN_KINDS[plugin_kind]} {name!r} of the entry point {source.value!r}"
        return _load_plugin(
            source.load, what, plugin_kind=plugin_kind, hint="repair or remove the package that offers it"
        )
    if ":" in name:
        check_code_allowed(name)
        path, _, member = name.rpartition(":")

        what = f"{PLUGIN_KINDS[plugin_kind]} {name!r}"
        allowed = "package.module:NAME that Python can import, or file.py:NAME, of a class or function"
        module = _load(
            lambda: _import_file(Path(path)) if path.endswith(".py") else import_module(path), what, allowed=allowed
        )
        if not hasattr(module, member):
            known = _names_in(module)
            problem = f"{Path(path).name} has no {member!r}"
            raise BadInput(problem, allowed=some_of(known, member), nearest=closest(member, known))
        plugin = _load_plugin(lambda: getattr(module, member), what, plugin_kind=plugin_kind)
        allow_code(name)
        return plugin
    raise unknown(PLUGIN_KINDS[plugin_kind], name, allowed=names(plugin_kind), hint=WHERE_LISTED[plugin_kind])


def _names_in(module: ModuleType) -> list[str]:
    """Return the names of the functions and classes that a module defines."""
    own = vars(module).items()
    return [name for name, value in own if getattr(value, "__module__", "") == module.__name__ and name[:1] != "_"]


def _load(load: Callable[[], Any], what: str, *, allowed: str = "", hint: str = "") -> Any:
    try:
        with user_code():
            return load()
    except Exception as error:  # the module is user code and may raise anything
        problem = f"{what} cannot be loaded: {type(error).__name__}: {error}"
        raise BadInput(problem, allowed=allowed, hint=hint) from error


def _load_plugin(load: Callable[[], Any], what: str, *, plugin_kind: str, hint: str = "") -> type:
    plugin = wrap_plain_code(_load(load, what, hint=hint), plugin_kind)
    if plugin is None:
        raise _no_plugin_error(what)
    return plugin


def _no_plugin_error(what: str) -> BadInput:
    return BadInput(f"{what} is not a plug-in", allowed="a function or a class; see docs/add-a-method.md")


def _import_file(path: Path) -> ModuleType:
    """Return the module in a file, under a name that no installed module has; raises whatever the file raises."""
    name = f"saf_gen_of_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up their module while it is executed
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def option_fields(plugin_kind: str, name: str) -> dict[str, str]:
    """Return the name of the dataclass field for each key that a plug-in takes."""
    return {f.name.rstrip("_"): f.name for f in fields(plugin_class(plugin_kind, name)) if f.init}


def build_plugin(plugin_kind: str, name: str, /, **options: Any) -> Any:
    """Return the plug-in ``name`` with these options.

    Raises BadInput for an unknown name or key, a missing key, or a value that the plug-in refuses.
    """
    cls, known = plugin_class(plugin_kind, name), option_fields(plugin_kind, name)
    for key in options:
        if key not in known:
            raise unknown(f"key of {PLUGIN_KINDS[plugin_kind]} {name!r}:", key, allowed=known)
    what, values = f"{PLUGIN_KINDS[plugin_kind]} {name!r}", {known[key]: value for key, value in options.items()}
    try:
        with user_code():
            built = cls(**values)
    except BadInput:
        raise
    except TypeError as error:  # a missing key, or a value of the wrong type
        _check_kinds(cls, values, what=what)
        raise BadInput(f"{what}: {error}", allowed=", ".join(known) or "no keys") from error
    except Exception as error:  # the plug-in is user code and may refuse a value with any exception
        written = ", ".join(f"{key}={value!r}" for key, value in options.items()) or "no options"
        raise BadInput(
            f"{what} with {written}: {type(error).__name__}: {error}", hint="give values that it accepts, or repair it"
        ) from error
    _check_kinds(cls, values, what=what)  # Python takes true for 1
    return built


def _check_kinds(cls: type, values: Mapping[str, Any], *, what: str) -> None:
    """Raise BadInput for text or a flag where a plug-in declares numbers, and for text where it declares a flag."""
    try:
        hints = get_type_hints(cls)
    except Exception:  # noqa: BLE001 annotations of user code may raise anything; then nothing is known
        return
    for name, value in values.items():
        kinds = _leaf_types(hints.get(name)) - {type(None), Ellipsis}
        is_flag = kinds == {bool}
        if not is_flag and (not kinds or not kinds <= {int, float}):
            continue
        wrong = str if is_flag else str | bool
        allowed = "true or false" if is_flag else "numbers" if isinstance(value, list | tuple) else "a number"
        for one in value if isinstance(value, list | tuple) else [value]:
            if isinstance(one, wrong):
                hint = "write it without quotes" if isinstance(one, str) else ""
                raise BadInput(f"{what}: {name.rstrip('_')} is {value!r}", allowed=allowed, hint=hint)


def _leaf_types(annotation: Any) -> set[Any]:
    inside = get_args(annotation)
    return set().union(*map(_leaf_types, inside)) if inside else {annotation}


def sample_function(
    plugin: object, method: Callable[[np.ndarray, float], Any], *, seconds: np.ndarray, duration_s: float
) -> np.ndarray:
    """Return the values of a method of a light schedule or a motion at these times, as float64 of the same shape.

    Raises BadInput if the method raises anything but SafGenError or MemoryError, or does not return one number per
    time.
    """
    with named_user_code(plugin):
        values = np.asarray(method(seconds, duration_s), dtype=np.float64)
    if values.shape != seconds.shape:
        problem = f"{plugin!r} returns an array of shape {values.shape} for {seconds.size} times"
        raise BadInput(problem, allowed="one number per time")
    return values
