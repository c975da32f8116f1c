"""Reading a lens file of any known format: the content decides which it is, not the name."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from saf_gen.core.config.document import check_plain_file
from saf_gen.errors import BadInput
from saf_gen.optics.lens_file.glass import Glass, find_glass, read_agf
from saf_gen.optics.lens_file.json_files import read_deeplens, read_optiland
from saf_gen.optics.lens_file.prescription import Prescription, check_prescription
from saf_gen.optics.lens_file.zemax import read_zemax

MAX_LENS_BYTES, MAX_AGF_BYTES = 4 << 20, 16 << 20
READERS = {"surface_group": read_optiland, "surfaces": read_deeplens}
KINDS = "a sequential lens of Zemax (.zmx), a lens of optiland or of DeepLens (.json)"


def read_prescription(
    path: Path,
    *,
    glasses: Mapping[str, Glass] | None = None,
    f_number: float | None = None,
    height_mm: float | None = None,
) -> Prescription:
    """Return the lens in a file.

    Parameters
    ----------
    path : Path
        A .zmx file, or the JSON of optiland or DeepLens.
    glasses : mapping of str to Glass, optional
        Further glasses by their names in capitals, which come before those of the catalogue.
    f_number, height_mm : float, optional
        Aperture and largest image height (mm), in place of those of the file.

    Raises
    ------
    BadInput
        If the file is none of these, is larger than 4 MiB, or holds what rays cannot be traced through.
    """
    where, text = str(path), _read(path, MAX_LENS_BYTES)
    given: dict[str, Any] = {"where": where, "glasses": glasses or {}, "name": path.stem}
    if text.lstrip()[:1] == "{":
        data = _parse(text, where)
        reader = next((reader for key, reader in READERS.items() if key in data), None)
        if reader is None:
            raise BadInput(f"{where} is JSON without surfaces", allowed=KINDS)
        try:
            lens = reader(data, **given)
        except (AttributeError, TypeError, KeyError) as error:  # a list or a number where the format has a mapping
            raise BadInput(f"{where} is not laid out as a lens: {str(error)[:80]}", allowed=KINDS) from error
    elif any(line.split()[:1] == ["SURF"] for line in text.splitlines()):
        lens = read_zemax(text, **given)
    else:
        raise BadInput(f"{where} is no lens file", allowed=KINDS)
    if f_number is not None:
        lens = replace(lens, aperture=("f_number", f_number))
    elif lens.aperture[1] == 0:
        raise BadInput(
            f"{where} does not say how wide its aperture is",
            allowed="the diameter of the entrance pupil, the f-number of the picture, or the size of the stop",
            hint="give it: --f-number N",
        )
    if height_mm is not None:
        lens = replace(lens, field=("image", height_mm))
    elif lens.field[1] == 0:
        raise BadInput(
            f"{where} does not say how far its picture reaches",
            allowed="a field off the axis",
            hint="give it: --height-mm MM",
        )
    return check_prescription(lens, where=where)


def _read(path: Path, most: int) -> str:
    try:
        check_plain_file(path, max_bytes=most)
        content = path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror or error}") from error
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif content[:3] == b"\xef\xbb\xbf":
        encoding = "utf-8-sig"
    else:
        encoding = "utf-8"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError:
        return content.decode("latin-1")  # older files of Zemax: names and notes alone have such letters


def _parse(text: str, where: str) -> dict[str, object]:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{where} is damaged: {str(error)[:100]}", allowed=KINDS) from None
    return dict(data)


def read_glasses(stated: Sequence[str], catalogues: Sequence[Path]) -> dict[str, Glass]:
    """Return further glasses by their names in capitals: stated as NAME=INDEX/ABBE, and in catalogues (.agf)."""
    found: dict[str, Glass] = {}
    for path in catalogues:
        found |= read_agf(_read(path, MAX_AGF_BYTES), where=str(path))
    for one in stated:
        name, _, numbers = one.partition("=")
        if not (name.strip() and "/" in numbers):
            raise BadInput(f"--glass is {one!r}", allowed="NAME=INDEX/ABBE, such as --glass BAF7=1.608/46.2")
        glass = find_glass(numbers, {}, where=f"--glass {name}")
        found[name.strip().upper()] = replace(glass, name=name.strip())
    return found
