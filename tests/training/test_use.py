import dataclasses

import numpy as np
import pytest

from juicer.errors import TrainingFailed
from juicer.policy.config import TASK_KEY, HorizonConfig
from juicer.training.trainer import cut_sides, train
from juicer.training.use import SourceUse, check_tasks, check_use, measure_use, notable_losses
from juicer.training.windows import concatenate, cut_windows

PAPER = HorizonConfig()
NOBODY = np.array([], dtype=np.int64)


def use_of(parts, horizons=PAPER, back_padding=7, held_out=NOBODY):
    episodes = concatenate(parts)
    learned = np.setdiff1d(np.arange(len(episodes.episode_ends)), held_out)
    sides = (cut_windows(episodes.episode_ends, side, horizons, back_padding) for side in (learned, held_out))
    return measure_use(episodes, *sides)


def test_every_step_is_used_where_the_padding_completes_every_window(episodes):
    use = use_of([episodes((40, 30)), episodes((12, 9), source="augmentation")], back_padding=31)
    assert use == {
        "teleop": SourceUse(2, 70, 70, 0, 0, 0, 0, 0),
        "augmentation": SourceUse(2, 21, 21, 0, 0, 0, 0, 0),
    }


def test_what_the_paper_loses_of_short_snippets_is_counted_by_source(episodes):
    use = use_of([episodes((100,)), episodes((20, 24, 26), source="augmentation")])
    assert (use["teleop"].windows, use["teleop"].unused_timesteps, use["teleop"].unused_episodes) == (76, 24, 0)
    corrective = use["augmentation"]
    assert (corrective.episodes, corrective.timesteps) == (3, 70)
    assert (corrective.windows, corrective.unused_timesteps, corrective.unused_episodes) == (2, 68, 2)
    # The two windows of the last snippet predict what follows, up to its end.
    assert corrective.unseen_timesteps == 44


def test_held_out_episodes_are_counted_apart_and_are_not_lost(episodes):
    use = use_of([episodes((40, 50, 30))], back_padding=31, held_out=np.array([1]))["teleop"]
    assert (use.episodes, use.windows, use.validation_episodes, use.validation_windows) == (3, 70, 1, 50)
    assert use.unused_timesteps == 0


def test_a_notable_loss_is_told_and_a_small_one_is_not(episodes):
    use = use_of([episodes((300,)), episodes((60, 60), source="augmentation")])
    (sentence,) = notable_losses(use, PAPER, 7)
    assert sentence.startswith(
        "of 120 augmentation steps only 72 begin a window, and 0 of 2 augmentation episodes have"
    )
    assert "raise back_padding to 31 to lose none" in sentence
    check_use(use, PAPER, 7)


def test_losing_most_of_a_source_is_refused_whatever_the_others_are(episodes):
    use = use_of([episodes((300, 300)), episodes((40, 40), source="augmentation")])
    with pytest.raises(TrainingFailed, match=r"of 80 augmentation steps only 32 begin a window"):
        check_use(use, PAPER, 7)


def test_a_training_is_refused_before_its_first_step(episodes, tasks, policy_config, training_config):
    windows = training_config.windows.model_copy(update={"back_padding": 0})
    config = training_config.model_copy(update={"windows": windows})
    reports = []
    with pytest.raises(TrainingFailed, match=r"lower horizons\.pred"):
        train(
            [episodes(), episodes((8, 9, 10), family="snippet", source="augmentation")],
            policy_config,
            tasks,
            config,
            seed=0,
            progress=lambda *arguments, **facts: reports.append(arguments),
        )
    assert reports == []


def test_a_training_tells_its_use(episodes, tasks, policy_config, training_config):
    trained = train([episodes()], policy_config, tasks, training_config, seed=0)
    sides = cut_sides(episodes(), policy_config.horizons, training_config, seed=0)
    assert trained.use["teleop"].windows == trained.facts["num_windows"] == len(sides[0])
    assert trained.use["teleop"].validation_windows == len(sides[1])
    assert trained.losses == ()


def test_a_task_of_which_nothing_is_left_to_learn_from_is_named(episodes):
    data = episodes((40, 30, 50))
    numbers = np.repeat([0.0, 0.0, 1.0], (40, 30, 50)).astype(np.float32)[:, None]
    data = dataclasses.replace(data, observations={**data.observations, TASK_KEY: numbers})
    learned = cut_windows(data.episode_ends, np.array([0, 1]), PAPER, 31)
    with pytest.raises(
        TrainingFailed, match=r"nothing of lamp is left to learn from beside the episodes that are held"
    ):
        check_tasks(data, learned, ["one_leg", "lamp"])
    check_tasks(data, cut_windows(data.episode_ends, np.array([0, 2]), PAPER, 31), ["one_leg", "lamp"])
    check_tasks(episodes((40,)), learned, ["one_leg"])
