"""Checks and descriptions of methods, measures and searches by name; code of others runs in a process of its own."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

from saf_gen.benchmark import conformance
from saf_gen.benchmark.admission import KINDS, admit_method, codes_of, files_of, is_foreign, make_absolute_halves
from saf_gen.benchmark.guests.host import GuestLost, GuestProcess, Limits
from saf_gen.benchmark.method_folder import folder_name
from saf_gen.benchmark.method_spec import (
    Half,
    Method,
    parse_options,
    read_folder,
    split_halves,
    split_method,
    split_region,
    tidy,
)
from saf_gen.benchmark.plugin_description import PluginDescription, describe_plugin, take_description
from saf_gen.benchmark.records import OVER_A_LIMIT
from saf_gen.benchmark.search_run import to_one_line
from saf_gen.core.config.registry import check_code_allowed
from saf_gen.core.finding import Finding
from saf_gen.errors import BadInput

CHECK_LIMITS = Limits(run_s=60.0)
"""Limits of a process that checks plug-ins; each check ends after 30 s, unless it does not run Python."""
PROGRAM = "saf_gen.benchmark.check_process:serve"
BRIEF_S = 10.0
"""Time that an evaluation spends on the checks of a measure or search."""


def check_by_name(name: str, on_output: Callable[[str], object] = lambda text: None) -> Iterator[Finding]:
    """Run the checks of a method, or of a single measure or search, and yield their results, wherever it runs.

    The name is as for :func:`saf_gen.benchmark.conformance.check_by_name`. Code of others is checked in a process of
    its own, whose end is an error of the check during which it ended; ``on_output`` is called with what it prints.

    Raises BadInput, when it is called, if there is nothing of this name.
    """
    halves = list(_halves_of(name).values())
    return (
        _findings(halves, limits=CHECK_LIMITS, on_output=on_output)
        if _are_foreign(halves)
        else conformance.check_by_name(name)
    )


def describe_by_name(name: str) -> list[PluginDescription]:
    """Return the descriptions of a measure, of a search, or of those of a method, wherever they run.

    Raises BadInput if there is nothing of this name, or if its process ends.
    """
    texts, halves = zip(*_halves_of(name).items(), strict=True)
    if not _are_foreign(halves):
        parts = conformance.find_parts(halves)
        return [describe_plugin(text, kind, plug_in=parts[kind]) for text, kind in zip(texts, parts, strict=True)]
    try:
        guest, hello, shown = _start_checks(halves, limits=CHECK_LIMITS)
    except GuestLost as lost:
        raise BadInput(to_one_line(f"{name!r} cannot be loaded: {lost}"), hint="repair it") from lost
    guest.close()
    said = [_spelled(one, shown) for one in hello.get("plugins", [])]
    kinds = KINDS if len(halves) == 2 else [kind for kind in KINDS if any(one["plugin_kind"] == kind for one in said)]
    return [take_description(text, kind, said=said) for text, kind in zip(texts, kinds, strict=True)]


def _spelled(said: Any, shown: Mapping[str, str]) -> Any:
    """Return what a process says, with the user's spelling in place of absolute paths."""
    if isinstance(said, dict):
        return {key: _spelled(value, shown) for key, value in said.items()}
    if isinstance(said, list):
        return [_spelled(value, shown) for value in said]
    if isinstance(said, str):
        for absolute, spelling in shown.items():
            said = said.replace(absolute, spelling)
    return said


def first_failed_check(method: Method) -> str:
    """Return the first check that a part of a method that is not part of saf_gen fails, or ''.

    A whole method is checked only by ``saf-gen methods check``, because that takes seconds. Checks that would end after
    BRIEF_S are left out.
    """
    for half, kind in zip(_halves_of(method.name).values(), KINDS, strict=True):
        if is_foreign(half, kind):
            key = repr((half, kind, method.code))
            if key not in _FAILED:
                _FAILED[key] = _first_failed(_findings([half], kind, limits=Limits(run_s=BRIEF_S)))
            if _FAILED[key]:
                return _FAILED[key]
    return ""


_FAILED: dict[str, str] = {}


def _first_failed(findings: Generator[Finding]) -> str:
    began = perf_counter()
    with closing(findings):
        for finding in findings:
            if finding.level == "error":
                return "" if OVER_A_LIMIT in finding.text else f"{finding.part}, {finding.check}"
            if perf_counter() - began > BRIEF_S:
                break
    return ""


def _halves_of(name: str) -> dict[str, Half]:
    """Return the measure and the search of a method, or the only half of a name, by their texts."""
    if name.startswith("@"):
        name = admit_method(name).name
    text = split_region(name)[0]
    if folder := folder_name(text):
        held = read_folder(Path(folder))
        return dict(zip((held.card.measure, held.card.search), held.halves, strict=True))
    is_method = len(split_halves(text)) > 1
    return {half: parse_options(half, name) for half in (split_method(name)[0] if is_method else [tidy(name)])}


def _are_foreign(halves: Sequence[Half]) -> bool:
    return any(is_foreign(half, kind) for half in halves for kind in KINDS)


def _start_checks(
    halves: Sequence[Half], kind: str = "", *, limits: Limits, on_output: Callable[[str], object] = lambda text: None
) -> tuple[GuestProcess, dict[str, Any], dict[str, str]]:
    """Return a process that checks these plug-ins, how it describes them, and their paths as the user spells them."""
    for half in halves:
        for code in codes_of(half):
            check_code_allowed(code)
    loaded, shown, folders = make_absolute_halves(halves)
    order = {"halves": loaded, "kind": kind}
    process = GuestProcess(order, folders, files=files_of(shown), limits=limits, program=PROGRAM, on_output=on_output)
    try:
        return process, process.load(), shown
    except BaseException:
        process.close()
        raise


def _findings(
    halves: Sequence[Half], kind: str = "", *, limits: Limits, on_output: Callable[[str], object] = lambda text: None
) -> Generator[Finding]:
    """Yield the results of the checks of plug-ins, which run in a process of their own; BadInput comes at once."""
    try:
        process, _, shown = _start_checks(halves, kind, limits=limits, on_output=on_output)
    except GuestLost as lost:
        found = _end_of_process(f"while it was loaded, {lost}")
        return (one for one in [found])
    return _findings_of(process, shown)


def _findings_of(process: GuestProcess, shown: Mapping[str, str]) -> Generator[Finding]:
    try:
        for finding in process.check():
            yield replace(finding, text=_spelled(finding.text, shown))
    except GuestLost as lost:
        yield _end_of_process(f"{lost}; the remaining checks were skipped")
    finally:
        process.close()


def _end_of_process(why: str) -> Finding:
    return Finding(
        "process", "error", to_one_line(why), "it must neither end nor hold the process that it runs in", "method"
    )
