"""The estimators of a focal stack, which find the radiance of pixels from finitely many light paths."""

from collections.abc import Callable, Collection, Mapping

import numpy as np

from saf_gen.core import seeds
from saf_gen.render import filtered_pass, one_pass, thin_lens
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import ShadingField


def shares_shading(estimator: str, *, backend_name: str) -> bool:
    """Return whether an estimator needs the shading of surfaces: only 'filtered' does, and not with scalar."""
    return estimator == "filtered" and backend_name != "scalar"


def render_groups(
    setups: Mapping[str, RenderSetup],
    *,
    backend_name: str,
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
    setups : mapping of str to RenderSetup
        The same scene under each light group, by name.
    backend_name : str
        'llvm' or 'cuda', which trace all positions at once, or 'scalar', which renders position by position.
    samples : int
        Smallest number of light paths per pixel, position and light group.
    shading : ShadingField, optional
        Shading of the scene's surfaces, for the filtered estimator (:mod:`saf_gen.render.filtered_pass`). Without it
        the estimator is plain (:mod:`saf_gen.render.one_pass`, or Mitsuba's with scalar).
    positions, seed, emitting, window, progress
        See :func:`saf_gen.render.filtered_pass.render_with_shading`.

    Returns
    -------
    dict of str to tuple of (ndarray, int)
        For each group the stack, float32 (focus, row, col), and the number of light paths that were clipped as
        fireflies.
    """
    if shading is not None:
        return filtered_pass.render_with_shading(
            setups,
            shading,
            positions=positions,
            samples=samples,
            seed=seeds.derive_seed(seed, "primary rays"),
            emitting=emitting,
            window=window,
            progress=progress,
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
