"""Scenes: folders with a card (``scene.yaml``) and a geometry (``scene.py`` or ``scene.xml``), or with pictures.

This module finds scenes, and reads and checks their cards; only :mod:`saf_gen.render` builds the geometry.
"""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from saf_gen.core import seeds
from saf_gen.core.config.document import Document, FrozenModel, validate_document
from saf_gen.core.config.ranges import check_parameter, draw_range, range_extremes
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.core.shipped import shipped_folder
from saf_gen.errors import BadInput, unknown
from saf_gen.optics import Drive
from saf_gen.optics.fitted_file import shipped_text
from saf_gen.optics.lens_card import LensCard, LensFile
from saf_gen.plugins.lights import check_groups, default_roles
from saf_gen.scene import trusted_folders
from saf_gen.scene.keyframes import RigidMotion, Vector
from saf_gen.scene.picture_card import PictureCard, PictureScene
from saf_gen.scene.section_card import SectionCard, check_section

CARD_FILE, SCRIPT_FILE = "scene.yaml", "scene.py"
KIT = "_kit"
"""Folder of the modules that the scripts of several scenes share, beside the scenes that come with saf_gen."""
LENS_PARAMETER = "lens"
"""Parameter that names the lens of a member, if the card has ``lenses``."""
KEYS_WITHOUT_PIXEL_EFFECT = frozenset(
    "title licence source kit illuminance_lux roles params slices_per_s interpolation_error still_s".split()  # noqa: SIM905
)
"""Keys of a card that the digest leaves out, because they change no pixel, because a stack records them separately
(``params`` and the time), or because their files are digested instead (``kit``)."""

EDGE_POWER = 1.5
"""Exponent with which the error of interpolation between two slices grows with the step between them, up to steps of
about a pixel. While an edge crosses a pixel, the light of the pixel changes steadily, so only pixels that the edge
enters or leaves within the step are wrong. Both their number and the error of each grow with the step."""


class CameraPose(FrozenModel):
    """The pose of the camera in world axes."""

    origin_m: Vector
    """Centre of the lens, m."""
    look_at_m: Vector
    """Another point on the optical axis, m."""
    up: Vector = (0.0, 1.0, 0.0)
    """Upward direction of the picture, not parallel to the optical axis."""

    @model_validator(mode="after")
    def _check_axis(self) -> "CameraPose":
        axis = [b - a for a, b in zip(self.origin_m, self.look_at_m, strict=True)]
        cross = (
            axis[1] * self.up[2] - axis[2] * self.up[1],
            axis[2] * self.up[0] - axis[0] * self.up[2],
            axis[0] * self.up[1] - axis[1] * self.up[0],
        )
        if math.hypot(*cross) < 1e-9:
            raise ValueError("look_at_m away from origin_m, and up not along that axis")
        return self


