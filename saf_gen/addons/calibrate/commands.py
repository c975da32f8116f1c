"""The commands ``sensors compare`` and ``sensors fit``."""

import re
import shlex
from contextlib import ExitStack
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress, TaskID

from saf_gen.cli._tables import finite_value, print_json, print_table
from saf_gen.cli._terminal import AsJson, OutFolder, err, out, progress_bars
from saf_gen.cli.command import NOTHING_WRITTEN, Command, Panel
from saf_gen.core.config.presets import is_preset_file
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.addons.calibrate.comparison import Figures, Report
    from saf_gen.addons.calibrate.estimates import Estimate
    from saf_gen.addons.calibrate.recordings import Recording

Layout = Annotated[str | None, typer.Option(help="Layout of raw files, which do not state it: 416, dense or sps1000.")]
Rate = Annotated[float, typer.Option("--rate", help="Readouts per second of raw files, which do not contain it.")]


def compare_command(
    names: Annotated[
        list[str] | None, typer.Argument(help="Two of: name of a sensor, sensor file, stream (.h5), raw frames.")
    ] = None,
    *,
    published: Annotated[
        str | None, typer.Option(help="Compare this sensor with published figures of real cameras.")
    ] = None,
    mean_rate: Annotated[float, typer.Option(help="Mean rate of two compared sensors, spikes per readout.")] = 0.2,
    layout: Layout = None,
    rate: Rate = 20_000.0,
    seed: Annotated[int, typer.Option(help="Seed of the devices and their noise.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Compare statistics of sensors and recordings: rates, intervals, counts, fixed pattern and dark rate.

    Two sensors get the same even light, no light, and moving bars of light. A sensor that is compared with a recording
    gets the light that the recording shows, smoothed.
    """
    from saf_gen.addons.calibrate.comparison import as_published, compare_statistics, published_statistics

    compared = names or []
    if len(compared) != (0 if published is not None else 2):
        raise BadInput(
            f"{len(compared)} {'name is' if len(compared) == 1 else 'names are'} given",
            allowed="two names to compare, or --published SENSOR without names",
        )
    with progress_bars() as bars:
        if published is not None:
            from saf_gen.camera import get_sensor

            real, sources = published_statistics()
            modelled = as_published(get_sensor(published), seed=seed, report=_reporter(bars, published))
            columns, heads = [real, modelled], ["published", Path(published).stem]
        else:
            columns = _compared_statistics(compared, bars, mean_rate=mean_rate, layout=layout, rate=rate, seed=seed)
            heads, sources = [Path(name).name for name in compared], {}
    rows = compare_statistics(columns)
    if as_json:
        named = dict(zip(("a", "b"), heads, strict=True))
        values = [
            {
                "key": row.key,
                "statistic": row.label,
                **{k: finite_value(v) for k, v in zip("ab", row.values, strict=True)},
            }
            for row in rows
        ]
        document = {**named, "sources": sources, "statistics": values}
        print_json(document)
        return
    first, second = heads
    print_table(
        Table(
            [
                Column("statistic", "label", folds=True),
                Column(first, lambda row: row.format_value(row.values[0]), kind="number"),
                Column(second, lambda row: row.format_value(row.values[1]), kind="number"),
            ],
            rows,
        )
    )
    for part, source in sources.items():
        out.print(f"published, {part}: {source}", soft_wrap=True)


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
    layout: Layout = None,
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


def _print_bounds(recording: "Recording", report: "Report") -> None:
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


def _compared_statistics(
    names: list[str], bars: Progress, *, mean_rate: float, layout: str | None, rate: float, seed: int
) -> list["Figures"]:
    """Return the statistics of each sensor or recording in ``names``, in that order."""
    from saf_gen.addons.calibrate.comparison import encode_again, recording_statistics, sensor_statistics
    from saf_gen.addons.calibrate.recordings import open_recording
    from saf_gen.camera import get_sensor, sensor_names

    sensors = {name: get_sensor(name) for name in names if is_preset_file(name) or name in sensor_names()}
    for name in names:
        if name not in sensors and not Path(name).suffix:
            get_sensor(name)  # not the name of a file, so the error lists the known sensors
    if len(sensors) == len(set(names)):
        return [
            sensor_statistics(sensors[name], rate=mean_rate, seed=seed, report=_reporter(bars, name)) for name in names
        ]
    with ExitStack() as stack:
        recordings = {
            name: stack.enter_context(open_recording(name, layout=layout, readout_hz=rate))
            for name in names
            if name not in sensors
        }
        shown = next(iter(recordings.values()))
        return [
            recording_statistics(
                recordings[name] if name in recordings else encode_again(shown, sensors[name], seed=seed),
                report=_reporter(bars, name),
            )
            for name in names
        ]


def _reporter(bars: Progress, name: str) -> "Report":
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
    "sensors compare": Command(
        compare_command,
        examples=("sensors compare recording.h5 vidar_400x250", "sensors compare --published vidar_400x250"),
        panel=Panel.SCENES,
    ),
    "sensors fit": Command(
        fit_command,
        examples=("sensors fit dim.h5 bright.h5 --dark dark.h5 --name my_camera",),
        panel=Panel.SCENES,
        stopped=NOTHING_WRITTEN,
    ),
}
