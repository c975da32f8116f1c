"""Recordings of a still picture by an ideal spike camera, and files of them in the layouts of other software."""

import numpy as np
from scipy.ndimage import gaussian_filter


def make_picture(rows, columns, *, low=0.05, high=0.4, smooth=4.0, seed=1):
    """Rates of a smooth random texture, ``smooth`` pixels wide, from ``low`` to ``high`` spikes per readout."""
    texture = gaussian_filter(np.random.default_rng(seed).standard_normal((rows, columns)), smooth)
    return low + (high - low) * (texture - texture.min()) / np.ptp(texture)


def fire(rate, frames, *, seed=2):
    """Spikes (frames, H, W) of pixels that integrate the rate, with 2 % of noise and a random first phase."""
    random = np.random.default_rng(seed)
    charge = random.random(rate.shape)
    spikes = np.empty((frames, *rate.shape), np.uint8)
    for frame in spikes:
        charge += rate + 0.02 * np.sqrt(rate) * random.standard_normal(rate.shape)
        frame[:] = charge >= 1
        charge -= frame
    return spikes


def write_dense(path, spikes, *, bitorder="little"):
    np.packbits(spikes.reshape(len(spikes), -1), axis=1, bitorder=bitorder).tofile(path)


def write_416(path, spikes, *, bitorder="little"):
    write_dense(path, np.pad(spikes, ((0, 0), (0, 0), (0, 416 - spikes.shape[2]))), bitorder=bitorder)


def write_sps1000(path, spikes, *, bitorder="little"):
    halves = np.pad(spikes.reshape(len(spikes), 1000, 2, 500), ((0, 0), (0, 0), (0, 0), (0, 12)))
    write_dense(path, halves, bitorder=bitorder)
