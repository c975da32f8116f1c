"""Files of a sensor fit: a sensor file with an interval after each value, the estimates as JSON, and an HTML page."""

import json
from dataclasses import asdict
from html import escape
from math import floor, isfinite, log10
from pathlib import Path

from saf_gen.calibration.estimates import Estimate
from saf_gen.calibration.fit_plots import FitPlot, draw_sensor_fit_plots
from saf_gen.calibration.fit_sensor import SensorFit
from saf_gen.core.files import write_text_atomically

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


def write_sensor_fit(fit: SensorFit, folder: Path) -> list[Path]:
    """Write NAME.yaml, NAME.json and NAME.html into a folder, named after the sensor, and return their paths."""
    stem = folder / fit.sensor.name
    texts = {
        stem.with_suffix(".yaml"): _format_fitted_sensor(fit),
        stem.with_suffix(".json"): _format_fit_json(fit),
        stem.with_suffix(".html"): _format_fit_page(fit, draw_sensor_fit_plots(fit)),
    }
    for path, text in texts.items():
        write_text_atomically(path, text)
    return list(texts)


def format_fitted_number(value: float, like: float | None = None) -> str:
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


def format_fitted_interval(estimate: Estimate) -> str:
    """Return the interval of an estimate as text, such as ``0.01 to 0.02`` or ``at most 0.02``."""
    width = estimate.high - estimate.low
    if width == 0:
        return "–" if not estimate.measured else format_fitted_number(estimate.value)
    if not isfinite(estimate.high):
        return f"at least {format_fitted_number(estimate.low)}"
    if estimate.low <= 0:
        return f"at most {format_fitted_number(estimate.high)}"
    return f"{format_fitted_number(estimate.low, width)} to {format_fitted_number(estimate.high, width)}"


def _yaml_number(value: float, estimate: Estimate | None) -> str:
    """Return a number as YAML text with a decimal point, without which YAML reads 1e-5 as text."""
    wide = None if estimate is None or not estimate.measured else estimate.high - estimate.low
    text = format_fitted_number(float(value), wide)
    mantissa, mark, exponent = text.partition("e")
    return text if not mark or "." in mantissa else f"{mantissa}.0e{exponent}"


def _format_fitted_sensor(fit: SensorFit) -> str:
    """Return the text of a sensor file, with the 95 % interval of each measured number as a comment."""
    recordings = ", ".join(f"{name} ({level:.3g} spikes per readout)" for name, level in fit.levels.items())
    lines = [
        f"# Fitted by saf-gen sensors fit to {recordings} and a dark recording.",
        "# Each comment gives the 95 % interval of a number and its source. Flat fields do not determine the numbers",
        f"# that are only marked as assumed; these are copied from {fit.base}.",
        *(f"# - {note}" for note in fit.notes),
    ]
    for key, value in asdict(fit.sensor).items():
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
    return f"{'95 %' if estimate.measured else 'not determined;'} {format_fitted_interval(estimate)}; {estimate.how}"


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
        f'<tr><td>{escape(key)}</td><td class="number">{format_fitted_number(e.value, e.high - e.low)}</td>'
        f'<td class="number">{escape(format_fitted_interval(e))}</td>'
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
