"""Devices described in YAML files: those that come with saf_gen have a name, those of users a path."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

from pydantic import BeforeValidator, PlainValidator

from saf_gen.core.config.document import Document, validate_document
from saf_gen.core.config.ranges import is_number
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import unknown

Device = TypeVar("Device")


def checked(
    fits: Callable[[Any], bool], allowed: str, *, convert: Callable[[Any], Any] = lambda value: value
) -> Callable[[Any], Any]:
    """Return a pydantic validator that converts a value if ``fits`` accepts it, and else raises ValueError."""

    def check(value: Any) -> Any:
        if not fits(value):
            raise ValueError(allowed + ("; write it without quotes" if _is_quoted_number(value) else ""))
        return convert(value)

    return check


def _is_quoted_number(value: Any) -> bool:
    try:
        return isinstance(value, str) and isfinite(float(value))
    except ValueError:
        return False


def between(low: float, high: float, *, unit: str, integer: bool = False) -> PlainValidator:
    """Return a pydantic validator of numbers from ``low`` to ``high``, inclusive; ``integer`` allows only integers."""
    kind = "a whole number " if integer else ""
    return PlainValidator(
        checked(
            lambda n: is_number(n) and (not integer or isinstance(n, int)) and low <= n <= high,
            f"{kind}{low:g} to {high:g} {unit}",
        )
    )


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip())


Text = Annotated[str, PlainValidator(checked(_is_text, "a text"))]
Switch = Annotated[bool, PlainValidator(checked(lambda value: isinstance(value, bool), "true or false"))]
Sources = Annotated[
    tuple[str, ...],
    BeforeValidator(
        checked(
            lambda value: isinstance(value, list | tuple) and bool(value) and all(map(_is_text, value)),
            "a list of at least one text",
        )
    ),
]
"""Sources of the numbers of a device."""


def change_fields(device: Device, changes: Mapping[str, Any], *, where: str) -> Device:
    """Return a copy of a device with some fields changed.

    In a field that has fields itself, a mapping changes only the fields that it names. Raises BadInput, with
    ``where``, for an unknown field or a value that is not allowed.
    """
    data: dict[str, Any] = asdict(device)  # type: ignore[call-overload]
    for key, value in changes.items():
        inside = isinstance(data.get(key), dict) and isinstance(value, Mapping)
        data[key] = {**data[key], **value} if inside else value
    return validate_document(type(device), Document(data, Path(where), find_lines=dict))


def is_preset_file(name: str | Path) -> bool:
    """Return whether ``name`` is the path of a device file rather than the name of a device."""
    return Path(name).suffix in (".yaml", ".yml")


class Presets(Generic[Device]):
    """The devices of one kind in a folder of YAML files, one file per device.

    Parameters
    ----------
    kind : str
        Name of the kind in messages, such as "sensor".
    parse : callable
        Function that returns the device in a document, a frozen dataclass.
    folder : Path
        Folder of the YAML files.
    """

    def __init__(self, kind: str, parse: Callable[[Document], Device], *, folder: Path) -> None:
        self.kind, self.parse, self.folder = kind, parse, folder

    def names(self) -> list[str]:
        """Return the names of the devices that come with saf_gen, sorted."""
        return sorted(path.stem for path in self.folder.glob("*.yaml"))

    def get(self, name: str | Path, changes: Mapping[str, Any]) -> Device:
        """Return the device ``name``, or the device in a user's file, with some fields changed.

        Raises BadInput for an unknown name or field, a file that cannot be read, or a value that is not allowed.
        """
        if is_preset_file(name):
            path = Path(name)
        elif str(name) in (names := self.names()):
            path = self.folder / f"{name}.yaml"
        else:
            raise unknown(self.kind, name, allowed=names, hint="or give the path of a .yaml file")
        device = self.parse(read_yaml(path))
        return change_fields(device, changes, where=f"{self.kind} {name}") if changes else device