class SceneCard(FrozenModel):
    """Everything about a scene that is not geometry.

    Lengths are in metres, except in keys that end in ``_mm``.
    """

    id: str = Field(pattern=r"^[a-z0-9][a-z0-9_]*$")
    """Name of the folder: lower-case letters, digits, ``_``."""
    title: str
    """Title on one line, for lists."""
    licence: str
    """SPDX identifier of the licence."""
    source: str
    """Origin of everything in the folder; use ``SOURCE.md`` for more than one line."""
    kit: tuple[str, ...] = ()
    """Modules of ``scenes/_kit`` that ``scene.py`` imports; one that imports another stands after it."""
    unit_m: float = Field(default=1.0, gt=0)
    """Metres per unit of the geometry; the card itself is always in metres."""
    camera: CameraPose
    lens: LensCard
    """The lens and its drive; each kind of drive has different keys."""
    lenses: dict[str, LensCard] = Field(default_factory=dict)
    """Lenses of a family by name, in place of ``lens``: the parameter ``lens`` names that of a member, and ``build``
    finds the keys of that lens there."""
    lights: dict[str, tuple[str, ...]] = Field(min_length=1)
    """Emitters that are switched together, by light group. The name of a group consists of lower-case letters, digits,
    ``-``, ``_``."""
    roles: dict[str, Literal["key", "fill", "ambient"]] = Field(default_factory=dict)
    """Role of each light group, by which recipes reach the lights of any scene: ``key``, the main light, at least one
    group; ``fill``, a second light from elsewhere; ``ambient``, the light from all around. By default the first group
    is the key, and the others are ambient; a group that is called like a role has it."""
    section: SectionCard | None = None
    """Makes the scene a thin section, lit from below, whose pictures are computed by waves; ``lights`` then groups its
    condensers."""
    illuminance_lux: dict[str, float] = Field(default_factory=dict)
    """Mean illuminance of the target by each light group alone at gain 1, lux, above 0; given for all groups or for
    none. Light schedules in lux need it."""
    target: tuple[str, ...] = Field(min_length=1)
    """Shapes on which the lens should focus."""
    params: dict[str, Any] = Field(default_factory=dict)
    """Parameters of the geometry: finite numbers, text, ``true``, ``false``, lists of them. A range makes the scene
    a family of members; a recipe may set any number, but only a listed value of a choice."""
    motion: dict[str, RigidMotion] = Field(default_factory=dict)
    """Motion of each moving shape, in addition to the pose that the geometry gives it."""
    slices_per_s: float | None = Field(default=None, gt=0, le=20_000)
    """Rendered time slices per second, between which a recording interpolates; required if the scene moves."""
    interpolation_error: float | None = Field(default=None, gt=0, lt=1)
    """Largest error of interpolation between slices over all members: rms difference from a render half-way between two
    slices, divided by the mean brightness, in the box around the target. ``saf-gen scenes check`` measures it."""
    still_s: float = 0.5
    """Time at which a moving scene is rendered if it has to be at rest, s."""

    @model_validator(mode="after")
    def _check_illuminance(self) -> "SceneCard":
        lux = self.illuminance_lux
        if lux and not (set(lux) == set(self.lights) and all(value > 0 for value in lux.values())):
            raise ValueError(f"illuminance_lux above 0 for each of {', '.join(self.lights)}, or for none")
        return self

    @property
    def light_roles(self) -> dict[str, str]:
        """Role of each light group in the order of the card, by default if the card states none."""
        return {group: self.roles[group] for group in self.lights} if self.roles else default_roles(self.lights)

    def estimate_interpolation_error(self, slices_per_s: float) -> float | None:
        """Return ``interpolation_error`` at another number of slices per second, or None if the card lacks it."""
        if self.interpolation_error is None or self.slices_per_s is None:
            return None
        return self.interpolation_error * (self.slices_per_s / slices_per_s) ** EDGE_POWER


@dataclass(frozen=True)
class Scene:
    """A scene folder whose card has been read: one member of the family, if the scene has open parameters.

    Attributes
    ----------
    folder : Path
        Folder of the scene.
    card : SceneCard
        Card of the scene.
    digest : str
        SHA-256 (hex) over everything that can change a pixel, so that a stored focal stack is never used for an edited
        scene.
    params : mapping of str to object
        All parameters, with a value drawn for every range.
    """

    folder: Path
    card: SceneCard
    digest: str
    params: Mapping[str, Any]

    @property
    def id(self) -> str:
        return self.card.id

    @property
    def has_script(self) -> bool:
        """True if the geometry is a script, ``scene.py``, rather than ``scene.xml``."""
        return (self.folder / SCRIPT_FILE).is_file()

    def build_drive(self, f_number: float | None = None) -> Drive:
        """Return the drive of the card's lens; ``f_number``, if given, replaces the card's."""
        return self.card.lens.build_drive(f_number)

    def draw_member(self, *stream: str | int) -> "Scene":
        """Return a member of the family, with every range drawn from the random streams of this name."""
        params = {
            key: draw_range(value, seeds.make_generator(*stream, "param", key))
            for key, value in self.card.params.items()
        }
        return self._with(params)

    def _with(self, params: Mapping[str, Any]) -> "Scene":
        """Return the member with these parameters, and with the lens that they name."""
        if not self.card.lenses:
            return replace(self, params=params)
        lens = self.card.lenses.get(params[LENS_PARAMETER])
        if lens is None:
            raise unknown(f"lens of scene {self.id!r}:", params[LENS_PARAMETER], allowed=self.card.lenses)
        return replace(self, params=params, card=self.card.model_copy(update={"lens": lens}))

    @property
    def script_params(self) -> dict[str, Any]:
        """What the functions of the script are called with: the parameters, and the keys of a lens that they name."""
        lens = {LENS_PARAMETER: self.card.lens.model_dump(mode="json", exclude_none=True)} if self.card.lenses else {}
        return {**self.params, **lens}

    def with_params(self, chosen: Mapping[str, Any]) -> "Scene":
        """Return this scene with some parameters replaced; raise BadInput if one is unknown."""
        for key in chosen:
            if key not in self.params:
                raise unknown(f"parameter of scene {self.id!r}:", key, allowed=self.params)
        return self._with({**self.params, **chosen})

    def kit_files(self) -> dict[str, Path]:
        """Return the files of the shared modules that the script imports, by name, in the order of the card."""
        modules = kit_modules()
        return {name: modules[name] for name in self.card.kit}


