"""Cameras whose parameters are drawn at random, and their flat fields and dark recordings."""

from dataclasses import fields, replace

import numpy as np

from saf_gen.camera import Sensor, get_sensor
from saf_gen.core.seeds import make_generator
from studies.published_sensors import EncodedRecording, mean_light


def draw_camera(seed: int) -> Sensor:
    """Return a camera like vidar_400x250 with random dark signal, response, thresholds, reset and saturation law."""
    random = make_generator("synthetic camera", seed)

    def between(low, high):
        return float(random.uniform(low, high))

    dead = random.random() < 0.4
    camera = get_sensor(
        "vidar_400x250",
        threshold_e=float(np.exp(between(np.log(3000), np.log(60_000)))),
        saturation="dead_readout" if dead else "subtract",
        reset_loss=0.0 if dead else between(0, 0.05),
        dark_rate=float(np.exp(between(np.log(0.002), np.log(0.01)))),
        dark_log_sd=between(0.3, 0.55),
        dark_hot_fraction=between(0.004, 0.012),
        response_column_rms=between(0.01, 0.06),
        response_row_rms=between(0.01, 0.05),
        response_white_rms=between(0.005, 0.03),
        response_per_dark=between(0, 0.03),
        threshold_spread_rms=between(0.005, 0.03),
        threshold_noise_rms=between(0.004, 0.05),
    )
    return replace(camera, name=f"camera_{seed}")


def flat(sensor: Sensor, rate: float, **options) -> EncodedRecording:
    """Return a recording of even light at a mean rate.

    Options are shape, frames, seed, device, name, a relative picture, and light over time.
    """
    shape = options.get("shape", (48, 64))
    charge = np.full((1, *shape), mean_light(sensor, rate), np.float32) * np.float32(options.get("picture", 1))
    knots = None
    if "light" in options:  # gains at each readout, as knots
        charge = charge * np.array([0, 1], np.float32)[:, None, None]
        gains = options["light"]
        most = gains.max()
        charge *= np.float32(most)

        def knots(readout):
            return np.zeros(readout.size, np.int64), gains[readout] / most

    return EncodedRecording(
        options.get("name", f"flat_{rate:g}.h5"),
        sensor,
        charge,
        frames=options.get("frames", 6000),
        seed=options.get("seed", round(1e4 * rate)),
        knots=knots,
        before=64 if knots is None else 0,
        device_seed=options.get("device", 1),
    )


def dark(sensor: Sensor, **options) -> EncodedRecording:
    """Return a recording without light; options are shape, frames and device."""
    shape, frames = options.get("shape", (48, 64)), options.get("frames", 20_000)
    charge = np.zeros((1, *shape), np.float32)
    return EncodedRecording("dark.h5", sensor, charge, frames=frames, seed=77, device_seed=options.get("device", 1))


def true_numbers(sensor: Sensor) -> dict[str, float]:
    """Return the true values of what a fit estimates: keys of the sensor, and numbers derived from several of them."""
    truth = {f.name: getattr(sensor, f.name) for f in fields(sensor)}
    truth["white_and_threshold_rms"] = float(np.hypot(sensor.response_white_rms, sensor.threshold_spread_rms))
    truth["interval_noise"] = float(np.sqrt(1 / sensor.threshold_e + sensor.threshold_noise_rms**2))
    truth["loss"] = sensor.post_spike_loss
    for name in ("column", "row"):
        parts = truth[f"response_{name}_legendre"]
        truth |= {f"response_{name}_legendre_{degree}": part for degree, part in enumerate(parts, 1)}
        truth[f"{name}_white_rms"] = truth[f"response_{name}_rms"] * np.sqrt(max(1 - sum(parts), 0))
    return {key: value for key, value in truth.items() if isinstance(value, int | float)}
