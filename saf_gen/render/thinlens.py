"""A focal stack by Mitsuba's own thin lens, one render a focus position: the scalar way, and the referee.

The field of view follows the image distance (breathing); Mitsuba's pixel is the mean radiance over the
aperture and the pixel, as ours.
"""

from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.optics import ImageDistance
from saf_gen.render.film import Film, field_of_view, film_dict

__all__ = ["render_at", "render_stack"]


def render_at(
    world: Any,
    integrator: Any,
    to_world: Any,
    drive: ImageDistance,
    film: Film,
    *,
    position: float,
    samples: int,
    seed: int,
) -> np.ndarray:
    """Mean radiance at one focus position, float32 (row, col)."""
    sensor = mi.load_dict(
        {
            "type": "thinlens",
            "to_world": to_world,
            "aperture_radius": drive.aperture_radius_m,
            "focus_distance": float(drive.object_distance(position)),
            **field_of_view(film, float(drive.image_distance(position))),
            "film": film_dict(film),
            "sampler": {"type": "independent", "sample_count": samples},
        }
    )
    seed_word: Any = seed & 0xFFFFFFFF  # Mitsuba takes an int, its stubs ask for an array
    image = mi.render(world, sensor=sensor, integrator=integrator, spp=samples, seed=seed_word)
    return np.array(image, dtype=np.float32).reshape(film.rows, film.columns)


def render_stack(
    world: Any,
    integrator: Any,
    to_world: Any,
    drive: ImageDistance,
    film: Film,
    *,
    positions: int,
    samples: int,
    seed: int,
    progress: Callable[[float], None] = lambda done: None,
) -> tuple[np.ndarray, int]:
    """Mean radiance at evenly spaced positions, float32 (focus, row, col); works in every variant.

    Returns it with the number of paths clipped as fireflies: none, nothing is clipped here.
    """
    out = np.empty((positions, film.rows, film.columns), dtype=np.float32)
    for k, position in enumerate(np.linspace(0, 1, positions)):
        out[k] = render_at(
            world,
            integrator,
            to_world,
            drive,
            film,
            position=float(position),
            samples=samples,
            # One seed for all positions: neighbours then share their noise, as in the one-pass stack. With a
            # seed each, the average of two knots is smoother than a knot, and a sweep would show that beat.
            seed=seed,
        )
        progress((k + 1) / positions)
    return out, 0
