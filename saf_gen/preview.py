"""A contact sheet of a focal stack: what the lens sees at both ends and at the truth, and how far it is."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from saf_gen.files import replaced
from saf_gen.focal_stack import FocalStack

__all__ = ["write_preview"]

STYLE: Any = {"font.size": 9, "axes.titlesize": 9}


def write_preview(stack: FocalStack, path: Path) -> None:
    """Write the sheet as PNG, 1400 × 640 pixels."""
    spec = stack.spec
    image = stack.radiance.sum(axis=0)
    white = float(np.quantile(image, 0.995))
    truth = spec.drive.truth(stack.depth[stack.target])
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(14, 6.4), dpi=100, layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(f"{spec.scene}: {spec.positions} positions, {spec.samples} samples a pixel")
        axes = figure.subplots(2, 3)
        for place, position in zip(axes[0], (0.0, float(np.clip(truth, 0, 1)), 1.0), strict=True):
            at = float(spec.drive.focus_depth(position))
            _show(place, image[round(position * (spec.positions - 1))], white)
            what = "true focus of the target" if position == truth else "an end of the travel"
            place.set_title(f"position {position:.3f}, in focus {at:.5g} m: {what}")
        _show_depth(axes[1, 0], stack)
        _show_curve(axes[1, 1], stack, truth)
        _show_groups(axes[1, 2], stack, white)
        with replaced(path) as part:
            figure.savefig(part, format="png")


def _show(axes: Axes, image: np.ndarray, white: float) -> None:
    """Linear radiance, encoded for the eye with a gamma of 2.2."""
    axes.imshow(np.clip(image / white, 0, 1) ** (1 / 2.2), cmap="gray", vmin=0, vmax=1)
    axes.set_axis_off()


def _show_depth(axes: Axes, stack: FocalStack) -> None:
    finite = stack.depth[np.isfinite(stack.depth)]
    low, high = np.quantile(finite, [0.01, 0.99])
    shown = axes.imshow(stack.depth, cmap="viridis", vmin=low, vmax=high + 1e-9)
    if not stack.target.all():
        axes.contour(stack.target, levels=[0.5], colors="white", linewidths=1)
    axes.set_axis_off()
    axes.set_title("depth (m), the target outlined")
    axes.figure.colorbar(shown, ax=axes, shrink=0.9)


def _show_curve(axes: Axes, stack: FocalStack, truth: float) -> None:
    spec = stack.spec
    depths = stack.depth[stack.target]
    blur = [np.sqrt(np.mean(spec.drive.blur_diameter(p, depths) ** 2)) / spec.pitch_m for p in spec.focus]
    axes.plot(spec.focus, blur, color="#0072B2")
    axes.axvline(truth, color="black", linewidth=1)
    near, far = np.clip(spec.drive.depth_of_focus(depths, spec.pitch_m), 0, 1)  # of a pinhole it has no end
    axes.axvspan(near, far, color="#f0d060", alpha=0.5, linewidth=0)
    axes.set(xlabel="focus position, fraction of travel", ylabel="blur of the target, pixels", xlim=(0, 1))
    axes.set_ylim(bottom=0)
    axes.set_title("blur (rms), true focus and depth of focus")


def _show_groups(axes: Axes, stack: FocalStack, white: float) -> None:
    """Each light group alone at the middle of the travel, side by side."""
    middle = stack.radiance[:, stack.spec.positions // 2]
    _show(axes, np.concatenate(list(middle), axis=1), white)
    axes.set_title("light groups alone: " + ", ".join(stack.spec.groups))
