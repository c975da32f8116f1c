"""The kinds of cameras, by the folders of this package."""

from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from saf_gen.camera.camera import Camera
from saf_gen.core.config.document import validate_document
from saf_gen.core.config.yaml_document import parse_yaml

OURS = ("spikes", "photons", "frames", "events")


@cache
def kinds_of_cameras(form: str | None = None) -> tuple[str, ...]:
    """Return the kinds of cameras, which are what sensor files state as their ``kind``: ours first.

    ``form`` keeps those whose recordings have this form: ``bits``, ``events`` or ``frames``.
    """
    folders = sorted(path.parent.name for path in Path(__file__).parent.glob("*/__init__.py"))
    kinds = (*OURS, *(name for name in folders if name not in OURS))
    return kinds if form is None else tuple(kind for kind in kinds if camera_type(kind).form == form)


@cache
def camera_type(kind: str) -> type[Camera]:
    """Return the class of the cameras of a kind."""
    camera: type[Camera] = import_module(f"saf_gen.camera.{kind}").CAMERA
    return camera


def parse_sensor(text: str, where: str | Path, *, kind: str = "spikes") -> Any:
    """Return the sensor that a recording describes: the keys of a sensor file without its ``kind``.

    Parameters
    ----------
    text : str
        The YAML text.
    where : str or Path
        Name of the text in error messages.
    kind : str, default 'spikes'
        Kind of the sensor.

    Raises
    ------
    BadInput
        If the text does not describe a valid sensor.
    """
    return validate_document(camera_type(kind).sensor_type, parse_yaml(text, where))
