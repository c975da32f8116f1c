"""Plots of a sensor fit: measurements and the fitted laws."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from scipy import stats

from saf_gen.calibration.dark_rates import fitted_dark_probabilities
from saf_gen.calibration.fit_sensor import SensorFit
from saf_gen.calibration.interval_noise import fitted_difference_variance
from saf_gen.calibration.spike_kernel import LAGS
from saf_gen.calibration.spike_statistics import SERIES_FRAMES
from saf_gen.core.figure_style import COLOURS, STYLE, use_plot_style

MEASURED, LAW = COLOURS[:2]
_STYLE: dict[Any, Any] = {**STYLE, "figure.facecolor": "white", "svg.hashsalt": "fit"}


@dataclass(frozen=True)
class FitPlot:
    """A plot as SVG text, and its caption."""

    svg: str
    caption: str


def draw_sensor_fit_plots(fit: SensorFit) -> list[FitPlot]:
    """Return the plots of a fit, in the order in which the page shows them."""
    plots: list[tuple[str, str, Callable[[Axes, SensorFit], None]]] = [
        ("Response map", "Response divided by threshold, relative to the mean; grey: unknown.", _response),
        (
            "Columns",
            "Relative profile of the columns, without the first column.",
            lambda a, f: _profile(a, f.pattern.columns, name="column"),
        ),
        (
            "Rows",
            "Relative profile of the rows, without the first row.",
            lambda a, f: _profile(a, f.pattern.rows, name="row"),
        ),
        ("White rest", "Response without profiles and dark charge, and a normal law of equal robust rms.", _rest),
        ("Dark", "Number of pixels by spikes in the dark, and the fitted law.", _dark),
        ("Noise of intervals", "Variance of second differences by lag, and the law with the fitted noise.", _noise),
        (
            "Linearity",
            "Ratio of the rates at the brightest and the darkest level: deviation from the law, by response.",
            _line,
        ),
    ]
    if any(v.light is not None for v in fit.variations.values()):
        plots.append(("Light", "Mean of all pixels over time, if it varied beyond noise.", _light))
    drawn = []
    with use_plot_style(_STYLE):
        for title, caption, draw in plots:
            figure = Figure(figsize=(4.4, 3.0), dpi=72, layout="constrained")
            FigureCanvasSVG(figure)
            axes = figure.add_subplot()
            axes.set_title(title, loc="left", fontsize=9.5, fontweight="bold")
            draw(axes, fit)
            _write_powers_as_numbers(axes)
            buffer = io.StringIO()
            figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
            text = buffer.getvalue()
            text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
            for found in set(re.findall(r' id="([^"]+)"', text)):  # ids must be unique within the page of all plots
                text = re.sub(rf'(id="|#){re.escape(found)}(?=["\)])', rf"\g<1>{title.replace(' ', '')}-{found}", text)
            drawn.append(FitPlot(text, caption))
    return drawn


def _write_powers_as_numbers(axes: Axes) -> None:
    """Label logarithmic axes with plain numbers: mathtext is switched off, because names may contain a dollar sign."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != "linear":
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())


def _response(axes: Axes, fit: SensorFit) -> None:
    shown = fit.response.response
    low, high = np.nanquantile(shown, [0.005, 0.995])
    axes.set_facecolor("#d5d8dc")
    image = axes.imshow(shown, vmin=low, vmax=high, cmap="viridis", interpolation="nearest")
    axes.figure.colorbar(image, ax=axes, shrink=0.8)


def _profile(axes: Axes, profile: np.ndarray, *, name: str) -> None:
    axes.plot(
        np.arange(1, profile.size), 100 * profile[1:], color=MEASURED, lw=0.9
    )  # the first line is fitted separately
    axes.set_xlabel(name)
    axes.set_ylabel("deviation from the mean, %")


def _rest(axes: Axes, fit: SensorFit) -> None:
    inner = fit.pattern.rest[1:, 1:]
    rest = 100 * inner[np.isfinite(inner)]
    width = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    if not width > 0:
        return
    edges = np.linspace(-12 * width, 12 * width, 121)
    axes.stairs(np.histogram(np.clip(rest, edges[0], edges[-1]), edges)[0], edges, color=MEASURED, label="pixels")
    middle = (edges[1:] + edges[:-1]) / 2
    law = stats.norm.pdf(middle, scale=width) * rest.size * (edges[1] - edges[0])
    axes.plot(middle[law > 0.3], law[law > 0.3], color=LAW, ls=(0, (5, 1.5)), label="normal law")
    axes.set_yscale("log")
    axes.set_xlabel("deviation from profiles and dark, %")
    axes.legend()


