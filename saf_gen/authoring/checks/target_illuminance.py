"""Exposure: does each light group light the target, and how many lux does it give at gain 1?"""

from collections.abc import Iterator

import numpy as np

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_error, scene_check_ok, scene_check_warning
from saf_gen.authoring.checks.scene_under_test import SceneUnderTest
from saf_gen.camera.exposure import firing_rate
from saf_gen.core.config.ranges import is_range

LUMENS_PER_WATT = 683.0
"""Luminous efficacy of light of 555 nm, by the definition of the candela. All light is assumed to have the wavelength
at which the sensors convert it to electrons, so that lux and electrons correspond."""
TOLERANCE, FAMILY_TOLERANCE = 0.1, 0.3  # of the card's value, which is a mean for a family
DARKEST, BRIGHTEST = 0.1, 2e5  # lux: the light of the full moon, and more than the light of the sun at noon
MAX_DARK_FRACTION = 0.05


def check_exposure(subject: SceneUnderTest) -> Iterator[SceneFinding]:
    """Compare the illuminance of the target by each light group with the card, and look for dark pixels."""
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
            yield scene_check_error(
                "exposure", f"light group {group!r} does not reach the target: move its lamps, or remove it"
            )
    written = "illuminance_lux: {" + ", ".join(f"{g}: {float(f'{v:.3g}'):g}" for g, v in lux.items()) + "}"
    tolerance = FAMILY_TOLERANCE if any(is_range(value) for value in card.params.values()) else TOLERANCE
    wrong = [g for g, stated in card.illuminance_lux.items() if abs(lux[g] - stated) > tolerance * stated]
    total = sum(lux.values())
    if wrong:
        yield scene_check_warning(
            "exposure",
            f"the target receives {lux[wrong[0]]:,.3g} lux from {wrong[0]!r}, the card says "
            f"{card.illuminance_lux[wrong[0]]:,g}: write {written}",
        )
    elif not DARKEST <= total <= BRIGHTEST:
        yield scene_check_warning(
            "exposure", f"a total of {total:,.3g} lux is implausible (moonlight 0.1, sun 100,000): change the lamps"
        )
    else:
        hint = "as the card says" if card.illuminance_lux else "add this to the card for schedules in lux"
        yield scene_check_ok("exposure", f"{written}, {hint}")
    yield _check_absolute_exposure(subject)


def _check_absolute_exposure(subject: SceneUnderTest) -> SceneFinding:
    stack = subject.near_stacks[0]
    best = int(np.abs(stack.spec.focus - subject.true_focus).argmin())
    charge = subject.collected_charge(stack)[best][stack.target]
    dark = float(np.mean(charge <= 0))
    rate = float(np.mean(firing_rate(charge + subject.sensor.mean_dark_e, subject.sensor)))
    text = f"with absolute exposure the target fires {rate:.3g} spikes per readout"
    if dark > MAX_DARK_FRACTION:
        return scene_check_warning(
            "exposure", f"{dark:.0%} of the target is completely dark: light it from another side"
        )
    if rate > 0.9:
        text += ": almost saturated, use mean_rate in recipes"
    return scene_check_ok("exposure", text)
