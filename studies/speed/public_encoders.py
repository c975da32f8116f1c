"""Encoders of public spike-camera toolkits, rewritten as algorithms against which ours is timed.

Each follows its source: complete images in numpy, or a loop over pixels if the source has one. Steps that do not belong
to encoding are left out in their favour: opening and decoding image files, intermediate files, and progress lines.
``python -m studies.speed encode`` runs them.

All take grey images uint8 (frames, row, col), one per readout, and a numpy Generator, and return spikes
(frames, row, col), 0 or 1. None interpolates between images.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["ENCODERS", "PublicEncoder", "image_to_spikes", "simulate", "simulate_pixel_by_pixel", "video_to_spikes"]

GREYS = 255.0


@dataclass(frozen=True)
class PublicEncoder:
    """A named encoder, which is timed on ``slower`` times fewer frames than the fastest."""

    name: str
    run: Callable[[np.ndarray, np.random.Generator], np.ndarray]
    slower: int = 1


def image_to_spikes(image: np.ndarray, frames: int, *, gain: float = 0.5, threshold: float = 1.0) -> np.ndarray:
    """Return the spikes of a still image, float64 (frames, row, col); ``image`` is float64, 0 to 1.

    Every readout adds gain·image to the charge of a pixel; a pixel that reaches the threshold fires and is set to 0,
    whatever its charge. Its period is therefore an integer number of readouts, ⌈threshold/(gain·image)⌉, and the rate
    as a function of light is a staircase. There is neither noise nor an initial phase.

    References
    ----------
    SpikeCV, ``spkData/convert_img.py``, ``img_to_spike`` of Zyj061/SpikeCV; Y. Zheng et al., SpikeCV: open a continuous
    computer vision era, arXiv:2303.11684.
    """
    held = np.zeros_like(image)
    spikes = np.zeros((frames, *image.shape))
    for t in range(frames):
        held += gain * image
        fired = held >= threshold
        held = held * (1 - fired)
        spikes[t] = fired
    return spikes


def video_to_spikes(video: np.ndarray, random: np.random.Generator, *, threshold: float = 5.0) -> np.ndarray:
    """Return the spikes of a video, one image per readout, uint8 (frames, row, col).

    A pixel starts at a random phase, adds the grey value of the image (0 to 1), fires at the threshold and loses
    exactly the threshold, so its mean rate is grey/threshold. There is no other noise.

    References
    ----------
    SpikeCV, ``spkData/convert_video.py``, ``video_to_spike`` of Zyj061/SpikeCV; Y. Zheng et al., arXiv:2303.11684.
    """
    held = random.random(video.shape[1:]) * threshold
    spikes = np.zeros(video.shape, np.uint8)
    for t, picture in enumerate(video):
        held += picture / GREYS
        fired = np.nonzero(held >= threshold)
        held[fired] -= threshold
        spikes[t][fired] = 1
    return spikes


# Measurements of SCSim on a camera: voltages (V), capacitance (fF), dark current, and their spread over pixels.
SWING, SWING_OFFSET, SWING_SD = 1.1, -0.0076, 0.0497
CAPACITANCE, CAPACITANCE_SD = 4.348, 0.0128
DARK, DARK_SD = 0.4442, 0.1731
RESPONSE, RESPONSE_SD = 1.0128, 0.0584
THERMAL_SD, SHOT_SD = 9.644e-9, 0.00636  # noise of the threshold voltage, drawn for every pixel and readout
READOUT = 0.05  # milliseconds
PHOTONS = 50_000  # mean of the Poisson draw at full grey
AFTER_RESET = 0.998  # fraction of its charge that a pixel collects in the readout after a spike
FULL = CAPACITANCE * (SWING + SWING_OFFSET)  # charge per readout at full grey, which gives one spike


def _device(shape: tuple[int, int], random: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return random dark current, response, capacitance and voltage swing of every pixel."""
    return (
        random.normal(DARK, DARK_SD, shape),
        random.normal(RESPONSE, RESPONSE_SD, shape) / RESPONSE,
        random.normal(CAPACITANCE, CAPACITANCE_SD, shape),
        SWING + random.normal(SWING_OFFSET, SWING_SD, shape),
    )


def simulate_pixel_by_pixel(video: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return spikes with noise, uint8 (frames, row, col), from three random draws per pixel and readout.

    A pixel adds its dark current, and its grey value times a Poisson count over the mean of that count. It fires if its
    charge reaches capacitance·(swing + new noise), loses that charge, and loses 0.2 % of the next readout. The second,
    noise-free stream of the source is left out.

    References
    ----------
    SCSim, ``v2s.py`` of Acnext/SCSim, a loop over pixels in Python; L. Hu et al., SCSim: a realistic spike cameras
    simulator, ICME 2024, arXiv:2405.16790.
    """
    frames, rows, columns = video.shape
    dark, response, capacitance, swing = _device((rows, columns), random)
    held = random.random((rows, columns))
    after_spike = np.zeros((rows, columns), bool)
    spikes = np.zeros(video.shape, np.uint8)
    for t in range(frames):
        for y in range(rows):
            for x in range(columns):
                grey = video[t, y, x] / GREYS
                photons = int(PHOTONS * grey)
                shot = random.poisson(photons) / photons if photons else 0.0
                charge = READOUT * dark[y, x] + shot * FULL * grey * response[y, x]
                if after_spike[y, x]:
                    charge *= AFTER_RESET
                held[y, x] += charge
                noise = random.normal(0.0, THERMAL_SD) + random.normal(0.0, SHOT_SD)
                threshold = capacitance[y, x] * (swing[y, x] + noise)
                after_spike[y, x] = fired = held[y, x] >= threshold
                if fired:
                    held[y, x] -= threshold
                    spikes[t, y, x] = 1
    return spikes


def simulate(video: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return spikes as ``simulate_pixel_by_pixel`` does, computed on complete images instead of pixel by pixel.

    This version was never published; it is here so that our encoder is not compared only with a slow Python loop.
    """
    shape = video.shape[1:]
    dark, response, capacitance, swing = _device(shape, random)
    held = random.random(shape)
    collected = np.ones(shape)
    spikes = np.zeros(video.shape, np.uint8)
    for t, picture in enumerate(video):
        grey = picture / GREYS
        photons = np.floor(PHOTONS * grey)
        shot = random.poisson(photons) / np.maximum(photons, 1.0)
        held += collected * (READOUT * dark + shot * FULL * grey * response)
        noise = random.normal(0.0, THERMAL_SD, shape) + random.normal(0.0, SHOT_SD, shape)
        threshold = capacitance * (swing + noise)
        fired = held >= threshold
        held -= np.where(fired, threshold, 0.0)
        collected = np.where(fired, AFTER_RESET, 1.0)
        spikes[t] = fired
    return spikes


ENCODERS = (
    PublicEncoder(
        "SpikeCV's image to spikes, no noise",
        lambda video, random: image_to_spikes(2 * video[0] / GREYS, len(video)),  # gain is a half
    ),
    PublicEncoder(
        "SpikeCV's video to spikes, no noise", lambda video, random: video_to_spikes(video, random, threshold=1.0)
    ),
    PublicEncoder("SCSim's simulator made whole pictures in numpy, noise", simulate, slower=10),
    PublicEncoder("SCSim's simulator as published, pixel by pixel, noise", simulate_pixel_by_pixel, slower=100),
)
