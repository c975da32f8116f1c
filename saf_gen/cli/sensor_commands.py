"""The commands ``sensors list``, ``show`` and ``check``."""

from typing import Annotated, Any

import typer

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import AsJson, out
from saf_gen.cli.command import Command, Panel
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Column, Table
from saf_gen.errors import escape_controls


def list_sensors_command(*, as_json: AsJson = False) -> None:
    """List sensors with their array, their readout rate, and the numbers that are not measured."""
    from saf_gen.camera.kinds import kinds_of_cameras
    from saf_gen.camera.sensor_files import nominal_keys, read_sensor, sensor_names, sensor_text

    def nominal(sensor: Any) -> str:
        return ", ".join(nominal_keys(sensor_text(sensor.name))) or "nothing"

    columns = [
        Column("sensor", "name"),
        Column("kind", "kind", folds=True),
        Column("pixels", lambda sensor: f"{sensor.columns}×{sensor.rows}"),
        Column("Hz", lambda sensor: getattr(sensor, "readout_hz", None), ",.0f", folds=True),
        Column("assumed or derived", nominal, folds=True),
    ]
    sensors = [read_sensor(name) for kind in kinds_of_cameras() for name in sensor_names(kind)]
    print_table(Table(columns, sensors), as_json=as_json)


def show_sensor_command(name: Annotated[str, typer.Argument(help="Name of a sensor, or its YAML file.")]) -> None:
    """Print the file of a sensor, with the source of each number; edit a copy to make your own sensor."""
    from saf_gen.camera.sensor_files import sensor_text

    out.file.write(escape_controls(sensor_text(name), keep="\n\t"))


def check_sensor_command(name: Annotated[str, typer.Argument(metavar="FILE", help="Sensor file (.yaml).")]) -> None:
    """Check keys, units and ranges of a sensor file, and report each number that is unlikely or has no effect."""
    from saf_gen.camera.sensor_files import implausible_keys, read_sensor

    sensor = read_sensor(name)
    found = list(implausible_keys(sensor))
    for line in found:
        out.print(f"unlikely: {line}", style="yellow", soft_wrap=True)
    unlikely = f", with {plural(len(found), 'unlikely number')}" if found else ""
    line = f"{sensor.name} is a sensor of kind {sensor.kind}{unlikely}"
    out.print(escape_controls(line), markup=False, soft_wrap=True)


COMMANDS = {
    "sensors list": Command(list_sensors_command, ("sensors list",), Panel.SCENES),
    "sensors show": Command(show_sensor_command, ("sensors show vidar_400x250",), Panel.SCENES),
    "sensors check": Command(check_sensor_command, ("sensors check my_camera.yaml",), Panel.SCENES),
}
"""The commands of this file, by the words that call them."""
