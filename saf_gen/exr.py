"""OpenEXR in and out: named planes of float32 with text attributes. The one door to OpenEXR."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR

from saf_gen.errors import BadInput

__all__ = ["read_planes", "write_planes"]


def write_planes(path: Path, planes: Mapping[str, np.ndarray], attributes: Mapping[str, str]) -> None:
    """Write planes (row, col), all of one shape, as float32 channels of one scan-line image.

    Not compressed: ZIP takes 1 % off the float noise of a render, and nine times as long.
    """
    header: dict[str, object] = {
        "compression": OpenEXR.NO_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        **attributes,
    }
    channels = {name: np.ascontiguousarray(plane, dtype=np.float32) for name, plane in planes.items()}
    OpenEXR.File(header, channels).write(str(path))


def read_planes(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Read back what :func:`write_planes` wrote: planes by name, text attributes by name.

    Raises BadInput for a file that is missing, cut short or no EXR.
    """
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            planes = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
            attributes = {k: v for k, v in file.header().items() if isinstance(v, str)}
    except (RuntimeError, OSError, ValueError) as error:
        raise BadInput(
            f"{path} is no whole OpenEXR file: {error}", hint="delete it, generate again"
        ) from error
    return planes, attributes
