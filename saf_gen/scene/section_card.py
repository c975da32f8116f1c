"""The part of a card that makes a scene a thin section, whose pictures are computed by waves.

Such a scene has one surface, the section, perpendicular to the optical axis through ``camera.look_at_m``, and is lit
through it by condensers. ``scene.py`` draws the section (:mod:`saf_gen.render.thin_section`).
"""

from collections.abc import Mapping, Sequence

from pydantic import Field

from saf_gen.core.config.document import Document, FrozenModel
from saf_gen.errors import BadInput, unknown

TARGET = "section"


class Condenser(FrozenModel):
    """A disc of light below the section, as wide as the condenser's stop."""

    coherence: float = Field(ge=0.02, le=2)
    """Numerical aperture of the condenser divided by that of the lens. Narrow light gives edges and phase more
    contrast; from 1 on, a weak phase section has none at any position."""
    radiance: float = Field(gt=0, le=1e6)
    """Radiance of the disc, W m⁻² sr⁻¹."""


class SectionCard(FrozenModel):
    """The light of a thin section."""

    wavelength_nm: float = Field(default=550.0, ge=200, le=2000)
    """Wavelength of the light, nm; ``diffraction`` of a recipe does not apply."""
    condensers: dict[str, Condenser] = Field(min_length=1)
    """Condensers by name; each belongs to a light group. Their light adds up without interfering."""


def check_section(
    section: SectionCard,
    document: Document,
    *,
    lights: Mapping[str, Sequence[str]],
    target: Sequence[str],
    has_script: bool,
) -> None:
    """Raise BadInput if other keys of a card, or the scene's files, do not fit a thin section.

    Parameters
    ----------
    section : SectionCard
        The card's ``section``.
    document : Document
        The card.
    lights : mapping of str to sequence of str
        Condensers by light group, as on the card.
    target : sequence of str
        Target of the card.
    has_script : bool
        Whether the scene has a ``scene.py``.
    """
    if not has_script:
        raise BadInput(
            "a thin section needs scene.py, not scene.xml",
            where=document.locate("section"),
            hint="write build(params), which returns transmission, path_nm and texel_um",
        )
    for group, names in lights.items():
        for name in names:
            if name not in section.condensers:
                raise unknown(
                    f"condenser of light group {group!r}:",
                    name,
                    allowed=section.condensers,
                    where=document.locate("lights", group),
                )
    listed = {name for names in lights.values() for name in names}
    for name in section.condensers:
        if name not in listed:
            raise BadInput(
                f"the condenser {name!r} belongs to no light group",
                where=document.locate("section", "condensers", name),
                hint="list it under lights",
            )
    if list(target) != [TARGET]:
        raise BadInput(
            f"target is {list(target)}", where=document.locate("target"), allowed=f"[{TARGET}], the only surface"
        )
    for key in ("motion", "slices_per_s", "interpolation_error"):
        if document.data.get(key):
            raise BadInput(
                f"a thin section does not move, but the card has {key}",
                where=document.locate(key),
                hint=f"remove {key}, or model the section as sheets that let light through (scenes/lily_anther)",
            )
