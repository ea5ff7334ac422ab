import numpy as np
import pytest
import torch

from juicer.policy.config import HorizonConfig, PolicyConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import build_policy
from juicer.training.table import WindowTable
from juicer.training.validation import validate
from juicer.training.windows import cut_windows


class Displaced(torch.nn.Module):
    """A network that knows the answer, and aims beside it by a known amount."""

    def __init__(self, network, table, offset):
        super().__init__()
        self.inner, self.table, self.offset, self.config = network, table, torch.tensor(offset), network.config

    def compute_loss(self, prepared, chunk):
        return self.inner.compute_loss(prepared, chunk)

    def act(self, prepared, proprioception, noise):
        rows = torch.cat([torch.where((self._current == p).all(-1))[0][:1] for p in proprioception])
        return self.table.recorded(rows)[0] + self.offset

    @property
    def _current(self):
        return self.table.recorded(torch.arange(len(self.table)))[1]


@pytest.fixture
def setting(episodes, spec):
    return make_setting(episodes, spec, learn_padding=True)


def make_setting(episodes, spec, *, learn_padding):
    config = PolicyConfig(head=MLPHeadConfig(width=8, blocks=1), horizons=HorizonConfig(pred=8, action=4))
    network, data = build_policy(config, {"toy": spec}, seed=0), episodes()
    windows = cut_windows(data.episode_ends, np.arange(5), config.horizons, back_padding=7)
    table = WindowTable(data, windows, network, learn_padding, device=torch.device("cpu"))
    table.fit()
    table.normalize()
    return network, table


def test_errors_are_in_the_units_of_their_names(setting):
    network, table = setting
    metrics = validate(Displaced(network, table, [0.003, 0.004, 0, *[0.0] * 7]), table)
    assert metrics["validation/position_error_mm"] == pytest.approx(5, abs=1e-3)
    assert metrics["validation/rotation_error_deg"] == pytest.approx(0, abs=1e-2)
    assert metrics["validation/gripper_accuracy"] == 1


def test_a_gripper_that_does_the_opposite_is_never_right(setting):
    network, table = setting
    flipped = Displaced(network, table, [0.0] * 10)
    flipped.act = lambda *arguments: Displaced.act(flipped, *arguments) * torch.tensor([1.0] * 9 + [-1.0])
    assert validate(flipped, table)["validation/gripper_accuracy"] == 0


def test_validating_twice_gives_the_same_numbers_and_moves_no_random_state(setting):
    network, table = setting
    torch.manual_seed(0)
    first = validate(network, table)
    drawn = torch.rand(1)
    torch.manual_seed(0)
    assert torch.equal(drawn, torch.rand(1))
    assert validate(network, table) == first


def test_dropout_is_off_during_validation_and_on_again_after(setting):
    network, table = setting
    network.train()
    validate(network, table)
    assert network.training


def test_actions_that_are_not_learned_do_not_count(episodes, spec):
    network, table = make_setting(episodes, spec, learn_padding=False)
    is_padding = 1 - table.gather(torch.arange(len(table))).weight
    assert is_padding.any()
    knowing = Displaced(network, table, [0.0] * 10)

    def wrong_beyond_the_end(prepared, proprioception, noise):
        rows = torch.cat([torch.where((knowing._current == p).all(-1))[0][:1] for p in proprioception])
        return table.recorded(rows)[0] + is_padding[rows]

    knowing.act = wrong_beyond_the_end
    assert validate(knowing, table)["validation/position_error_mm"] == pytest.approx(0, abs=1e-3)
