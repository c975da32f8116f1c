"""The commands ``sensors list``, ``show``, ``check`` and ``compare``."""

import json
import math
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress, TaskID

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import err, out, progress_bars
from saf_gen.core.config.presets import is_preset_file
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.calibration.comparison import Figures, Report

Layout = Annotated[str, typer.Option(help="Layout of raw files: 416, dense or sps1000.")]
Rate = Annotated[float, typer.Option("--rate", help="Readouts per second of raw files, which do not record it.")]


def list_() -> None:
    """List the sensors: array, readout rate, and which of their numbers nobody has measured."""
    from saf_gen.calibration.sensor_files import nominal_keys, read_sensor_text
    from saf_gen.camera import get_sensor, sensor_names

    columns = TableColumn("sensor"), TableColumn("pixels"), TableColumn("readouts per second", folds=True)
    rows = []
    for name in sensor_names():
        sensor = get_sensor(name)
        nominal = ", ".join(nominal_keys(read_sensor_text(name))) or "nothing"
        rows.append((name, f"{sensor.columns}×{sensor.rows}", f"{sensor.readout_hz:,.0f}", nominal))
    print_table([*columns, TableColumn("assumed or derived", folds=True)], rows)


def show(name: Annotated[str, typer.Argument(help="Name of a sensor, or its YAML file.")]) -> None:
    """Print the file of a sensor, with the source of each number beside it; a copy is a sensor of your own."""
    from saf_gen.calibration.sensor_files import read_sensor_text

    out.file.write(read_sensor_text(name))


def check(file: Annotated[Path, typer.Argument(help="Sensor file (.yaml).")]) -> None:
    """Check a sensor file: keys, units and ranges, and one line for each number that is unlikely or has no effect."""
    from saf_gen.calibration.sensor_files import find_implausible
    from saf_gen.camera import get_sensor

    sensor = get_sensor(file if is_preset_file(file) else str(file))
    found = list(find_implausible(sensor))
    for line in found:
        out.print(f"unlikely: {line}", style="yellow", soft_wrap=True)
    out.print(f"{sensor.name} is a sensor" + (f", with {len(found)} unlikely numbers" if found else ""))


def compare(
    names: Annotated[
        list[str] | None, typer.Argument(help="Two of: name of a sensor, sensor file, stream (.h5), raw frames.")
    ] = None,
    *,
    published: Annotated[
        str | None, typer.Option(help="Compare this sensor with what is published of real cameras.")
    ] = None,
    mean_rate: Annotated[float, typer.Option(help="Mean rate of light fields that sensors are given.")] = 0.2,
    layout: Layout = "416",
    rate: Rate = 20_000.0,
    seed: Annotated[int, typer.Option(help="Decides the devices and their noise.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show statistics side by side: rates, intervals, counts, fixed pattern, dark.

    Two sensors are given the same even light, the dark, and bars of light that move. Beside a recording a sensor is
    given the light that the recording shows, smoothed.
    """
    from saf_gen.calibration.comparison import compare_statistics, figures_as_published, published_figures

    given = names or []
    if len(given) != (0 if published is not None else 2):
        raise BadInput(
            f"{len(given)} {'name is' if len(given) == 1 else 'names are'} given",
            allowed="two to compare, or none with --published SENSOR",
        )
    with progress_bars() as bars:
        if published is not None:
            from saf_gen.camera import get_sensor

            real, sources = published_figures()
            ours = figures_as_published(get_sensor(published), seed=seed, report=_reporter(bars, published))
            columns, heads = [real, ours], ["published", Path(published).stem]
        else:
            columns = _columns(given, bars, mean_rate=mean_rate, layout=layout, rate=rate, seed=seed)
            heads, sources = [Path(name).name for name in given], {}
    rows = compare_statistics(columns)
    if as_json:
        named = dict(zip(("a", "b"), heads, strict=True))
        values = [
            {"key": row.key, "statistic": row.label, **{k: _finite(v) for k, v in zip("ab", row.values, strict=True)}}
            for row in rows
        ]
        document = {**named, "sources": sources, "statistics": values}
        out.file.write(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
        return
    print_table(
        [TableColumn("statistic", folds=True), *(TableColumn(head, justify="right") for head in heads)],
        [(row.label, *(row.format_value(value) for value in row.values)) for row in rows],
    )
    for part, source in sources.items():
        out.print(f"published, {part}: {source}", soft_wrap=True)


def _columns(
    names: list[str], bars: Progress, *, mean_rate: float, layout: str, rate: float, seed: int
) -> list["Figures"]:
    """Return the statistics of two things, each a sensor or a recording."""
    from saf_gen.calibration.comparison import encode_again, recording_figures, sensor_figures
    from saf_gen.calibration.recordings import open_recording
    from saf_gen.camera import get_sensor, sensor_names

    sensors = {name: get_sensor(name) for name in names if is_preset_file(name) or name in sensor_names()}
    for name in names:
        if name not in sensors and not Path(name).suffix:
            get_sensor(name)  # no file is meant: the error names the sensors there are
    if len(sensors) == len(set(names)):
        return [
            sensor_figures(sensors[name], rate=mean_rate, seed=seed, report=_reporter(bars, name)) for name in names
        ]
    with ExitStack() as stack:
        recordings = {
            name: stack.enter_context(open_recording(name, layout=layout, readout_hz=rate))
            for name in names
            if name not in sensors
        }
        shown = next(iter(recordings.values()))
        return [
            recording_figures(
                recordings[name] if name in recordings else encode_again(shown, sensors[name], seed=seed),
                report=_reporter(bars, name),
            )
            for name in names
        ]


def _reporter(bars: Progress, name: str) -> "Report":
    """Return a function that moves one bar for each recording that is measured."""
    tasks: dict[str, TaskID] = {}

    def report(what: str, done: float) -> None:
        if what not in tasks:
            tasks[what] = bars.add_task(f"{Path(name).name}: {what}", total=1.0)
            if not err.is_terminal:
                err.print(f"{Path(name).name}: {what}")
        bars.update(tasks[what], completed=done)

    return report


def _finite(value: float) -> float | None:
    """Return a value for JSON, which has no word for what is no number."""
    return value if math.isfinite(value) else None
