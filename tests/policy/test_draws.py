"""Samples get the same random numbers, however many processes share their batch."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

from juicer.policy import draws
from juicer.policy.draws import Dropout, Part, drawing_for

ROOT = Path(__file__).parents[2]
CPU = torch.device("cpu")
PARTS = (Part(0, 3, 8), Part(3, 5, 8))

DRAWS = {
    "randn": lambda size: draws.randn((size, 2, 3), CPU),
    "rand": lambda size: draws.rand((size, 1), CPU),
    "randint": lambda size: draws.randint(100, (size,), CPU),
    "two rows a sample": lambda size: draws.randn((2 * size, 3), CPU),
    "dropout": lambda size: Dropout(0.5)(torch.ones(size, 7)),
}


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS.keys())
def test_parts_of_a_batch_draw_what_the_whole_does(draw):
    torch.manual_seed(0)
    whole, after = draw(8), torch.rand(1)
    found = []
    for part in PARTS:
        torch.manual_seed(0)
        with drawing_for(part):
            found.append(draw(part.size))
        assert torch.equal(torch.rand(1), after)
    assert torch.equal(torch.cat(found), whole)


def test_dropout_drops_nothing_when_a_policy_acts():
    with drawing_for(PARTS[0]):
        assert torch.equal(Dropout(0.5).eval()(torch.ones(3, 7)), torch.ones(3, 7))


def test_networks_draw_nowhere_else():
    random = re.compile(r"torch\.(rand|normal|bernoulli|multinomial)|(nn|functional)\.\w*[Dd]ropout")
    for path in (ROOT / "juicer" / "policy").rglob("*.py"):
        if path.name != "draws.py" and (found := random.search(path.read_text().replace("torch.random.fork_rng", ""))):
            pytest.fail(f"{path}: {found[0]} ignores that processes may share a batch; use juicer.policy.draws")
