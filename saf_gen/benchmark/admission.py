"""Admission of methods to an evaluation: what is part of saf_gen runs in the evaluator, everything else as a guest."""

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from saf_gen.benchmark.guests.guest import GuestMeasure, GuestSpec, guest_of
from saf_gen.benchmark.guests.host import GuestPart, Limits
from saf_gen.benchmark.method_folder import folder_name
from saf_gen.benchmark.method_spec import (
    BASELINES,
    Half,
    Method,
    MethodFolder,
    of_method,
    parse_method,
    parse_options,
    read_folder,
    split_method,
    split_region,
    tidy,
    tuned_method,
)
from saf_gen.benchmark.search_run import run_search
from saf_gen.benchmark.view.operations import UNDECLARED, DeclaredCost, declared_cost
from saf_gen.benchmark.view.restricted_view import MeteredScorer
from saf_gen.core.config.document import read_text
from saf_gen.core.config.registry import allow_code, check_code_allowed, entry_point_names, refuse_code
from saf_gen.errors import BadInput
from saf_gen.parts import Answer
from saf_gen.plugins.measures import get_measure

MAX_LIST_BYTES = 1 << 22
KINDS = ("measures", "searches")


def admit_method(spec: str, limits: Limits | None = None) -> Method:
    """Return the method with the given name; if anything in it is not part of saf_gen, it is a guest with these limits.

    The name is as for :func:`parse_method`. The code of others is not loaded into this process.

    Raises BadInput as :func:`parse_method` does.
    """
    if spec.startswith("@"):
        return tuned_method(spec, lambda name: admit_method(name, limits))
    name, region = split_region(spec)
    if text := folder_name(name):
        held = read_folder(Path(text))
        codes = [f"{Path(text).resolve()}/"]
        guest_spec = _folder_spec(text, held)
        title = f"{held.card.name}: "
    else:
        halves, text, region = split_method(spec)
        parsed = [parse_options(half, spec) for half in halves]
        if not any(map(is_foreign, parsed, KINDS)):
            return parse_method(spec)
        codes = [code for half in parsed for code in codes_of(half)]
        guest_spec, title = _guest_spec(text, parsed), ""
    for code_name in codes:
        check_code_allowed(code_name)
    try:
        guest = guest_of(guest_spec, limits or Limits())
    except BadInput as error:
        raise of_method(error, spec) from None
    for code_name in codes:
        allow_code(code_name)
    parameters = title + guest.parameters
    code = hashlib.sha256(json.dumps([parameters, guest.files]).encode()).hexdigest()[:12]
    measure, _, search = parameters.partition(" + ")
    parts: tuple[Any, Any] = (
        GuestPart(measure, intervals=guest.measure.get("intervals", False)),
        GuestPart(search, commands=guest.commands, polarities=guest.polarities, measures=guest.measures),
    )
    return Method(f"{text}@{region}" if region else text, *parts, code=code, region=region, guest=guest)


def admit_measure(name: str) -> Callable[..., float]:
    """Return the focus measure with the given name; if it is not part of saf_gen, it scores windows as a guest.

    Raises BadInput if it is unknown or refuses its options, or if the name belongs to no measure.
    """
    half = parse_options(tidy(name), name)
    if not is_foreign(half, "measures"):
        return get_measure(name)
    check_code_allowed(half[0])
    return GuestMeasure(name, guest_of(_guest_spec(f"{name}+argmax", [half, ("argmax", {})]), Limits()))


def read_methods(path: Path, limits: Limits | None = None) -> list[str]:
    """Return the names in a list of methods.

    A list cannot cause other code to be loaded: it may name only plug-ins that are registered or already loaded.

    Parameters
    ----------
    path : Path
        Text file with one method per line. Empty lines and comments are ignored; a comment starts with ``#`` at the
        beginning of a line, or with ``#`` between two spaces.
    limits : Limits, optional
        What methods that are not part of saf_gen may use.

    Returns
    -------
    list of str
        Names of methods, all of which can be parsed, or ``baselines``.

    Raises
    ------
    BadInput
        If the list cannot be read or is empty, or if a name cannot be parsed; the error then gives the line.
    """
    try:
        text = read_text(path, max_bytes=MAX_LIST_BYTES, encoding="utf-8-sig")
    except BadInput as error:
        problem = f"this is not a list of methods: {error.problem}"
        raise BadInput(problem, allowed="a text file, one method per line", nearest=error.nearest) from error
    names = []
    for number, line in enumerate(text.splitlines(), 1):
        if name := "" if line.startswith("#") else line.partition(" # ")[0].strip():
            try:
                with refuse_code(str(path)):
                    names += [name] if name == BASELINES or admit_method(name, limits) else []
            except BadInput as error:
                raise BadInput(str(error), where=f"{path}:{number}") from error
    if not names:
        raise BadInput(f"{path} names no method", allowed="one method per line, such as sd+argmax")
    return names


