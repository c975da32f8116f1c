"""The part of a card that makes a scene a thin section, whose pictures are computed by waves.

Such a scene has one surface, the section, perpendicular to the optical axis through ``camera.look_at_m``, and is lit
through it by condensers. ``scene.py`` draws the section (:mod:`saf_gen.render.thin_section`).
"""

from collections.abc import Mapping, Sequence

from pydantic import Field

from saf_gen.core.config.document import Document, FrozenModel
from saf_gen.errors import BadInput

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
    """Raise BadInput if other keys of a card, or the scene's files, do not fit a thin section."""
    listed = sorted(name for names in lights.values() for name in names)
    moves = [key for key in ("motion", "slices_per_s", "interpolation_error") if document.data.get(key)]
    for key, fits, problem, allowed in (
        ("section", has_script, "a thin section has scene.xml", "scene.py with build(params)"),
        ("lights", listed == sorted(section.condensers), f"lights are {listed}", ", ".join(section.condensers)),
        ("target", list(target) == [TARGET], f"target is {list(target)}", f"[{TARGET}], the only surface"),
        ("section", not moves, f"a thin section has {', '.join(moves)}", "a section that does not move"),
    ):
        if not fits:
            raise BadInput(problem, where=document.locate(key), allowed=allowed)