def kit_modules() -> dict[str, Path]:
    """Return the files of all modules that scripts may share, by name."""
    return {path.stem: path for path in sorted((shipped_folder("scenes") / KIT).glob("*.py"))}


def scene_roots() -> list[Path]:
    """Return the folders in which scenes are looked up by name, in the order of precedence.

    These are the folders of :func:`~saf_gen.scene.trusted_folders.folders_in_use`, then the folder of the scenes
    that come with saf_gen.
    """
    return [*trusted_folders.folders_in_use(), shipped_folder("scenes")]


def scene_names() -> list[str]:
    """Return the names of all scenes that can be found, sorted."""
    return sorted({p.parent.name for root in scene_roots() for p in root.glob(f"*/{CARD_FILE}")})


def find_scene(name: str) -> Scene:
    """Return the scene of this name, with one fixed draw of its open parameters.

    Raises BadInput as :func:`find_any_scene` does, and if the scene was photographed, so that nothing can be rendered.
    """
    return rendered(find_any_scene(name))


def rendered(scene: Scene | PictureScene) -> Scene:
    """Return a scene; raise BadInput if it was photographed, so that nothing can be rendered."""
    if isinstance(scene, PictureScene):
        raise BadInput(f"scene {scene.id!r} was photographed", allowed="scenes that are rendered")
    return scene


def find_any_scene(name: str) -> Scene | PictureScene:
    """Return the scene of this name, which may be one whose pictures are given.

    A name cannot be a path, so that a recipe of unknown origin cannot lead to code outside the trusted folders.

    Raises
    ------
    BadInput
        If the name is unknown, or known only in ``scenes/`` of the working directory and the user has not registered
        that folder; if the card is not valid; if the geometry is missing.
    """
    if Path(name).name == name:
        for root in scene_roots():
            if (root / name / CARD_FILE).is_file():
                return _read(root / name)
        if (card := Path("scenes").resolve() / name / CARD_FILE).is_file():
            raise _untrusted(card.parent, f"the scene {name!r} is only in ./scenes, which is not registered")
    raise unknown("scene", name, allowed=scene_names(), hint="see: saf-gen scenes list")


def load_scene(folder: Path) -> Scene:
    """Return the scene in any folder that can be rendered; see :func:`load_any_scene`, and :func:`find_scene`."""
    return rendered(load_any_scene(folder))


def load_any_scene(folder: Path) -> Scene | PictureScene:
    """Return the scene in any folder; if its geometry is a script, the user must trust the folder.

    Raises
    ------
    BadInput
        As :func:`find_any_scene` does, and for a ``scene.py`` in a folder that is neither registered, nor named by
        ``SAF_GEN_SCENES``, nor the folder of the scenes that come with saf_gen.
    """
    folder = folder.resolve()
    trusted = {root.resolve() for root in (*trusted_folders.all_trusted(), shipped_folder("scenes"))}
    if (folder / SCRIPT_FILE).exists() and folder.parent not in trusted:
        raise _untrusted(folder, f"{folder / SCRIPT_FILE} is code, and would be run")
    return _read(folder)


