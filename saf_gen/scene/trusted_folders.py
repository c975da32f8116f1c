"""Folders of scenes that the user trusts: a scene may be a script, which runs with the user's rights.

The scenes of a folder count once ``saf-gen init`` has registered it for this user, or where ``SAF_GEN_SCENES`` names
it. A ``scenes/`` that merely lies in the working directory, as in an archive from somebody else, does not.
"""

import os
from pathlib import Path

from saf_gen.core.files import write_text_atomically
from saf_gen.core.user_folder import user_folder
from saf_gen.errors import BadInput

SCENES_VARIABLE = "SAF_GEN_SCENES"
"""Environment variable that names folders of scenes, separated as in ``PATH``."""


def scene_registration_file() -> Path | None:
    """Return the user's list of registered folders, which need not exist; None for a user without a home folder."""
    folder = user_folder()
    return None if folder is None else folder / "scene_folders.txt"


def registered_scene_folders() -> list[Path]:
    """Return the folders of scenes that :func:`register_scene_folder` has added.

    Raises BadInput where the list is there and cannot be read.
    """
    file = scene_registration_file()
    try:
        lines = file.read_text(encoding="utf-8").splitlines() if file else []
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{file} cannot be read: {error}", hint="remove it, and run saf-gen init again") from error
    return [Path(line) for line in lines if Path(line).is_absolute()]


def register_scene_folder(folder: Path) -> bool:
    """Trust the scenes of a folder from now on; return False where it was registered already.

    Raises BadInput for a path with a line break, and where the list cannot be written.
    """
    folder, known = folder.resolve(), registered_scene_folders()
    if len(str(folder).splitlines()) != 1:
        raise BadInput(f"the folder {str(folder)!r} has a line break in its path", hint="rename it")
    if folder not in known:
        _write([*known, folder])
    return folder not in known


def forget_scene_folder(folder: Path) -> bool:
    """Trust the scenes of a folder no longer; return False where it was not registered. Raises as registering does."""
    folder, known = folder.resolve(), registered_scene_folders()
    if folder in known:
        _write([one for one in known if one != folder])
    return folder in known


def _write(folders: list[Path]) -> None:
    file = scene_registration_file()
    if file is None:
        raise BadInput("there is no home folder to register in", hint=f"set HOME, or {SCENES_VARIABLE}=FOLDER/scenes")
    write_text_atomically(file, "".join(f"{folder}\n" for folder in folders))


def trusted_scene_folders() -> list[Path]:
    """Return the folders that ``SAF_GEN_SCENES`` names, then all that are registered."""
    return [*_named_folders(), *registered_scene_folders()]


def scene_folders_in_use() -> list[Path]:
    """Return the folders that ``SAF_GEN_SCENES`` names, then ``scenes/`` of the working directory if it is registered.

    Other registered folders have no part in what a name means here.
    """
    own = Path("scenes").resolve()
    return [*_named_folders(), *(one for one in registered_scene_folders() if one == own)]


def _named_folders() -> list[Path]:
    return [Path(one) for one in os.environ.get(SCENES_VARIABLE, "").split(os.pathsep) if one]
