"""The command ``plan``, which estimates the work of recipes before anything is made."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from saf_gen.cli._tables import TableColumn, print_json, print_table
from saf_gen.cli._terminal import AsJson, out
from saf_gen.cli.dataset_commands import parse_shard

if TYPE_CHECKING:
    from saf_gen.generate.work_plan import WorkPlan

ADDED = ("sequences", "stacks", "jobs", "render_s", "record_s", "seconds", "scheduler_s", "peak_bytes", "disk_bytes")


def plan_command(
    recipes: Annotated[list[str], typer.Argument(help="Recipes that come with saf_gen, by name, or recipe files.")],
    *,
    split: Annotated[str | None, typer.Option(help="Plan only this split.")] = None,
    shard: Annotated[str, typer.Option(help="I/N: plan every N-th sequence, starting with the I-th.")] = "1/1",
    workers: Annotated[
        int, typer.Option(min=1, max=256, help="Number of sequences that a machine records at the same time.")
    ] = 1,
    machines: Annotated[int, typer.Option(min=1, max=10_000, help="Number of machines of one scheduler.")] = 1,
    keep_slices: Annotated[
        str, typer.Option(help="Time slices of moving scenes to keep at the end: all, closed-loop or none.")
    ] = "all",
    rates: Annotated[
        Path | None, typer.Option(help="Output of `saf-gen bench rates --json` (default: two cores with LLVM).")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Estimate the jobs, hours and disk space that recipes take from the beginning, without making anything."""
    from saf_gen.generate.cost import MachineRates, read_rates_for_plan
    from saf_gen.generate.work_plan import plan_work

    known = read_rates_for_plan(rates) if rates else MachineRates()
    part = parse_shard(shard)
    plans = [
        plan_work(
            recipe, part=part, split=split, workers=workers, machines=machines, keep_slices=keep_slices, rates=known
        )
        for recipe in recipes
    ]
    total = {key: sum(getattr(one, key) for one in plans) for key in ADDED}
    if as_json:
        print_json(
            {"recipes": [asdict(one) for one in plans], "total": total, "rates": asdict(known), "machines": machines}
        )
        return
    rows = [_row(one.name, asdict(one)) for one in plans]
    print_table(
        [
            TableColumn("recipe"),
            *(TableColumn(name, justify="right") for name in ("sequences", "jobs", "time", "disk")),
            *(TableColumn(name, drop_order=1, justify="right") for name in ("stacks", "rendering", "recording")),
            *(TableColumn(name, drop_order=2, justify="right") for name in ("scheduler", "disk at most")),
        ],
        [*rows, *([_row("together", total)] if len(rows) > 1 else [])],
        where_to_find="--json prints them",
    )
    out.print(_describe(plans, workers=workers, machines=machines, is_measured=rates is not None))


def _row(name: str, values: "dict[str, float]") -> tuple[str, ...]:
    numbers = {key: values[key] for key in ADDED}
    return (
        name,
        *(f"{numbers[key]:,}" for key in ("sequences", "jobs")),
        _format_time(numbers["seconds"]),
        _format_bytes(numbers["disk_bytes"]),
        f"{numbers['stacks']:,}",
        *(_format_time(numbers[key]) for key in ("render_s", "record_s", "scheduler_s")),
        _format_bytes(numbers["peak_bytes"]),
    )


def _describe(plans: "list[WorkPlan]", *, workers: int, machines: int, is_measured: bool) -> str:
    machine = "of the rates given" if is_measured else "with two cores of 2.8 GHz and LLVM"
    who = "One machine" if machines == 1 else f"{machines} machines under one scheduler, each"
    text = f"{who} {machine}, recording {workers} at a time; rendering and recording are times on one machine."
    few = sum(one.sequences for one in plans if one.drawn < one.sequences)
    drawn = sum(one.drawn for one in plans if one.drawn < one.sequences)
    return text + (f" {drawn:,} sequences were planned one by one and represent {few:,}." if few else "")


def _format_time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:,.1f} h"


def _format_bytes(count: float) -> str:
    return f"{count / 1e9:.2f} GB" if count < 1e12 else f"{count / 1e12:,.2f} TB"
