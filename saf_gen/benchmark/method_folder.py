"""Methods in folders of their own: a card names the measure, the search and the files.

::

    # my_method/method.yaml
    name: my_net
    measure: model.py:Net:weights=weights.npz
    search: search.py:Walk
    files: [calibration.json]

The measure and the search are written as on the command line, with paths relative to the folder.
"""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from saf_gen.core.config.document import FrozenModel, validate_document
from saf_gen.core.config.registry import names
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import BadInput

CARD = "method.yaml"
HINT = "docs/add-a-method.md shows a card"
DEFAULT_MEASURE = "sd"


class MethodCard(FrozenModel):
    """The card of a method in a folder."""

    name: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[\w .-]+$")]
    """Name of the method for readers: letters, digits, blanks, _ . -, at most 80; tables name the folder."""
    search: Annotated[str, Field(min_length=1)]
    """Search, ``file.py:Name`` or a registered name, with its options."""
    measure: Annotated[str, Field(min_length=1)] = DEFAULT_MEASURE
    """Focus measure, ``file.py:Name`` or a registered name, with its options; a search that looks at counts needs
    none."""
    files: tuple[str, ...] = ()
    """Weights and data files that the method reads; its digest covers them, whenever they are read."""
    description: str = ""
    """What the method does."""
    paper: str = ""
    """Paper or address."""


def folder_name(text: str) -> str:
    """Return the name of a method in a folder, its path with one slash at the end; '' if the text names no folder.

    A path that ends in a slash does; another one does if there is a card, and nothing is registered under it.
    """
    text = text.strip()
    if ends_as_folder(text):
        return text.rstrip("/") + "/" if text.strip("/") else text
    if not text or text in {*names("measures"), *names("searches")} or not (Path(text) / CARD).is_file():
        return ""
    return text.rstrip("/") + "/"


def ends_as_folder(name: str) -> bool:
    """Return whether a name is that of a method in a folder, on whatever machine; an option may end in a slash, too."""
    return name.endswith("/") and ":" not in name


def read_card(folder: Path) -> MethodCard:
    """Return the card of a method in a folder.

    Raises BadInput, with the line, if the folder has no card, if the card is not valid, or if a file that it lists is
    missing or outside the folder.
    """
    if not folder.is_dir():
        problem = "is a file" if folder.exists() else "does not exist"
        raise BadInput(f"{folder} {problem}", allowed=f"a folder with a {CARD}", hint=HINT)
    if not (folder / CARD).is_file():
        raise BadInput(f"there is no {CARD} in {folder}", allowed="a folder with a card is one method", hint=HINT)
    document = read_yaml(folder / CARD)
    card = validate_document(MethodCard, document, hint=HINT)
    for number, name in enumerate(card.files):
        file_in(folder, name, where=document.locate("files", number))
    return card


def file_in(folder: Path, name: str, *, where: str) -> Path:
    """Return the absolute path of a file that a card names; raise BadInput if it is missing or outside the folder."""
    file = (folder / name).resolve()
    if not file.is_relative_to(folder.resolve()):
        raise BadInput(f"{name!r} is outside {folder}", where=where, hint="copy it into the folder")
    if not file.is_file():
        names = ", ".join(sorted(path.name for path in folder.iterdir() if path.is_file())[:9])
        problem = "is a folder" if file.is_dir() else f"is not in {folder}"
        raise BadInput(f"{name!r} {problem}", where=where, allowed=f"its files: {names}")
    return file
