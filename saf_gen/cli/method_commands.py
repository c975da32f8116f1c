"""Commands on methods: ``methods`` lists what there is, ``show`` tells one in full, ``check`` tries it."""

import json
import sys
from collections import Counter
from contextlib import redirect_stdout
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from saf_gen.cli._terminal import err, out
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.benchmark.conformance import CheckResult

__all__ = ["check", "list_", "show"]

COST = "additions, multiplications and roots a pixel, for 400 x 250 pixels where it grows with them"
STYLES = {"pass": "green", "warn": "yellow", "fail": "bold red"}


def list_(context: typer.Context) -> None:
    """List focus measures and searches, show one in full, or check a method."""
    if context.invoked_subcommand is not None:
        return
    from saf_gen.cli._plugin_page import (
        build_or_class,
        first_paragraph,
        format_attribute,
        measure_suffixes,
        search_kind,
    )
    from saf_gen.core.config import registry

    for plugin_kind, columns in (("measures", ("degree", "cost", "twins")), ("searches", ("kind",))):
        table = Table(title=plugin_kind)
        for column in ("name", *columns):
            table.add_column(column, no_wrap=True)
        table.add_column("what it is")
        for name in registry.names(plugin_kind):
            try:
                part = build_or_class(plugin_kind, name)
            except BadInput as problem:  # one that cannot be loaded hides no other
                unknown = [""] * (len(columns) - 1)
                table.add_row(Text(name), "?", *unknown, Text(str(problem), "bold red"))
                continue
            if plugin_kind == "measures":
                twins = " ".join(twin for twin in measure_suffixes(part) if twin != "_n_tfi")
                said = [format_attribute(part, "degree"), format_attribute(part, "cost"), twins]
            else:
                said = [search_kind(part)]
            table.add_row(Text(name), *map(Text, said), Text(first_paragraph(part)))
        out.print(table)
    out.print(f"Cost: {COST}. Show one in full: saf-gen methods show NAME.")
    out.print(
        "A method is MEASURE+SEARCH, such as sd_code+sgfs_code:dt=50; check one: saf-gen methods check NAME."
    )
    out.print(
        "NAME_n divides a measure by brightness. "
        "NAME_tfi looks at intervals between spikes in place of counts."
    )


def show(
    name: Annotated[
        str, typer.Argument(help="A measure or a search, twins and options too, or MEASURE+SEARCH.")
    ],
) -> None:
    """Show a measure or a search in full: formula, options, range, degree, cost, source."""
    from saf_gen.benchmark.conformance.name_resolution import resolve_name
    from saf_gen.benchmark.method_spec import Method, split_region
    from saf_gen.cli._plugin_page import build_plugin_page

    found = resolve_name(name)
    if isinstance(found, Method):
        names, parts = split_region(found.name)[0].split("+"), (found.measure, found.search)
        halves = list(zip(names, ("measures", "searches"), parts, strict=True))
    else:
        halves = [("".join(name.split()), *found)]
    for half in halves:
        out.print(build_plugin_page(*half))


def check(
    name: Annotated[
        str, typer.Argument(help="MEASURE+SEARCH, or one of the two alone; @FILE of tuned constants.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Findings as JSON.")] = False,
) -> None:
    """Check a method: it ends, keeps to travel and budget, gives the same again, and crashes on nothing."""
    from saf_gen.benchmark.conformance import check_named as run

    found = []
    findings = run(name)
    with err.status(Text(f"check {name}")) as status, redirect_stdout(sys.stderr):  # a part may print
        for finding in findings:
            found.append(finding)
            status.update(Text(f"check {name}: {finding.part}, {finding.check}"))
    if as_json:
        lines = [{"name": name, **asdict(finding)} for finding in found]
        out.file.write(json.dumps(lines, indent=1, ensure_ascii=False) + "\n")
    else:
        _show(name, found)
    if any(finding.level == "fail" for finding in found):
        raise typer.Exit(1)


def _show(name: str, found: "list[CheckResult]") -> None:
    table = Table("part", "check", "", "what was seen", "what to do", title=Text(name))
    for finding in found:
        level = Text(finding.level, STYLES[finding.level])
        table.add_row(finding.part, finding.check, level, Text(finding.seen), Text(finding.to_do))
    out.print(table)
    levels: Counter[str] = Counter(finding.level for finding in found)
    out.print(f"{len(found)} checks: " + ", ".join(f"{levels[level]} {level}" for level in STYLES))
