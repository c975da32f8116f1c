"""A focal stack rendered with Mitsuba's thin lens, one render per focus position.

The scalar backend renders in this way, and tests compare the one-pass stack with it. The field of view follows the
image distance (breathing), and the camera follows the stage. A pixel is the mean radiance over aperture and pixel, as
in the one-pass stack.
"""

from collections.abc import Callable

import mitsuba as mi
import numpy as np

from saf_gen.core.region import Region
from saf_gen.render.render_setup import RenderSetup, camera_dict, film_dict, positions_to_render, render_with_camera


def render_position(
    setup: RenderSetup, *, position: float, samples: int, seed: int, region: Region | None = None
) -> np.ndarray:
    """Render the mean radiance at one focus position, of all pixels or of a region: float32 (row, col)."""
    drive = setup.drive
    film = film_dict(setup.grid, region)
    camera = mi.load_dict(
        {
            "type": "thinlens",
            **camera_dict(setup, position),
            "film": film,
            "aperture_radius": drive.aperture_radius_m / setup.unit_m,
            "focus_distance": float(drive.object_distance(position)) / setup.unit_m,
            "sampler": {"type": "independent", "sample_count": samples},
        }
    )
    image = render_with_camera(setup.mitsuba_scene, camera, integrator=setup.integrator, samples=samples, seed=seed)
    return image.reshape(film["crop_height"], film["crop_width"])


def render_stack(
    setup: RenderSetup,
    *,
    positions: int,
    samples: int,
    seed: int,
    window: tuple[int, int] | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> tuple[np.ndarray, int]:
    """Render the mean radiance at evenly spaced positions, with any backend.

    Parameters and results are those of :func:`saf_gen.render.one_pass.render_stack`; no path is clipped as a firefly.
    """
    focus = positions_to_render(positions, window)
    out = np.empty((focus.size, setup.grid.rows, setup.grid.columns), dtype=np.float32)
    for k, position in enumerate(focus):
        out[k] = render_position(
            setup,
            position=float(position),
            samples=samples,
            # One seed for all positions: neighbours then share their noise, as in the one-pass stack. With one seed per
            # position, the mean of two positions would be smoother than either, and a sweep would show this as a beat.
            seed=seed,
        )
        progress((k + 1) / focus.size)
    return out, 0
