"""A focal stack by Mitsuba's own thin lens, one render a focus position: the scalar way, and the referee.

The field of view follows the image distance (breathing); Mitsuba's pixel is the mean radiance over the
aperture and the pixel, as ours.
"""

from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np

from saf_gen.render.film import Setup, field_of_view, film_dict

__all__ = ["render_at", "render_stack"]


def render_at(
    setup: Setup,
    *,
    position: float,
    samples: int,
    seed: int,
) -> np.ndarray:
    """Mean radiance at one focus position, float32 (row, col)."""
    drive, film = setup.drive, setup.film
    sensor = mi.load_dict(
        {
            "type": "thinlens",
            "to_world": setup.to_world,
            "aperture_radius": drive.aperture_radius_m,
            "focus_distance": float(drive.object_distance(position)),
            **field_of_view(film, float(drive.image_distance(position))),
            "film": film_dict(film),
            "sampler": {"type": "independent", "sample_count": samples},
        }
    )
    seed_word: Any = seed & 0xFFFFFFFF  # Mitsuba takes an int, its stubs ask for an array
    image = mi.render(setup.world, sensor=sensor, integrator=setup.integrator, spp=samples, seed=seed_word)
    return np.array(image, dtype=np.float32).reshape(film.rows, film.columns)


def render_stack(
    setup: Setup,
    *,
    positions: int,
    samples: int,
    seed: int,
    progress: Callable[[float], None] = lambda done: None,
) -> tuple[np.ndarray, int]:
    """Mean radiance at evenly spaced positions, float32 (focus, row, col); works in every variant.

    Returns it with the number of paths clipped as fireflies: none, nothing is clipped here.
    """
    out = np.empty((positions, setup.film.rows, setup.film.columns), dtype=np.float32)
    for k, position in enumerate(np.linspace(0, 1, positions)):
        out[k] = render_at(
            setup,
            position=float(position),
            samples=samples,
            # One seed for all positions: neighbours then share their noise, as in the one-pass stack. With a
            # seed each, the average of two knots is smoother than a knot, and a sweep would show that beat.
            seed=seed,
        )
        progress((k + 1) / positions)
    return out, 0
