"""The commands ``sensors list``, ``show`` and ``check``."""

from pathlib import Path
from typing import Annotated, Any

import typer

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import AsJson, out
from saf_gen.cli.command import Command, Panel
from saf_gen.core.config.presets import is_preset_file
from saf_gen.core.table import Column, Table
from saf_gen.errors import escape_controls


def list_sensors_command(*, as_json: AsJson = False) -> None:
    """List sensors with their array, their readout rate, and the numbers that are not measured."""
    from saf_gen.camera.sensor_files import KINDS, nominal_keys, sensor_text

    def nominal(row: tuple[str, Any]) -> str:
        return ", ".join(nominal_keys(sensor_text(row[1].name))) or "nothing"

    columns = [
        Column("sensor", lambda row: row[1].name),
        Column("reads out", lambda row: row[0], folds=True),
        Column("pixels", lambda row: f"{row[1].columns}×{row[1].rows}"),
        Column("Hz", lambda row: getattr(row[1], "readout_hz", None), ",.0f", folds=True),
        Column("assumed or derived", nominal, folds=True),
    ]
    rows = [(kind, presets.get(name, {})) for kind, presets in KINDS.items() for name in presets.names()]
    print_table(Table(columns, rows), as_json=as_json)


def show_sensor_command(name: Annotated[str, typer.Argument(help="Name of a sensor, or its YAML file.")]) -> None:
    """Print the file of a sensor, with the source of each number; edit a copy to make your own sensor."""
    from saf_gen.camera.sensor_files import sensor_text

    out.file.write(escape_controls(sensor_text(name), keep="\n\t"))


def check_sensor_command(file: Annotated[Path, typer.Argument(help="Sensor file (.yaml).")]) -> None:
    """Check keys, units and ranges of a sensor file, and report each number that is unlikely or has no effect."""
    from saf_gen.camera import get_sensor
    from saf_gen.camera.sensor_files import implausible_keys

    sensor = get_sensor(file if is_preset_file(file) else str(file))
    found = list(implausible_keys(sensor))
    for line in found:
        out.print(f"unlikely: {line}", style="yellow", soft_wrap=True)
    out.print(f"{sensor.name} is a sensor" + (f", with {len(found)} unlikely numbers" if found else ""))


COMMANDS = {
    "sensors list": Command(list_sensors_command, ("sensors list",), Panel.SCENES),
    "sensors show": Command(show_sensor_command, ("sensors show vidar_400x250",), Panel.SCENES),
    "sensors check": Command(check_sensor_command, ("sensors check my_camera.yaml",), Panel.SCENES),
}
"""The commands of this file, by the words that call them."""
