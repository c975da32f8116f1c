"""Devices described in YAML files: those that come with saf_gen, by name, and users' own, by path."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
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
    """Return a check for pydantic: the value, converted, if it ``fits``, else an error that says what is allowed."""

    def check(value: Any) -> Any:
        if not fits(value):
            slip = "; YAML reads 1e-5 as text: write 1.0e-5" if _is_exponent(value) else ""
            raise ValueError(allowed + slip)
        return convert(value)

    return check


def _is_exponent(value: Any) -> bool:
    try:
        return isinstance(value, str) and "e" in value.lower() and bool(float(value))
    except ValueError:
        return False


def between(least: float, most: float, *, unit: str, whole: bool = False) -> PlainValidator:
    """Return the check of a number from ``least`` to ``most``, both allowed; ``whole`` admits only whole numbers."""
    kind = "a whole number " if whole else ""
    return PlainValidator(
        checked(
            lambda n: is_number(n) and (not whole or isinstance(n, int)) and least <= n <= most,
            f"{kind}{least:g} to {most:g} {unit}",
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
"""Where the numbers of a device come from."""


def change_preset_fields(device: Device, changes: Mapping[str, Any], *, where: str) -> Device:
    """Return a copy of a device with some fields changed, and with some fields of a field that is a mapping.

    Raises BadInput, with ``where``, for an unknown field and for a value that is not allowed.
    """
    data: dict[str, Any] = asdict(device)  # type: ignore[call-overload]
    for key, value in changes.items():
        inside = isinstance(data.get(key), dict) and isinstance(value, Mapping)
        data[key] = {**data[key], **value} if inside else value
    return validate_document(type(device), Document(data, Path(where), find_lines=dict))


def is_preset_file(name: str | Path) -> bool:
    """Return whether this is the path of a device's file rather than a device's name."""
    return Path(name).suffix in (".yaml", ".yml")


class Presets(Generic[Device]):
    """The devices of one kind in a folder of YAML files, one file per device.

    ``kind`` is what messages call the devices, such as "sensor"; ``model`` is their frozen dataclass.
    """

    def __init__(self, kind: str, model: type[Device], *, folder: Path) -> None:
        self.kind, self.model, self.folder = kind, model, folder

    def names(self) -> list[str]:
        """Return the names of the devices that come with saf_gen, sorted."""
        return sorted(path.stem for path in self.folder.glob("*.yaml"))

    def get(self, name: str | Path, changes: Mapping[str, Any]) -> Device:
        """Return the device ``name``, or the one in a user's file, with some fields changed.

        Raises BadInput for an unknown name or field, and for a value that is not allowed.
        """
        if is_preset_file(name):
            path = Path(name)
        elif str(name) in (names := self.names()):
            path = self.folder / f"{name}.yaml"
        else:
            raise unknown(self.kind, name, allowed=names, hint="or give the path of a .yaml file")
        device = validate_document(self.model, read_yaml(path))
        return change_preset_fields(device, changes, where=f"{self.kind} {name}") if changes else device
