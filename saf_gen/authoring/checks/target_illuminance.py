"""Exposure: does each light group light the target, and how many lux is gain 1?"""

from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, error, ok, warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.camera.exposure import mean_firing_rate
from saf_gen.core.config.ranges import is_range

__all__ = ["LUMENS_PER_WATT", "check_exposure"]

LUMENS_PER_WATT = 683.0
"""Of light of 555 nm, by the definition of the candela. The project's light has one wavelength, that at which
its sensors turn light to electrons: so lux and electrons belong together."""
AGREES, FAMILY_AGREES = 0.1, 0.3  # of the card's own value; for a family it is a mean
DARKEST, BRIGHTEST = 0.1, 2e5  # lux: full moon, more than the sun at noon
DARK_SHARE = 0.05


def check_exposure(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Illuminance of the target by each group, against the card; what part of the target stays dark."""
    card = subject.scene.card
    lux = {
        group: LUMENS_PER_WATT
        * subject.renderer.estimate_irradiance(
            group, position=subject.true_focus, target=subject.depth_and_target.target
        )[0]
        for group in card.lights
    }
    for group, value in lux.items():
        if not value > 0:
            yield error(
                "exposure",
                f"light group {group!r} does not reach the target: move its lamps, or remove it",
            )
    written = "illuminance_lux: {" + ", ".join(f"{g}: {float(f'{v:.3g}'):g}" for g, v in lux.items()) + "}"
    agrees = FAMILY_AGREES if any(is_range(value) for value in card.params.values()) else AGREES
    wrong = [g for g, said in card.illuminance_lux.items() if abs(lux[g] - said) > agrees * said]
    total = sum(lux.values())
    if wrong:
        yield warning(
            "exposure",
            f"the target receives {lux[wrong[0]]:,.3g} lux from {wrong[0]!r}, the card says "
            f"{card.illuminance_lux[wrong[0]]:,g}: write {written}",
        )
    elif not DARKEST <= total <= BRIGHTEST:
        yield warning(
            "exposure",
            f"{total:,.3g} lux in all are hardly physical (moonlight 0.1, sun 100,000): change the lamps",
        )
    else:
        hint = "as the card says" if card.illuminance_lux else "on the card this serves schedules in lux"
        yield ok("exposure", f"{written}, {hint}")
    yield from _on_the_sensor(subject)


def _on_the_sensor(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    stack = subject.near_stacks[0]
    best = int(np.abs(stack.spec.focus - subject.true_focus).argmin())
    charge = subject.collected_charge(stack)[best][stack.target]
    dark = float(np.mean(charge <= 0))
    rate = float(np.mean(mean_firing_rate(charge + subject.sensor.mean_dark_e, subject.sensor)))
    text = f"with absolute exposure the target fires {rate:.3g} spikes a readout"
    if dark > DARK_SHARE:
        yield warning(
            "exposure", f"{dark:.0%} of the target gives no light at all: light it from another side"
        )
    elif rate > 0.9:
        yield ok("exposure", f"{text}: almost saturated, recipes had better say mean_rate")
    else:
        yield ok("exposure", text)