def _dark(axes: Axes, fit: SensorFit) -> None:
    counts = fit.dark.counts.ravel()
    frames = fit.dark.shape[0]
    edges = np.unique(np.concatenate([[0], np.round(np.geomspace(1, counts.max() + 2, 50))])).astype(int)
    axes.stairs(np.histogram(counts, edges - 0.5)[0] / np.diff(edges), edges - 0.5, color=MEASURED, label="pixels")
    found = fit.dark_fit
    tail = float(stats.norm.sf(np.log(fit.sensor.dark_hot_factor) / found.log_sd.value))
    p = fitted_dark_probabilities(
        np.arange(edges[-1]),
        median=found.median * frames,
        log_sd=found.log_sd.value,
        extra=max(0.0, (found.hot_fraction.value - tail) / (1 - tail)),
        factor=fit.sensor.dark_hot_factor,
        exponent=fit.sensor.dark_hot_exponent,
    )
    law = np.maximum(p * counts.size, 0)
    axes.plot(np.arange(edges[-1])[law > 1e-2], law[law > 1e-2], color=LAW, ls=(0, (5, 1.5)), label="fitted law")
    axes.set_xscale("symlog")
    axes.set_yscale("log")
    axes.set_xlabel(f"spikes in {frames} readouts")
    axes.legend()


def _noise(axes: Axes, fit: SensorFit) -> None:
    noise = fit.estimates["interval_noise"].value ** 2
    loss = fit.response.loss.value if fit.response.loss is not None else fit.sensor.post_spike_loss
    for at, (name, found) in enumerate(fit.flats.items()):
        used = (found.counts >= 16) & np.isfinite(found.interval)
        numbers, squares = found.numbers[used], found.squares[used]
        lags = [lag for lag in range(LAGS) if numbers[:, lag].sum() >= 100]
        measured = [squares[:, lag].sum() / numbers[:, lag].sum() for lag in lags]
        law = [
            np.average(
                fitted_difference_variance(
                    found.interval[used], noise, lag=1 << lag, loss=loss, stretch=fit.variations[name].stretch
                ),
                weights=numbers[:, lag],
            )
            for lag in lags
        ]
        axes.plot([1 << lag for lag in lags], measured, "osD^vPX*"[at % 8], color=MEASURED, ms=4, label=name)
        axes.plot([1 << lag for lag in lags], law, color=LAW, ls=(0, (5, 1.5)), lw=1)
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xlabel("lag, spikes")
    axes.set_ylabel("variance, readouts²")
    axes.legend()


def _line(axes: Axes, fit: SensorFit) -> None:
    names = sorted(fit.levels, key=lambda n: fit.levels[n])
    if len(names) < 2:
        axes.text(0.5, 0.5, "one level", ha="center", va="center", transform=axes.transAxes)
        return
    loss = fit.response.loss.value if fit.response.loss is not None else 0.0
    dark = fit.dark.rates
    with np.errstate(invalid="ignore", divide="ignore"):
        light = [1 / (fit.flats[n].interval - loss) - dark for n in (names[0], names[-1])]
        off = light[1] / light[0] / (fit.levels[names[-1]] / fit.levels[names[0]]) - 1
    use = np.isfinite(off) & np.isfinite(fit.response.response)
    response = fit.response.response[use]
    edges = np.quantile(response, np.linspace(0, 1, 21))
    index = np.clip(np.searchsorted(edges, response) - 1, 0, 19)
    number = np.bincount(index, minlength=20)
    mean = np.bincount(index, off[use], minlength=20) / np.maximum(number, 1)
    spread = np.sqrt(np.bincount(index, (off[use] - mean[index]) ** 2, minlength=20)) / np.maximum(number, 1)
    middle = (edges[1:] + edges[:-1]) / 2
    axes.errorbar(middle, 100 * mean, 100 * 1.96 * spread, fmt="o", color=MEASURED, ms=3, lw=1)
    axes.axhline(0, color=LAW, ls=(0, (5, 1.5)), lw=1)
    axes.set_xlabel("response relative to the mean")
    axes.set_ylabel(f"{names[-1]} / {names[0]}, deviation from the law, %")


def _light(axes: Axes, fit: SensorFit) -> None:
    for name, variation in fit.variations.items():
        if variation.light is not None:
            axes.plot(np.arange(variation.light.size) * SERIES_FRAMES, variation.light, lw=0.7, label=name)
    axes.set_xlabel("readout")
    axes.set_ylabel("light relative to its mean")
    axes.legend()
