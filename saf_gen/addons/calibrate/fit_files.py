"""Files of a sensor fit: the sensor with an interval after each value, the estimates as JSON, and a page with plots."""

import io
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from math import floor, isfinite, log10
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from scipy import stats

from saf_gen.addons.calibrate.dark_rates import dark_probabilities
from saf_gen.addons.calibrate.estimates import Estimate
from saf_gen.addons.calibrate.fit_sensor import SensorFit
from saf_gen.addons.calibrate.interval_noise import difference_variance
from saf_gen.addons.calibrate.spike_statistics import LAGS, SERIES_FRAMES
from saf_gen.core.figure_style import COLOURS, STYLE, use_plot_style
from saf_gen.core.files import atomic_file, write_text

MEASURED, LAW = COLOURS[:2]
_STYLE: dict[Any, Any] = {**STYLE, "figure.facecolor": "white", "svg.hashsalt": "fit"}


@dataclass(frozen=True)
class FitPlot:
    """A plot as SVG text, and its caption."""

    svg: str
    caption: str


def draw_fit(fit: SensorFit) -> list[FitPlot]:
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
    p = dark_probabilities(
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
                difference_variance(
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


_COMMENTS = {
    "name": "",
    "rows": "",
    "columns": "",
    "reset": "  # intervals are not whole numbers of readouts",
    "saturation": "  # from intervals at one level against intervals at another, unless a note above says otherwise",
}
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title><style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #1f2328;
background: #ffffff }}
table {{ border-collapse: collapse; font-size: 0.9rem }}
td, th {{ border-bottom: 1px solid #d5d8dc; padding: 0.25rem 0.8rem 0.25rem 0; text-align: left; vertical-align: top }}
td.number {{ font-variant-numeric: tabular-nums; white-space: nowrap }}
.plots {{ display: flex; flex-wrap: wrap; gap: 1rem }} figure {{ margin: 0; max-width: 22rem }}
figcaption {{ font-size: 0.85rem; color: #6b7280 }} svg {{ width: 100%; height: auto }}
</style></head><body>
<h1>{title}</h1>
<p>{lead}</p>
<h2>Notes</h2>
<ul>{notes}</ul>
<h2>Parameters</h2>
<table><tr><th>key</th><th>value</th><th>95 % interval</th><th>source</th></tr>{rows}</table>
<h2>Plots</h2>
<div class="plots">{plots}</div>
</body></html>
"""


FITTED = "Fitted by saf-gen sensors fit"
"""Words by which the file of a fitted sensor is known."""


def fitted_files(name: str) -> tuple[str, str, str, str]:
    """Return the names of the files of a fitted sensor, whose name may have dots; the last one marks bad pixels."""
    return f"{name}.yaml", f"{name}.json", f"{name}.html", f"{name}-mask.npy"


def write_fit(fit: SensorFit, folder: Path) -> list[Path]:
    """Write NAME.yaml, NAME.json and NAME.html into a folder, named after the sensor, and return their paths.

    If there are bad pixels, NAME-mask.npy marks them, bool (rows, columns), as ``saf-gen import --mask`` takes it. An
    older mask of this name is removed otherwise.
    """
    *paths, mask = (folder / file for file in fitted_files(fit.sensor.name))
    texts = dict(
        zip(
            paths,
            (_format_fitted_sensor(fit), _format_fit_json(fit), _format_fit_page(fit, draw_fit(fit))),
            strict=True,
        )
    )
    for path, text in texts.items():
        write_text(path, text)
    if not fit.bad.any():
        mask.unlink(missing_ok=True)
        return list(texts)
    with atomic_file(mask) as part, part.open("wb") as file:
        np.save(file, fit.bad)
    return [*texts, mask]


def fitted_number(value: float, like: float | None = None) -> str:
    """Return a number as text, with as many digits as are significant for an interval of width ``like``.

    The text has 2 to 6 significant digits, or 4 if ``like`` is missing, not positive or not finite.
    """
    if value == 0 or not isfinite(value):
        return "0" if value == 0 else str(value)
    digits = 4
    if like is not None and like > 0 and isfinite(like):
        digits = min(max(floor(log10(abs(value))) - floor(log10(like)) + 2, 2), 6)
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text else text


def fitted_interval(estimate: Estimate) -> str:
    """Return the interval of an estimate as text, such as ``0.01 to 0.02`` or ``at most 0.02``."""
    width = estimate.high - estimate.low
    if width == 0:
        return "–" if not estimate.measured else fitted_number(estimate.value)
    if not isfinite(estimate.high):
        return f"at least {fitted_number(estimate.low)}"
    if estimate.low <= 0:
        return f"at most {fitted_number(estimate.high)}"
    return f"{fitted_number(estimate.low, width)} to {fitted_number(estimate.high, width)}"


def _yaml_number(value: float, estimate: Estimate | None) -> str:
    """Return a number as YAML text with a decimal point, without which YAML reads 1e-5 as text."""
    wide = None if estimate is None or not estimate.measured else estimate.high - estimate.low
    text = fitted_number(float(value), wide)
    mantissa, mark, exponent = text.partition("e")
    return text if not mark or "." in mantissa else f"{mantissa}.0e{exponent}"


def _format_fitted_sensor(fit: SensorFit) -> str:
    """Return the text of a sensor file, with the 95 % interval of each measured number as a comment."""
    recordings = ", ".join(f"{name} ({level:.3g} spikes per readout)" for name, level in fit.levels.items())
    lines = [
        f"# {FITTED} to {recordings} and a dark recording.",
        "# Each comment gives the 95 % interval of a number and its source. Flat fields do not determine the numbers",
        f"# that are only marked as assumed; these are copied from {fit.base}.",
        *(f"# - {note}" for note in fit.notes),
        f"kind: {fit.sensor.kind}",
    ]
    for key, value in fit.sensor.as_dict().items():
        estimate = fit.estimates.get(key)
        if key == "noise":
            inner = ", ".join(f"{name}: {str(on).lower()}" for name, on in value.items())
            lines.append(f"noise: {{{inner}}}")
        elif key == "sources":
            lines += ["sources:", *(f'  - "{source}"' for source in value)]
        elif isinstance(value, list | tuple):
            parts = [fit.estimates.get(f"{key}_{degree}") for degree in range(1, len(value) + 1)]
            intervals = "; ".join(f"{e.low:.3f} to {e.high:.3f}" for e in parts if e is not None)
            values = ", ".join(f"{x:.4g}" for x in value)
            lines.append(f"{key}: [{values}]  # {f'95 %: {intervals}' if intervals else 'assumed'}")
        elif isinstance(value, str | int) and estimate is None:
            lines.append(f"{key}: {value}{_COMMENTS.get(key, '  # assumed')}")
        else:
            lines.append(f"{key}: {_yaml_number(value, estimate)}  # {_describe(key, estimate)}")
    return "\n".join(lines) + "\n"


def _describe(key: str, estimate: Estimate | None) -> str:
    if estimate is None:
        return "from the recordings" if key == "readout_hz" else "assumed"
    if estimate.low == estimate.high:
        return estimate.how
    return f"{'95 %' if estimate.measured else 'not determined;'} {fitted_interval(estimate)}; {estimate.how}"


def _format_fit_json(fit: SensorFit) -> str:
    """Return all estimates with their intervals, the levels and the notes as JSON."""

    def finite(value: float) -> float | None:
        return float(value) if isfinite(value) else None

    estimates = {
        key: {
            "value": finite(e.value),
            "low": finite(e.low),
            "high": finite(e.high),
            "measured": e.measured,
            "from": e.how,
        }
        for key, e in fit.estimates.items()
    }
    document = {"sensor": fit.sensor.name, "base": fit.base, "levels": fit.levels, "estimates": estimates}
    return json.dumps({**document, "notes": list(fit.notes)}, indent=1, ensure_ascii=False) + "\n"


def _format_fit_page(fit: SensorFit, plots: list[FitPlot]) -> str:
    """Return the page with the notes, all estimates with their intervals, and the plots, as HTML."""
    rows = "".join(
        f'<tr><td>{escape(key)}</td><td class="number">{fitted_number(e.value, e.high - e.low)}</td>'
        f'<td class="number">{escape(fitted_interval(e))}</td>'
        f"<td>{escape(e.how)}{'' if e.measured or e.low == e.high else ' (a bound)'}</td></tr>"
        for key, e in fit.estimates.items()
    )
    figures = "".join(f"<figure>{plot.svg}<figcaption>{escape(plot.caption)}</figcaption></figure>" for plot in plots)
    lead = (
        f"{fit.sensor.columns}×{fit.sensor.rows} pixels, {fit.sensor.readout_hz:g} readouts per second; flat fields "
        + ", ".join(f"{name} at {level:.3g} spikes per readout" for name, level in fit.levels.items())
    )
    return _PAGE.format(
        title=f"Sensor {escape(fit.sensor.name)}",
        lead=escape(lead),
        notes="".join(f"<li>{escape(note)}</li>" for note in fit.notes),
        rows=rows,
        plots=figures,
    )
