"""Folders of scenes that the user trusts, because a scene may be a script, which runs with the user's rights.

A folder is trusted if ``saf-gen scenes list --trust`` has registered it for this user, or if ``SAF_GEN_SCENES`` names
it. Being in the working directory does not make a ``scenes/`` folder trusted: it may have come in an archive from
somebody else.
"""

import os
from pathlib import Path

from saf_gen.core.files import write_text
from saf_gen.core.user_folder import user_folder
from saf_gen.errors import BadInput

SCENES_VARIABLE = "SAF_GEN_SCENES"
"""Environment variable that lists folders of scenes, separated as in ``PATH``."""


def registration_file() -> Path | None:
    """Return the path of the user's list of registered folders, or None if the user has no home folder.

    The file need not exist.
    """
    folder = user_folder()
    return None if folder is None else folder / "scene_folders.txt"


def registered_folders() -> list[Path]:
    """Return the folders of scenes that :func:`register_folder` has added.

    Raises BadInput if the list exists and cannot be read.
    """
    file = registration_file()
    try:
        lines = file.read_text(encoding="utf-8").splitlines() if file else []
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(
            f"{file} cannot be read: {error}",
            hint="remove it, and trust the folders again: saf-gen scenes list --trust FOLDER",
        ) from error
    return [Path(line) for line in lines if Path(line).is_absolute()]


def register_folder(folder: Path) -> bool:
    """Trust the scenes of a folder from now on, and return False if it was already registered.

    Raises BadInput if the path has a line break, the list cannot be read or written, or the user has no home folder.
    """
    folder, known = folder.resolve(), registered_folders()
    if len(str(folder).splitlines()) != 1:
        raise BadInput(f"the folder {str(folder)!r} has a line break in its path", hint="rename it")
    if folder not in known:
        _write([*known, folder])
    return folder not in known


def forget_folder(folder: Path) -> bool:
    """Stop trusting the scenes of a folder, and return False if it was not registered.

    Raises BadInput if the list cannot be read or written, or the user has no home folder.
    """
    folder, known = folder.resolve(), registered_folders()
    if folder in known:
        _write([other for other in known if other != folder])
    return folder in known


def _write(folders: list[Path]) -> None:
    file = registration_file()
    if file is None:
        raise BadInput("the user has no home folder for the list", hint=f"set HOME, or {SCENES_VARIABLE}=FOLDER/scenes")
    write_text(file, "".join(f"{folder}\n" for folder in folders))


def all_trusted() -> list[Path]:
    """Return the folders that ``SAF_GEN_SCENES`` names, followed by all registered folders."""
    return [*_named_folders(), *registered_folders()]


def folders_in_use() -> list[Path]:
    """Return the folders that ``SAF_GEN_SCENES`` names, and ``scenes/`` of the working directory if it is registered.

    Other registered folders are not searched for names of scenes.
    """
    local = Path("scenes").resolve()
    return [*_named_folders(), *(folder for folder in registered_folders() if folder == local)]


def _named_folders() -> list[Path]:
    return [Path(name) for name in os.environ.get(SCENES_VARIABLE, "").split(os.pathsep) if name]
