"""The commands ``methods list``, ``methods show`` and ``methods check``."""

import sys
from collections import Counter
from contextlib import redirect_stdout
from operator import itemgetter
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table as Grid
from rich.text import Text

from saf_gen.cli._tables import print_json, print_table, to_objects
from saf_gen.cli._terminal import LEVEL_STYLES, AsJson, err, out
from saf_gen.cli.command import Command, Panel
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.core.finding import Finding

COST_MEANING = "additions, multiplications and roots per pixel, for 400 x 250 pixels if it depends on their number"
WORDS = {"ok": "pass", "warning": "warn", "error": "fail"}
"""Word for each level of a finding about a method."""


def list_methods_command(*, as_json: AsJson = False) -> None:
    """List focus measures, with their degree and cost, and searches."""
    from saf_gen.benchmark.plugin_description import (
        build_or_class,
        format_attribute,
        measure_suffixes,
        search_kind,
        summarise_plugin,
    )
    from saf_gen.core.config import registry

    listed = {}
    for plugin_kind, heads in (("measures", ("degree", "cost", "forms")), ("searches", ("kind",))):
        rows: list[tuple[str, ...]] = []
        for name in registry.names(plugin_kind):
            try:
                plug_in = build_or_class(plugin_kind, name)
            except BadInput as problem:  # a plug-in that cannot be loaded does not hide the others
                rows.append((name, "?", *([""] * (len(heads) - 1)), str(problem)))
                continue
            if plugin_kind == "measures":
                forms = " ".join(form for form in measure_suffixes(plug_in) if form != "_n_tfi")
                cells = [*(format_attribute(plug_in, key) for key in ("degree", "cost")), forms]
            else:
                cells = [search_kind(plug_in)]
            rows.append((name, *cells, summarise_plugin(plug_in).replace("``", "")))
        columns = [Column(head, itemgetter(n)) for n, head in enumerate(("name", *heads))]
        columns.append(Column("what it is", itemgetter(-1), folds=True, style=lambda r: "bold red" * (r[1] == "?")))
        table = Table(columns, rows, plugin_kind)
        listed[plugin_kind] = to_objects(table)
        if not as_json:
            print_table(table)
    if as_json:
        print_json(listed)
        return
    out.print(f"Cost: {COST_MEANING}. Show one in full: saf-gen methods show NAME.")
    out.print("A method is MEASURE+SEARCH, such as sd_code+sgfs_code:dt=50; check one: saf-gen methods check NAME.")
    out.print("NAME_n divides a measure by brightness. NAME_tfi scores the intervals between spikes instead of counts.")


def show_method_command(
    name: Annotated[str, typer.Argument(help="Measure, search or MEASURE+SEARCH, with its form and options.")],
) -> None:
    """Show a measure or a search in full: formula, options, range, degree, cost and source."""
    from saf_gen.benchmark.checking import describe_by_name

    for page in describe_by_name(name):
        table = Grid(title=Text(page.name, "bold"), title_justify="left", show_header=False, box=None, pad_edge=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column()
        for key, text in page.facts:
            table.add_row(key, Text(text))
        out.print(table)


def check_method_command(
    name: Annotated[
        str, typer.Argument(help="MEASURE+SEARCH, a measure, a search, a folder, or @FILE of a tuned method.")
    ],
    as_json: AsJson = False,
) -> None:
    """Check that a method ends, stays within travel and budget, is reproducible, and never crashes."""
    from saf_gen.benchmark.checking import check_by_name as run

    results = []
    checks = run(name, on_output=lambda text: err.out(text, end=""))
    with err.status(Text(f"check {name}")) as status, redirect_stdout(sys.stderr):  # a plug-in may print
        for result in checks:
            results.append(result)
            status.update(Text(f"check {name}: {result.part}, {result.check}"))
    if as_json:
        print_json([_to_object(name, result) for result in results])
    else:
        _print_results(name, results)
    if any(result.level == "error" for result in results):
        raise typer.Exit(1)


def _print_results(name: str, results: "list[Finding]") -> None:
    columns = [
        Column("part", "part"),
        Column("check", "check", folds=True),
        Column("", lambda result: WORDS[result.level], style=lambda result: LEVEL_STYLES[result.level]),
        Column("what was seen", "text", folds=True),
        Column("what to do", "to_do", folds=True),
    ]
    print_table(Table(columns, results, name))
    levels: Counter[str] = Counter(result.level for result in results)
    out.print(
        f"{plural(len(results), 'check')}: " + ", ".join(f"{levels[level]} {word}" for level, word in WORDS.items())
    )


def _to_object(name: str, result: "Finding") -> dict[str, str]:
    seen = {"level": WORDS[result.level], "seen": result.text, "to_do": result.to_do}
    return {"name": name, "part": result.part, "check": result.check, **seen}


COMMANDS = {
    "methods list": Command(list_methods_command, ("methods list", "methods list --json"), Panel.EVALUATE),
    "methods show": Command(
        show_method_command, ("methods show sd", "methods show sd_code+sgfs_code:dt=50"), Panel.EVALUATE
    ),
    "methods check": Command(check_method_command, ("methods check sd+argmax",), Panel.EVALUATE),
}
"""The commands of this file, by the words that call them."""
