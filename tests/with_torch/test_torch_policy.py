"""Networks as policies of the closed loop: their input, their records, and their version."""

import numpy as np
import pytest

from saf_gen.benchmark.gym import AutofocusEnv, evaluate_policy
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.optics.actuators import get_actuator

torch = pytest.importorskip("torch", reason="the extra torch is not installed")

PROTOCOL = ClosedLoopProtocol(get_actuator("voice_coil_hall"), budget_s=0.04, sweep_s=0.02)


class Half(torch.nn.Module):
    """A network that goes to half of its weight, and stops when less than half of the budget is left."""

    def __init__(self, weight):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.tensor([weight]))
        self.drop = torch.nn.Dropout(0.99)

    def forward(self, seen):
        assert {key: tuple(value.shape) for key, value in seen.items()} == {
            "image": (1, 1, 16, 16),
            "lens": (1, 1),
            "left": (1, 1),
        }
        assert all(value.dtype == torch.float32 for value in seen.values())
        position = self.drop(self.weight[None] / 2) + 0 * seen["image"].mean()
        return torch.cat([position, 10 * (0.5 - seen["left"])], dim=1)


def test_a_network_commands_the_lens_and_is_a_row_like_any_policy(captured_dataset):
    from saf_gen.torch import NetworkPolicy, digest_weights

    env = AutofocusEnv(captured_dataset, protocol=PROTOCOL, pixels=16, sequences=["plane-constant-00"])
    network = Half(0.8)
    (record,) = evaluate_policy(env, lambda: NetworkPolicy(network), method="half", code=digest_weights(network))
    assert (record.judgement.status, record.judgement.note) == ("answered", "")
    assert record.judgement.position == pytest.approx(0.4, abs=0.01)
    assert record.who.code == digest_weights(Half(0.8))


def test_the_version_of_a_network_is_that_of_its_weights_and_layers():
    from saf_gen.torch import digest_weights

    class Same(Half):
        pass

    versions = [digest_weights(network) for network in (Half(0.8), Half(0.8), Half(0.9), Same(0.8), Half(0.8).double())]
    assert versions[0] == versions[1]
    assert len(set(versions)) == 4
    assert all(len(version) == 12 for version in versions)


def test_actions_outside_the_range_are_clipped():
    from saf_gen.torch import NetworkPolicy

    seen = {"image": np.zeros((16, 16), np.float32), "lens": np.ones(1, np.float32), "left": np.zeros(1, np.float32)}
    action = NetworkPolicy(Half(3.0))(seen)
    assert (action.dtype, action.tolist()) == (np.float32, [1.0, 1.0])
