"""The command ``sensors fit``."""

import re
import shlex
from collections.abc import Callable
from contextlib import ExitStack
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress, TaskID

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import OutFolder, err, out, progress_bars
from saf_gen.cli.addons import NOTHING_WRITTEN, Command
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.addons.calibrate.estimates import Estimate
    from saf_gen.addons.calibrate.recordings import Recording

Report = Callable[[str, float], None]
Layout = Annotated[str, typer.Option(help="Layout of raw files: 416, dense, sps1000, or auto.")]
Rate = Annotated[float, typer.Option("--rate", help="Readouts per second of raw files, which do not contain it.")]


def fit_command(
    flats: Annotated[
        list[Path], typer.Argument(help="Flat fields at two or more levels: streams (.h5) or raw frames.")
    ],
    *,
    dark: Annotated[Path | None, typer.Option(help="Recording without light.")] = None,
    name: Annotated[str, typer.Option(help="Name of the fitted sensor, and of its files.")] = "fitted",
    threshold_e: Annotated[
        float | None, typer.Option(help="Electrons per spike, if known; separates threshold noise from shot noise.")
    ] = None,
    base: Annotated[str, typer.Option(help="Sensor with the values that flat fields do not give.")] = "vidar_400x250",
    folder: OutFolder = None,
    layout: Layout = "auto",
    rate: Rate = 20_000.0,
) -> None:
    """Fit a sensor to flat fields and a dark recording; write its file with intervals, plots, and a mask of bad pixels.

    A single recording of any scene, without --dark, gives bounds and no file.
    """
    from saf_gen.addons.calibrate.fit_files import FITTED, fitted_files, write_fit
    from saf_gen.addons.calibrate.fit_sensor import fit_sensor
    from saf_gen.addons.calibrate.fit_summary import summarise_fit
    from saf_gen.addons.calibrate.recordings import open_recording
    from saf_gen.camera import get_sensor
    from saf_gen.core.files import check_ours, check_writable, read_start, refuse_link

    base_sensor, target = get_sensor(base), folder or Path()
    refuse_link(target)
    check_writable(target)
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]*", name):
        raise BadInput(f"--name is {name!r}", allowed="letters, digits, _, . and -: it names files")
    if threshold_e is not None and not threshold_e >= 25:
        raise BadInput(f"--threshold-e is {threshold_e:g}", allowed="at least 25 electrons")
    if dark is None and len(flats) > 1:
        raise BadInput(
            f"{len(flats)} flat fields and no dark recording are given",
            allowed="--dark FILE",
            hint="record with the lens covered; one recording alone gives bounds",
        )
    if dark is not None and FITTED not in read_start(target / f"{name}.yaml"):
        for file in fitted_files(name):
            check_ours(target / file, FITTED)
    with ExitStack() as stack, progress_bars() as bars:
        opened = [stack.enter_context(open_recording(f, layout=layout, readout_hz=rate)) for f in flats]
        if dark is None:
            _print_bounds(opened[0], _reporter(bars, "fit"))
            return
        dark_recording = stack.enter_context(open_recording(dark, layout=layout, readout_hz=rate))
        found = fit_sensor(
            list(opened),
            dark_recording,
            base=base_sensor,
            name=name,
            threshold_e=threshold_e,
            report=_reporter(bars, "fit"),
        )
        written = write_fit(found, target)
    for line in summarise_fit(found, base=base_sensor):
        out.print(line, soft_wrap=True)
    _print_estimates(found.estimates, f"sensor {name}")
    for note in found.notes:
        out.print(f"note: {note}", soft_wrap=True)
    for path in written:
        out.print(str(path), soft_wrap=True)
    check = f"saf-gen sensors check {shlex.quote(str(written[0]))}"
    out.print(f"next: {check}; sensor: {written[0].name} in a recipe of the same folder", soft_wrap=True)


def _print_bounds(recording: "Recording", report: Report) -> None:
    """Print the bounds that a single recording of any scene gives."""
    from saf_gen.addons.calibrate.bounds import noise_bounds
    from saf_gen.addons.calibrate.spike_statistics import measure_spikes

    measured = measure_spikes(recording, report=lambda done: report(recording.name, done))
    _print_estimates(noise_bounds(measured, where=recording.name), f"bounds from {recording.name}")
    out.print(
        "note: without a dark recording and flat fields of two levels, only bounds are known, and no file is written"
    )


def _print_estimates(estimates: "dict[str, Estimate]", title: str) -> None:
    """Print numbers with their intervals as a table."""
    from saf_gen.addons.calibrate.fit_files import fitted_interval, fitted_number

    def number(item: "tuple[str, Estimate]") -> str | None:
        found = item[1]
        return fitted_number(found.value, found.high - found.low) if found.measured else None

    columns = [
        Column("key", itemgetter(0)),
        Column("value", number, kind="number"),
        Column("95 %", lambda item: fitted_interval(item[1])),
        Column("from", lambda item: item[1].how, folds=True, detail=1),
    ]
    print_table(Table(columns, list(estimates.items()), title))


def _reporter(bars: Progress, name: str) -> Report:
    """Return a function that updates a bar for each recording that is measured."""
    tasks: dict[str, TaskID] = {}

    def report(what: str, done: float) -> None:
        if what not in tasks:
            tasks[what] = bars.add_task(f"{Path(name).name}: {what}", total=1.0)
            if not err.is_terminal:
                err.print(f"{Path(name).name}: {what}")
        bars.update(tasks[what], completed=done)

    return report


COMMANDS = {
    "sensors fit": Command(
        fit_command, examples=("sensors fit dim.h5 bright.h5 --dark dark.h5 --name my_camera",), stopped=NOTHING_WRITTEN
    )
}
