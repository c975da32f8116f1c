"""Networks as policies of the closed loop, and digests that serve as their versions."""

import hashlib

import numpy as np
import torch


class NetworkPolicy:
    """A network that commands the lens, for :func:`saf_gen.benchmark.gym.evaluate_policy`.

    Create a new policy for each sequence, and reset the network if it keeps state between calls.

    Parameters
    ----------
    network : torch.nn.Module
        Called with the observation as a dict of float32 tensors of batch size 1: ``image`` (1, 1, pixels, pixels),
        ``lens`` (1, 1) and ``left`` (1, 1). It returns a tensor (1, 2) of position and stop, which are clipped to
        0...1. The network is set to evaluation mode and runs without gradients.
    """

    def __init__(self, network: torch.nn.Module) -> None:
        self.network = network.eval()

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        batch = {key: torch.from_numpy(np.asarray(value, np.float32))[None] for key, value in observation.items()}
        batch["image"] = batch["image"][:, None]
        with torch.inference_mode():
            action = self.network(batch)
        return action[0].clamp(0, 1).cpu().numpy()


def digest_weights(network: torch.nn.Module) -> str:
    """Return a digest of a network's layers and weights, which serves as its version in records.

    Pass it as ``code`` to :func:`saf_gen.benchmark.gym.evaluate_policy`.

    Parameters
    ----------
    network : torch.nn.Module
        The network.

    Returns
    -------
    str
        First 12 hexadecimal digits of the SHA-256.
    """
    sha = hashlib.sha256(repr(network).encode())
    for name, weights in network.state_dict().items():
        values = np.ascontiguousarray(weights.detach().cpu().numpy())
        sha.update(f"\n{name} {values.dtype} {values.shape}\n".encode() + values.tobytes())
    return sha.hexdigest()[:12]
