"""The twin of the event camera in studies/laws: a closed form of its own, and its comparison with the camera."""

import numpy as np
import pytest

from studies.laws.event_twin import make_events
from studies.laws.events import PLACES
from studies.laws.run import LAWS

pytestmark = pytest.mark.slow

CONTRASTS = np.array([-1.1, -0.3, 0.1, 0.5, 0.9, 1.7])
ON, OFF = 0.2, 0.25


@pytest.mark.parametrize("receptor", [{}, {"charge_e": 80.0, "receptor_s": 5e-5}])
def test_a_slow_exponential_change_has_as_many_events_as_thresholds_fit_into_it(receptor):
    """Through a photoreceptor of Q = 80 electrons, light of 1e6 electrons per second is followed within 0.2 ms."""
    light = 1e6 * np.exp(CONTRASTS * np.linspace(0, 1, 401)[:, None])[:, None]
    events = make_events(light, seconds=1.0, on=ON, off=OFF, step_s=1e-4, **receptor)
    falls, rises = (np.bincount(events.pixel[events.rise == rise], minlength=6) for rise in (False, True))
    assert rises.tolist() == [max(int(contrast / ON), 0) for contrast in CONTRASTS]
    assert falls.tolist() == [max(int(-contrast / OFF), 0) for contrast in CONTRASTS]
    expected = ON / CONTRASTS[5] * np.arange(1, 9)
    np.testing.assert_allclose(np.sort(events.t[events.pixel == 5]), expected, atol=3e-4)


@pytest.mark.parametrize("reset_s", [5e-5, 0.0101])
def test_each_reset_delays_the_events_after_it_by_its_length(reset_s):
    """In light whose logarithm rises by 2 a second; a reset may be shorter or longer than a step of 0.2 ms."""
    light = 1e5 * np.exp(2.0 * np.linspace(0, 1, 1001))[:, None, None]
    events = make_events(light, seconds=1.0, on=ON, off=OFF, refractory_s=reset_s, step_s=2e-4)
    number = np.arange(1, 10)
    np.testing.assert_allclose(events.t[:9], number * ON / 2.0 + (number - 1) * reset_s, atol=1e-5)


def test_the_camera_has_the_events_of_its_twin_and_a_valley_at_the_focus():
    """Two cameras, falls and rises, then the rates around the focus; without noise, and the picture's seed is fixed."""
    found = LAWS["events_twin"].check(None, True)
    counts, rates = found.comparisons[:4], found.comparisons[4:-1]
    assert [one.what for one in rates] == [f"rate at a defocus of {place:g}" for place in PLACES]
    assert min(one.expected for one in counts) > 2000
    assert all(abs(one.measured / one.expected - 1) <= 0.005 for one in counts), counts
    assert all(abs(one.measured / one.expected - 1) <= 0.05 for one in rates), rates
    assert rates[2].measured < 0.3 * min(rates[0].measured, rates[4].measured)
    assert found.outcome == "passed"
