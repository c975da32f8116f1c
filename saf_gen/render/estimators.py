"""The estimators of a focal stack, by name: how the radiance of pixels is found from a finite number of light paths."""

from collections.abc import Callable, Collection, Mapping

import numpy as np

from saf_gen.core import seeds
from saf_gen.render import filtered_pass, one_pass, thin_lens
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import ShadingField


def render_light_groups(
    setups: Mapping[str, RenderSetup],
    *,
    backend_name: str,
    estimator: str,
    positions: int,
    samples: int,
    seed: int,
    emitting: Collection[str],
    shading: ShadingField | None = None,
    window: tuple[int, int] | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, tuple[np.ndarray, int]]:
    """Render the stacks of a scene's light groups.

    Parameters
    ----------
    setups : the same scene under each light group, by name.
    backend_name : 'llvm' or 'cuda', which trace all positions at once; or 'scalar', which renders position by position
        and knows no estimator but Mitsuba's own, a plain one.
    estimator : 'filtered' (:mod:`saf_gen.render.filtered_pass`) or 'plain' (:mod:`saf_gen.render.one_pass`).
    samples : light paths per pixel, position and light group, at least.
    shading : what the filtered estimator is to take for the shading of surfaces; by default what light paths of this
        scene tell.
    positions, seed, emitting, window, progress : see :func:`saf_gen.render.filtered_pass.render_with_shading`.

    Returns
    -------
    For each group the stack, float32 (focus, row, col), and the number of light paths that were clipped as fireflies.
    """
    if estimator == "filtered" and backend_name != "scalar":
        own = shading is None
        if shading is None:
            cells = filtered_pass.gather_shading(
                setups,
                samples=samples,
                seed=seeds.derive_seed(seed, "light paths"),
                emitting=emitting,
                progress=lambda done: progress(done / 2),
            )
            shading = filtered_pass.estimate_shading([cells])
        return filtered_pass.render_with_shading(
            setups,
            shading,
            positions=positions,
            samples=samples,
            seed=seeds.derive_seed(seed, "primary rays"),
            emitting=emitting,
            window=window,
            progress=lambda done: progress((1 + done) / 2 if own else done),
        )
    render_stack = thin_lens.render_stack if backend_name == "scalar" else one_pass.render_stack
    found = {}
    for n, (name, setup) in enumerate(setups.items()):

        def report(done: float, n: int = n) -> None:
            progress((n + done) / len(setups))

        found[name] = render_stack(
            setup,
            positions=positions,
            samples=samples,
            seed=seeds.derive_seed(seed, name),
            window=window,
            progress=report,
        )
    return found
