"""The estimators of a focal stack, which find the radiance of pixels from finitely many light paths.

The shading of a moving scene at each of its moments is estimated from the light paths of several of them.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from saf_gen.core import seeds
from saf_gen.render import filtered_pass, one_pass, thin_lens
from saf_gen.render.filtered_pass import estimate_shading, gather_shading
from saf_gen.render.render_setup import RenderSetup
from saf_gen.render.shading_cells import ShadingCells, ShadingField


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


PART_OF_SAMPLES = 4  # samples of a stack divided by the light paths that are traced at each of several moments


class MomentShading:
    """Gathers light paths moment by moment, and keeps them as long as the next stack needs them.

    Parameters
    ----------
    show : callable
        Called with a moment (s); loads the scene and returns it under each of its light groups.
    seed : int
        Seed of all paths.
    emitting : collection of str
        Ids of the shapes that are lamps under any group.
    """

    def __init__(
        self, show: Callable[[float], Mapping[str, RenderSetup]], *, seed: int, emitting: Collection[str]
    ) -> None:
        self._show, self._seed, self._emitting = show, seed, emitting
        self._gathered: dict[tuple[float, int, int], ShadingCells] = {}

    def estimate(
        self, moments_s: Sequence[float], *, samples: int, progress: Callable[[float], None] = lambda done: None
    ) -> ShadingField:
        """Return the shading at the last of several moments.

        Parameters
        ----------
        moments_s : sequence of float
            Moments (s) in rising order. Each occurrence of a repeated moment gets different paths.
        samples : int
            Samples of the stack; each of several moments traces a quarter of them.
        progress : callable, optional
            Called with the completed fraction, 0 to 1.
        """
        each = samples if len(moments_s) == 1 else -(-samples // PART_OF_SAMPLES)
        needed = [(time_s, copy, each) for time_s, copy in _number_copies(moments_s)]
        self._gathered = {key: cells for key, cells in self._gathered.items() if key in needed}
        for n, key in enumerate(needed):
            if key not in self._gathered:
                time_s, copy, _ = key

                def report(done: float, n: int = n) -> None:
                    progress((n + done) / len(needed))

                self._gathered[key] = gather_shading(
                    self._show(time_s),
                    samples=each,
                    seed=seeds.derive_seed(self._seed, "light paths", repr(time_s), copy),
                    emitting=self._emitting,
                    progress=report,
                )
        return estimate_shading([self._gathered[key] for key in needed])


def _number_copies(moments_s: Sequence[float]) -> list[tuple[float, int]]:
    """Return each moment with the number of its later occurrences."""
    later: Counter[float] = Counter()
    numbered = []
    for time_s in reversed(moments_s):
        numbered.append((time_s, later[time_s]))
        later[time_s] += 1
    return numbered[::-1]
