"""Plots of a contact sheet: blur and sharpness over the travel, and the brightness of the pixels."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from saf_gen.camera import Sensor, charge_of_images, exposure_scale
from saf_gen.camera.exposure import firing_rate
from saf_gen.core.figure_style import BAND, COLOURS, INK, SOFT, hide_spines
from saf_gen.core.region import bounding_box
from saf_gen.errors import BadInput
from saf_gen.stack.focal_stack import FocalStack

BLUE, ORANGE = COLOURS[:2]
USUAL_RATE = 0.2  # spikes per readout, the usual mean_rate of recipes


def _charge(stack: FocalStack, sensor: Sensor) -> np.ndarray:
    """Return the photo-electrons per readout with all lights at gain 1, float32 (focus, row, col)."""
    spec = stack.spec
    return charge_of_images(stack.radiance, sensor, lens=spec.drive, position=spec.focus).sum(axis=0)


def draw_curves(axes: Axes, stack: FocalStack, *, sensor: Sensor, truth: float) -> None:
    """Draw the target's blur by geometric optics, and the noise-free sharpness of the stack in the target's box."""
    drive, depths = stack.spec.drive, stack.depth[stack.target]
    axes.set(xlabel="focus position, fraction of travel", xlim=(0, 1))
    axes.set_title("blur (rms) and sharpness of the target,\ntrue focus and depth of focus")
    hide_spines(axes, "top", "right")
    if not depths.size:
        return
    focus = np.linspace(0, 1, 129)
    blur = [np.sqrt(np.mean(drive.blur_diameter(p, depths) ** 2)) / stack.spec.pitch_m for p in focus]
    axes.plot(focus, blur, color=BLUE)
    axes.set_ylabel("blur, pixels", color=BLUE)
    axes.set_ylim(bottom=0)
    ends = drive.depth_of_focus(depths, stack.spec.pitch_m, wavelength_m=stack.spec.wavelength_m)
    axes.axvspan(*ends, color=BAND, alpha=0.6, linewidth=0)
    axes.axvline(truth, color=INK, linewidth=1)
    axes.set_xlim(0, 1)
    rows, columns = bounding_box(stack.target)
    seen = _charge(stack, sensor)[:, rows, columns].astype(np.float64)
    mean = seen.mean(axis=(1, 2))
    if not (mean > 0).all():
        return  # the sharpness of a black image is undefined
    right = axes.twinx()
    right.plot(stack.spec.focus, seen.var(axis=(1, 2)) / mean**2, ".-", color=ORANGE)
    right.set_ylabel("sharpness, variance / mean²", color=ORANGE)
    right.set_ylim(bottom=0)
    hide_spines(right, "top", "left")


def draw_histogram(axes: Axes, stack: FocalStack, *, sensor: Sensor, best: int) -> None:
    """Draw histograms of the firing rates of target and frame at best focus, for a mean of 0.2 on the target.

    If the target is out of sight, or part of it is dark, this mean cannot be reached, and the exposure is absolute.
    """
    charge = _charge(stack, sensor)[best]
    try:
        scale = exposure_scale(charge, stack.target, sensor=sensor, mean_rate=USUAL_RATE)
        title = f"brightness of the pixels at mean_rate {USUAL_RATE:g}"
    except BadInput:  # part of the target is dark, or it is out of sight
        scale, title = 1.0, "brightness of the pixels, absolute exposure"
    dark = sensor.mean_dark_e
    bins = np.geomspace(1e-3, 1, 61)
    for pixels, color, label in ((charge, SOFT, "frame"), (charge[stack.target], BLUE, "target")):
        if pixels.size:
            rate = np.clip(firing_rate(pixels * scale + dark, sensor), bins[0], bins[-1])
            counts, _ = np.histogram(rate, bins=bins)
            axes.stairs(100 * counts / rate.size, bins, color=color, label=label)
    absolute = firing_rate(charge[stack.target] + dark, sensor)
    if absolute.size:
        title += f"\n(target with absolute exposure: {absolute.mean():.2g})"
    axes.set(xscale="log", xlim=(bins[0], bins[-1]), xlabel="spikes per readout", ylabel="pixels, %")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda rate, _: f"{rate:g}"))
    axes.set_title(title)
    hide_spines(axes, "top", "right")
    axes.legend(loc="upper left", frameon=False)