def run_method(method: Method, view: Any, *, scorer: MeteredScorer, stream_path: str = "") -> tuple[Answer, str]:
    """Return the answer of a method and '', or an empty answer and why it failed, wherever it runs.

    See :func:`saf_gen.benchmark.search_run.run_search`, also for what it raises.
    """
    scorer.cost = cost_of(method)
    if method.guest is not None:
        return method.guest.run(view, scorer=scorer, stream_path=stream_path)
    return run_search(method.search, view, scorer=scorer, stream_path=stream_path)


def cost_of(method: Method) -> DeclaredCost:
    """Return the operations that a method declares, wherever it runs."""
    return declared_cost(method.measure, method.search) if method.guest is None else method.guest.cost


def describe_undeclared(methods: Iterable[Method]) -> list[str]:
    """Return a line for each method that declares no cost, with what it is charged instead."""
    of_measure = f"{UNDECLARED.measure:g} operations per pixel that it scores"
    of_search = f"{UNDECLARED.window:g} per window for its search, {UNDECLARED.look:g} per pixel that it looks at"
    lines = []
    for method in methods:
        cost = cost_of(method)
        charged = [text for text, known in ((of_measure, cost.measure), (of_search, cost.window)) if known is None]
        if charged:
            lines.append(f"{method.name} declares no cost of its own: charged {' and '.join(charged)}")
    return lines


def is_foreign(half: Half, kind: str) -> bool:
    """Return whether a plug-in is code of others, or reads a file of others."""
    name, options = half
    return bool(codes_of(half)) or name in entry_point_names(kind) or any(map(_is_file, options.values()))


def codes_of(half: Half) -> list[str]:
    """Return the names of code of others in a measure or search: its own, and those of measures in its options."""
    return [one for one in (half[0], *half[1].values()) if isinstance(one, str) and ":" in one and not _is_file(one)]


def _is_file(value: object) -> bool:
    return isinstance(value, str) and Path(value).is_file()


def _folder_spec(text: str, held: MethodFolder) -> GuestSpec:
    """Return the method in a folder; results show its files relative to the folder."""
    folder = Path(text).resolve()
    shown = {str(file): file.relative_to(folder).as_posix() for file in held.files}
    return GuestSpec(text, *held.halves, tuple(shown), (str(folder),), tuple(shown.items()))


def _guest_spec(text: str, parsed: Sequence[Half]) -> GuestSpec:
    (measure, search), shown, folders = make_absolute_halves(parsed)
    return GuestSpec(text, measure, search, tuple(files_of(shown)), tuple(folders), tuple(shown.items()))


def files_of(shown: Iterable[str]) -> list[str]:
    """Return the files that absolute paths in the names of plug-ins name, each itself or before a colon."""
    return [absolute if _is_file(absolute) else absolute.rpartition(":")[0] for absolute in shown]


def make_absolute_halves(parsed: Sequence[Half]) -> tuple[list[Half], dict[str, str], list[str]]:
    """Return plug-ins with absolute paths, because a guest has a working folder of its own.

    Also returned are these paths with the spelling of the user, and the folders of modules that they may import.
    """
    shown: dict[str, str] = {}
    folders: dict[str, None] = {}

    def make_absolute(value: Any) -> Any:
        path, _, member = value.rpartition(":") if isinstance(value, str) else ("", "", "")
        if _is_file(value):
            absolute = str(Path(value).resolve())
        elif path.endswith(".py"):
            absolute = f"{Path(path).resolve()}:{member}"
            folders[str(Path(path).resolve().parent)] = None
        else:
            if path:
                folders[str(Path.cwd())] = None  # a module may be in the working folder
            return value
        shown[absolute] = value
        return absolute

    halves = [
        (make_absolute(name), {key: make_absolute(value) for key, value in options.items()}) for name, options in parsed
    ]
    return halves, shown, list(folders)
