"""What ``scene.py`` draws of a thin section: how much light it lets through, and how much it delays it.

``build(params)`` returns a dictionary:

| key | what |
|---|---|
| `transmission` | share of the light that passes, 0 to 1, (row, col) |
| `path_nm` | optical thickness beyond that of the mounting medium, Δn times thickness, nm, (row, col) |
| `texel_um` | distance between neighbouring values, µm |
| `height_um` | height of the section over `camera.look_at_m`, towards the lens, µm; 0 if left out |

One of the two arrays may be a number. The first row is at the top of the picture, and the middle of the array in its
middle. Beyond the array the slide is clear. Values are samples of a smooth function: what is finer than two texels does
not exist.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from saf_gen.errors import BadInput, unknown
from saf_gen.render.mitsuba_scene import call_scene_script
from saf_gen.scene.scene_folder import Scene

NEEDED, OPTIONAL = ("transmission", "path_nm", "texel_um"), ("height_um",)
MAX_PATH_NM, MAX_HEIGHT_UM, MAX_TEXEL_UM = 1e5, 1e6, 1e4
MAX_SIDE = 1 << 14  # texels


@dataclass(frozen=True, eq=False)
class ThinSection:
    """A thin section, perpendicular to the optical axis.

    Attributes
    ----------
    transmission : ndarray of float64, shape (row, col)
        Share of the light that passes, 0 to 1.
    path_m : ndarray of float64, shape (row, col)
        Optical thickness beyond that of the mounting medium, metres.
    texel_m : float
        Distance between neighbouring values, metres.
    height_m : float
        Height over ``camera.look_at_m`` towards the lens, metres.
    """

    transmission: np.ndarray
    path_m: np.ndarray
    texel_m: float
    height_m: float

    def amplitude(self, wavelength_m: float) -> np.ndarray:
        """Return the factor by which the section changes a wave, complex128 (row, col)."""
        return np.sqrt(self.transmission) * np.exp(2j * np.pi / wavelength_m * self.path_m)


def draw_section(scene: Scene) -> ThinSection:
    """Return the thin section that a scene's ``build(params)`` draws.

    Raises
    ------
    BadInput
        If the script fails or returns something else, with one line that names the value.
    """
    where = f"build() of {scene.folder / 'scene.py'}"
    drawn = call_scene_script(scene, "build")
    if not isinstance(drawn, dict):
        raise BadInput(f"{where} returned {type(drawn).__name__}", allowed=f"a dictionary of {', '.join(NEEDED)}")
    for key in drawn:
        if key not in (*NEEDED, *OPTIONAL):
            raise unknown("key of a thin section:", key, allowed=[*NEEDED, *OPTIONAL], where=where)
    for key in NEEDED:
        if key not in drawn:
            raise BadInput(f"{where} returned no {key!r}", allowed=", ".join((*NEEDED, *OPTIONAL)))
    texel = _number(drawn, "texel_um", low=1e-3, high=MAX_TEXEL_UM, where=where)
    height = _number(drawn, "height_um", low=-MAX_HEIGHT_UM, high=MAX_HEIGHT_UM, where=where)
    transmission = _array(drawn, "transmission", low=0.0, high=1.0, where=where)
    path = _array(drawn, "path_nm", low=-MAX_PATH_NM, high=MAX_PATH_NM, where=where)
    if transmission.shape != path.shape and transmission.ndim == path.ndim:
        raise BadInput(
            f"{where} returned transmission of {transmission.shape} and path_nm of {path.shape}",
            allowed="the same shape, or one of the two a number",
        )
    if transmission.ndim == path.ndim == 0:
        raise BadInput(f"{where} returned two numbers", allowed="transmission or path_nm as an array (row, col)")
    transmission, path = np.broadcast_arrays(transmission, path)
    return ThinSection(transmission, path * 1e-9, texel * 1e-6, height * 1e-6)


def _number(drawn: dict[Any, Any], key: str, *, low: float, high: float, where: str) -> float:
    try:
        value = float(drawn.get(key, 0.0))
    except (TypeError, ValueError):
        value = math.nan
    if not low <= value <= high:
        raise BadInput(f"{where} returned {key} = {_short(drawn[key])}", allowed=f"{low:g} to {high:g}")
    return value


def _array(drawn: dict[Any, Any], key: str, *, low: float, high: float, where: str) -> np.ndarray:
    """Return an array (row, col) or a number, float64, whose values are between ``low`` and ``high``."""
    allowed = f"an array (row, col) of {low:g} to {high:g}, at most {MAX_SIDE:,} a side, or a number"
    try:
        given = np.asarray(drawn[key])
    except ValueError as error:
        raise BadInput(f"{where} returned {key} with rows of different lengths", allowed=allowed) from error
    if given.dtype.kind not in "fiu":
        raise BadInput(f"{where} returned {key} as {given.dtype} of shape {given.shape}", allowed=allowed)
    if given.ndim not in (0, 2) or not given.size or max(given.shape, default=0) > MAX_SIDE:
        raise BadInput(f"{where} returned {key} of shape {given.shape}", allowed=allowed)
    values = given.astype(np.float64)
    worst = values.ravel()[[values.argmin(), values.argmax()]]  # NaN, if there is one, is both
    wrong = [value for value in worst if not low <= value <= high]
    if wrong:
        raise BadInput(f"{where} returned {key} with the value {wrong[0]:g}", allowed=allowed)
    return values


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:60]}…"