def _untrusted(folder: Path, problem: str) -> BadInput:
    root = folder.parent
    return BadInput(
        problem,
        allowed="scene.py in a folder that you trust; a path to a scene.xml",
        hint=f"read its code, and if you trust it: saf-gen scenes list --trust {root}",
    )


def _read(folder: Path) -> Scene | PictureScene:
    document = read_yaml(folder / CARD_FILE)
    if isinstance(document.data, dict) and "pictures" in document.data:
        given = validate_document(PictureCard, document)
        _check_id(given.id, document, folder=folder)
        contents = {CARD_FILE: given.pictures.model_dump_json().encode()}
        return PictureScene(folder, given, folder_digest(folder, contents=contents, allow_outside_links=False))
    card = validate_document(SceneCard, document)
    _check_id(card.id, document, folder=folder)
    geometry = [name for name in (SCRIPT_FILE, "scene.xml") if (folder / name).is_file()]
    if not geometry:
        raise BadInput(
            f"{folder} has neither scene.py nor scene.xml",
            hint="add scene.py with build(params) -> Mitsuba dictionary, or an exported scene.xml",
        )
    if len(geometry) > 1:
        raise BadInput(f"{folder} has scene.py and scene.xml", hint="keep one of the two")
    if isinstance(card.lens, LensFile):
        card = card.model_copy(update={"lens": card.lens.read_from(folder)})
    if card.lenses:
        _check_lens_names(card, document)
        read = {name: one.read_from(folder) if isinstance(one, LensFile) else one for name, one in card.lenses.items()}
        card = card.model_copy(update={"lenses": read})
    check_groups(card.lights, document, roles=card.roles)
    if card.section is not None:
        has_script = geometry == [SCRIPT_FILE]
        check_section(card.section, document, lights=card.lights, target=card.target, has_script=has_script)
    for key, value in card.params.items():
        check_parameter(value, what=f"params.{key}", where=document.locate("params", key))
    if card.kit:
        _check_kit(card, document, folder=folder, has_script=geometry == [SCRIPT_FILE])
    scene = Scene(folder, card, _digest(folder, card), {}).draw_member("scene", card.id)
    for keys, lens in [(("lens",), card.lens), *((("lenses", name), lens) for name, lens in card.lenses.items())]:
        try:
            lens.build_drive()
        except BadInput as error:
            raise BadInput(str(error), where=document.locate(*keys, lens.drive_class.travel_key)) from error
    return scene


def _check_id(name: str, document: Document, *, folder: Path) -> None:
    if name != folder.name:
        raise BadInput(f"id is {name!r}", where=document.locate("id"), allowed=f"{folder.name}, the folder's name")


def _check_kit(card: SceneCard, document: Document, *, folder: Path, has_script: bool) -> None:
    """Raise BadInput unless each module of the kit exists, once, and under a name that no file of the folder has."""
    where, modules = document.locate("kit"), kit_modules()
    for name in card.kit:
        if name not in modules:
            raise unknown("module of the kit", name, allowed=modules, where=where)
        if not has_script or (folder / f"{name}.py").exists() or card.kit.count(name) > 1:
            raise BadInput(
                f"kit has the name {name!r}",
                where=where,
                allowed=f"once, a module that {SCRIPT_FILE} imports, and whose name no file in the folder has",
            )


def _check_lens_names(card: SceneCard, document: Document) -> None:
    """Raise BadInput unless the parameter ``lens`` names one of the card's lenses, or is a choice among them."""
    if LENS_PARAMETER not in card.params:
        raise BadInput(
            "the card has lenses, but no parameter names one",
            where=document.locate("lenses"),
            allowed=f"params: {{lens: {{choice: [{', '.join(card.lenses)}]}}}}",
        )
    where = document.locate("params", LENS_PARAMETER)
    for name in range_extremes(card.params[LENS_PARAMETER], where=where):
        if not isinstance(name, str) or name not in card.lenses:
            raise unknown("lens", str(name), allowed=card.lenses, where=where)


