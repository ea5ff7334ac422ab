"""Shifts as data: what may be said of them, and what an episode's seed makes of them."""

from __future__ import annotations

import inspect

import pytest

from flows.command.cli import evaluate
from juicer.errors import ConfigError
from juicer.shifts import KINDS, Friction, Light, Outside, Push, ShiftOfEpisode, parse_shift
from juicer.tasks.specification import Randomness


@pytest.mark.parametrize("kind", KINDS)
def test_the_mere_kind_stands_for_its_defaults_and_is_told_in_words(kind: str):
    shift = parse_shift(kind)
    assert shift is not None
    assert shift == parse_shift({"kind": kind}) == parse_shift(f"{{kind: {kind}}}")
    assert shift.kind == kind
    assert shift.phrase


def test_the_command_line_names_every_kind():
    told = inspect.signature(evaluate, eval_str=True).parameters["shift"].annotation.__metadata__[0].help
    assert all(kind in told for kind in KINDS)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("pusch", "kind must be one of outside, push, friction, light, camera, .*did you mean 'push'"),
        ({"kind": "friction", "factor": 99}, "shift.factor: must be at most 10, got 99"),
        ({"kind": "outside", "wider": 1.0}, "shift.wider: must be at least 1.1, got 1.0"),
        ({"kind": "light", "brightness": float("nan")}, "shift.brightness: must be a finite number"),
        ({"kind": "camera", "shift": 1}, "unknown key 'shift.shift'; did you mean 'shift_m'"),
        ({"kind": "push", "earliest": 0.5}, "earliest must not exceed latest, got 0.5 and 0.3"),
        ({"factor": 1.0}, "must say its 'kind'"),
        ("[1", "cannot be read: line 1"),
        (3, "must hold keys and values, got 3"),
    ],
)
def test_what_is_no_shift_is_refused_with_a_sentence(given: object, sentence: str):
    with pytest.raises(ConfigError, match=sentence):
        parse_shift(given)


def test_stored_layouts_have_no_outside():
    with pytest.raises(ValueError, match="take low or med"):
        Outside().check(Randomness.HIGH)
    Push().check(Randomness.HIGH)


def test_only_who_sees_images_notices_another_light():
    assert not Light().can_be_noticed(sees_images=False)
    assert Light().can_be_noticed(sees_images=True)
    assert Friction().can_be_noticed(sees_images=False)


def test_an_episode_draws_the_same_from_the_same_seed_however_large():
    once, again = (ShiftOfEpisode.of(Push(), 10**30) for _ in range(2))
    assert once == again
    assert once.stream("push").random() == again.stream("push").random()
    assert once.key != ShiftOfEpisode.of(Push(), 1).key
    assert once.fingerprint != ShiftOfEpisode.of(Push(force_n=9.0), 10**30).fingerprint
