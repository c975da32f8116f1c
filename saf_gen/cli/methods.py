"""Commands on methods: ``methods`` lists what there is, ``methods check`` tries somebody's."""

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
    from saf_gen.conformance import Finding

__all__ = ["check", "list_"]

STYLES = {"pass": "green", "warn": "yellow", "fail": "bold red"}


def list_(context: typer.Context) -> None:
    """List focus measures and searches, or check a method."""
    if context.invoked_subcommand is not None:
        return
    from saf_gen import registry

    for room, kind in (("measures", "degree"), ("searches", "kind")):
        table = Table(title=room)
        table.add_column("name", no_wrap=True)
        table.add_column(kind, no_wrap=True)
        table.add_column("what it is")
        for name in registry.names(room):
            try:
                part = registry.part_class(room, name)
            except BadInput as problem:  # one that cannot be loaded hides no other
                table.add_row(Text(name), "?", Text(str(problem), "bold red"))
                continue
            said = _degree(part) if room == "measures" else _kind(part)
            table.add_row(Text(name), said, Text(" ".join((part.__doc__ or "").split("\n\n")[0].split())))
        out.print(table)
    out.print(
        "A method is MEASURE+SEARCH, such as sd_code+sgfs_code:dt=50; check one: saf-gen methods check NAME."
    )
    out.print(
        "NAME_n divides a measure by brightness. "
        "NAME_tfi looks at intervals between spikes in place of counts."
    )


def check(
    name: Annotated[
        str, typer.Argument(help="MEASURE+SEARCH, or one of the two alone; @FILE of tuned constants.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Findings as JSON.")] = False,
) -> None:
    """Check a method: it ends, keeps to travel and budget, gives the same again, and crashes on nothing."""
    from saf_gen.conformance import check as run

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


def _show(name: str, found: "list[Finding]") -> None:
    table = Table("part", "check", "", "what was seen", "what to do", title=Text(name))
    for finding in found:
        level = Text(finding.level, STYLES[finding.level])
        table.add_row(finding.part, finding.check, level, Text(finding.seen), Text(finding.to_do))
    out.print(table)
    levels: Counter[str] = Counter(finding.level for finding in found)
    out.print(f"{len(found)} checks: " + ", ".join(f"{levels[level]} {level}" for level in STYLES))


def _degree(part: type) -> str:
    degree = getattr(part, "degree", None)
    return str(degree) if isinstance(degree, int) else "by its options"


def _kind(part: type) -> str:
    """What kind of search a class says it is."""
    if getattr(part, "commands", False):
        return "commands"
    causal = getattr(part, "causal", None)
    return f"estimates{', causal' if causal is True else ''}"