def _digest(folder: Path, card: SceneCard) -> str:
    """Return the SHA-256 over everything of a scene that can change a pixel.

    Card values that change no pixel are left out, so that a corrected title or a newly measured illuminance does not
    cause a new render. A module of the kit counts as if it were a file in the folder.
    """
    values = card.model_dump(mode="json", exclude_unset=True, exclude=set(KEYS_WITHOUT_PIXEL_EFFECT))
    values["lens"].pop("axial_colour", None)  # pictures of other wavelengths are mixed from those of one
    contents = {CARD_FILE: json.dumps(values, sort_keys=True).encode()}
    modules = kit_modules()
    contents |= {f"{name}.py": modules[name].read_bytes() for name in card.kit}
    for lens in (card.lens, *card.lenses.values()):
        if isinstance(lens, LensFile) and (text := shipped_text(lens.file)):
            contents[f"lens/{lens.file}.yaml"] = text.encode()
    # Only a script can read files outside its folder; files of an XML scene must be inside it.
    return folder_digest(folder, contents=contents, allow_outside_links=(folder / SCRIPT_FILE).is_file())


MAX_FILES = 100_000  # files and folders of a scene; a link to an entire disk would lead to more
COMPARISON = "import.png"
"""The picture of an imported scene beside its source's."""
PROSE, DRAWN = ".md", ("preview.png", COMPARISON)  # files that affect no rendered pixel; the latter at the top level


def folder_digest(folder: Path, *, contents: Mapping[str, bytes], allow_outside_links: bool) -> str:
    """Return the SHA-256 (hex) over the names and bytes of a folder's files.

    Markdown files, and ``preview.png`` and ``import.png`` at the top level, are left out. Files of a linked folder
    count under the name of the link.

    Parameters
    ----------
    folder : Path
        Folder of the scene.
    contents : mapping of str to bytes
        Bytes by file name, which replace the content of a file or add a file that is not in the folder.
    allow_outside_links : bool
        Whether links may lead out of the folder.

    Raises
    ------
    BadInput
        If a file or folder cannot be read, links form a circle or lead out of the folder without permission, or there
        are more than 100,000 files and folders.
    """
    sha = hashlib.sha256()
    try:
        for path in sorted({*_list_files(folder, allow_outside_links), *(folder / name for name in contents)}):
            name = path.relative_to(folder).as_posix()
            if path.suffix != PROSE and name not in DRAWN:
                content = contents[name] if name in contents else path.read_bytes()
                sha.update(f"{name}\0{len(content)}\0".encode() + content)
    except OSError as error:
        raise BadInput(f"{error.filename or folder} cannot be read: {error.strerror or error}") from error
    return sha.hexdigest()


def _list_files(folder: Path, allow_outside_links: bool) -> list[Path]:
    """Return all regular files in a folder and its subfolders; linked folders are followed."""
    found: list[Path] = []
    todo: list[tuple[Path, tuple[str, ...]]] = [(folder, ())]
    seen = 0
    while todo:
        current, parents = todo.pop()
        parents = (*parents, os.path.realpath(current))  # a link back to one of these forms a circle
        for path in current.iterdir():
            seen += 1
            if seen > MAX_FILES:
                raise BadInput(f"{folder} holds more than {MAX_FILES:,} files", hint="remove unrelated files")
            if path.is_file():
                found.append(path)
            elif path.is_dir() and path.name != "__pycache__":
                _check_link(path, parents, allow_outside=allow_outside_links)
                todo.append((path, parents))
    return found


def _check_link(path: Path, parents: tuple[str, ...], *, allow_outside: bool) -> None:
    real = os.path.realpath(path)
    if real in parents:
        raise BadInput(f"{path} is a link back to {real}, which contains it", hint="remove the link")
    if not (allow_outside or Path(real).is_relative_to(parents[0])):
        raise BadInput(
            f"{path} is a link to {real}",
            allowed="links within the scene's folder, for a scene.xml",
            hint=f"copy it into {parents[0]}",
        )
