"""Networks as policies of the closed loop, and the version of a network by its weights."""

import hashlib

import numpy as np
import torch


class NetworkPolicy:
    """A network that commands the lens, for :func:`saf_gen.benchmark.gym.evaluate_policy`.

    Parameters
    ----------
    network : a module. It is called with the observation as tensors, a batch of one, float32: ``image``
        (1, 1, pixels, pixels), ``lens`` (1, 1), ``left`` (1, 1). It returns (1, 2), position and stop, which are
        clipped to 0...1. It is set to evaluate, and no gradients are kept. Make a new policy for each sequence, and a
        network that remembers start anew.
    """

    def __init__(self, network: torch.nn.Module) -> None:
        self.network = network.eval()

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        given = {key: torch.from_numpy(np.asarray(value, np.float32))[None] for key, value in observation.items()}
        given["image"] = given["image"][:, None]
        with torch.inference_mode():
            action = self.network(given)
        return action[0].clamp(0, 1).cpu().numpy()


def digest_weights(network: torch.nn.Module) -> str:
    """Return 12 digits of a SHA-256 over a network's layers and weights: its version in records, ``code=``."""
    sha = hashlib.sha256(repr(network).encode())
    for name, weights in network.state_dict().items():
        values = np.ascontiguousarray(weights.detach().cpu().numpy())
        sha.update(f"\n{name} {values.dtype} {values.shape}\n".encode() + values.tobytes())
    return sha.hexdigest()[:12]
