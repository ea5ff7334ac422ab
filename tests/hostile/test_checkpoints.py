"""Whoever can write into a shared store can write any checkpoint: each is refused in a sentence, before it is built."""

from __future__ import annotations

import subprocess
import sys
import unicodedata

import pytest

from juicer.errors import InvalidCheckpoint
from juicer.policy.checkpoint import load_policy

from .conftest import CHECKPOINTS, REPLAYS

BOMBS = ("a billion", "as wide", "the widest", "exabytes", "gigabyte", "thousands", "nested", "device", "endless")
MEGABYTE = 2**20

WITHIN_LIMITS = """
import resource, sys
from juicer.errors import InvalidCheckpoint
from juicer.policy.checkpoint import load_policy
used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 400 * 2**20,) * 2)
for folder in sys.argv[1:]:
    try:
        load_policy(__import__('pathlib').Path(folder), 'toy')
        raise SystemExit(f'{folder} was taken')
    except InvalidCheckpoint:
        pass
"""


def refusal(folder):
    with pytest.raises(InvalidCheckpoint) as caught:
        load_policy(folder, "toy")
    return str(caught.value)


def check_sentence(text):
    assert len(text) < 1000
    assert not any(unicodedata.category(letter).startswith("C") for letter in text), text
    assert "Traceback" not in text
    assert "\n" not in text


def test_the_checkpoints_are_good_before_they_are_damaged(checkpoint_folder, replay_folder):
    assert load_policy(checkpoint_folder, "toy").action_horizon == 8
    assert load_policy(replay_folder, "toy").action_horizon == 5


def test_there_are_enough_of_them():
    assert len(CHECKPOINTS) + len(REPLAYS) >= 49


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_hostile_checkpoint_is_refused_in_a_sentence(name, checkpoint_folder, damaged):
    check_sentence(refusal(damaged(checkpoint_folder, CHECKPOINTS[name])))


@pytest.mark.parametrize("name", REPLAYS)
def test_hostile_demonstrations_to_replay_are_refused_in_a_sentence(name, replay_folder, damaged):
    check_sentence(refusal(damaged(replay_folder, REPLAYS[name])))


def test_what_would_fill_the_memory_is_refused_within_400_megabytes(checkpoint_folder, damaged):
    bombs = [name for name in CHECKPOINTS if any(word in name for word in BOMBS)]
    folders = [str(damaged(checkpoint_folder, CHECKPOINTS[name])) for name in bombs]
    assert len(folders) > 10
    result = subprocess.run([sys.executable, "-c", WITHIN_LIMITS, *folders], capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
