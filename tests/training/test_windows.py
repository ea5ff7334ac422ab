import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from juicer.errors import TrainingFailed
from juicer.policy.config import HorizonConfig
from juicer.training.windows import TrainingEpisodes, concatenate, cut_windows, split_episodes, window_weights

PAPER = HorizonConfig()


def cut(lengths, horizons=PAPER, back_padding=0, chosen=None):
    ends = np.cumsum(lengths)
    return cut_windows(
        ends, np.arange(len(lengths)) if chosen is None else np.array(chosen, dtype=np.int64), horizons, back_padding
    )


@pytest.mark.parametrize(("back_padding", "lost"), [(0, 31), (7, 24), (31, 0)])
def test_an_episode_gives_the_original_number_of_windows(back_padding, lost):
    assert len(cut([580], back_padding=back_padding)) == 580 - lost


def test_every_step_is_the_current_one_at_most_once_however_large_the_padding():
    windows = cut([10], back_padding=500)
    np.testing.assert_array_equal(windows.obs_steps[:, -1], np.arange(10))


def test_a_snippet_shorter_than_a_chunk_gives_windows_only_when_padded():
    assert len(cut([20])) == 0
    assert len(cut([20], back_padding=31)) == 20


def test_padding_repeats_the_last_action_and_says_so():
    windows = cut([6], HorizonConfig(pred=4, action=2), back_padding=3)
    np.testing.assert_array_equal(windows.action_steps[-2], [4, 5, 5, 5])
    np.testing.assert_array_equal(windows.is_recorded[-2], [True, True, False, False])


def test_the_first_step_is_repeated_in_front_so_that_it_can_be_the_current_one():
    windows = cut([9, 9], HorizonConfig(obs=3, pred=6, action=2), chosen=[1])
    np.testing.assert_array_equal(windows.obs_steps[0], [9, 9, 9])
    np.testing.assert_array_equal(windows.action_steps[0], [9, 9, 9, 10, 11, 12])
    np.testing.assert_array_equal(windows.is_recorded[0], [False, False, True, True, True, True])


@given(
    lengths=st.lists(st.integers(1, 60), min_size=1, max_size=5),
    obs=st.integers(1, 3),
    back_padding=st.integers(0, 40),
    data=st.data(),
)
def test_windows_never_leave_their_episode(lengths, obs, back_padding, data):
    chosen = data.draw(st.lists(st.integers(0, len(lengths) - 1), unique=True))
    horizons = HorizonConfig(obs=obs, pred=16, action=8)
    windows = cut(lengths, horizons, back_padding, chosen)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    owners = episode[windows.action_steps]
    assert np.all(owners == owners[:, :1])
    assert set(owners.ravel()) <= set(chosen)
    assert np.all(np.diff(windows.action_steps, axis=1) >= 0)
    expected = sum(max(0, min(lengths[i], lengths[i] + obs - 1 + back_padding - horizons.pred + 1)) for i in chosen)
    assert len(windows) == expected


@given(st.lists(st.sampled_from("abcdefgh"), min_size=10, max_size=40).filter(lambda f: len(set(f)) > 2))
def test_a_family_is_never_split(families):
    learned, held_out = split_episodes(families, 0.3, np.random.default_rng(0))
    assert not {families[i] for i in learned} & {families[i] for i in held_out}
    assert sorted([*learned, *held_out]) == list(range(len(families)))
    assert len(held_out)


def test_the_split_depends_on_the_random_stream_alone():
    families = [f"demo/{index}" for index in range(50)]
    first, second = (split_episodes(families, 0.05, np.random.default_rng(3))[1] for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert len(first) == 3


def test_nothing_is_held_out_without_validation():
    learned, held_out = split_episodes(["a", "b"], 0.0, np.random.default_rng(0))
    assert (list(learned), list(held_out)) == ([0, 1], [])


def test_one_demonstration_cannot_be_split():
    with pytest.raises(TrainingFailed, match="set validation_fraction to 0"):
        split_episodes(["a", "a"], 0.1, np.random.default_rng(0))


def test_sources_follow_one_another(episodes):
    demonstrations, snippets = episodes((10, 12)), episodes((5,), seed=1, family="snippet")
    both = concatenate([demonstrations, snippets])
    np.testing.assert_array_equal(both.episode_ends, [10, 22, 27])
    np.testing.assert_array_equal(both.actions[22:], snippets.actions)
    assert both.families == ["demo/0", "demo/1", "snippet/0"]


def test_no_episodes_are_refused():
    with pytest.raises(TrainingFailed, match="no episodes"):
        concatenate([])


def test_rows_of_tasks_are_brought_to_one_length():
    def of(width):
        return TrainingEpisodes(
            {"poses": np.full((3, width), 1.0), "image": np.zeros((3, 4, 4, 3), np.uint8)},
            np.zeros((3, 10), np.float32), np.array([3]), ["family"], ["teleop"],
        )  # fmt: skip

    both = concatenate([of(2), of(4)]).observations
    assert both["poses"].tolist() == [[1, 1, 0, 0]] * 3 + [[1, 1, 1, 1]] * 3
    assert both["image"].shape == (6, 4, 4, 3)


def test_arrays_of_different_lengths_are_refused(episodes):
    good = episodes()
    with pytest.raises(TrainingFailed, match="have lengths"):
        TrainingEpisodes(good.observations, good.actions[:-1], good.episode_ends, good.families, good.sources)


def weighed(weights):
    return TrainingEpisodes({}, np.zeros((9, 10), np.float32), np.array([3, 9]), ["a", "b"], ["x", "x"], weights)


@pytest.mark.parametrize("weights", [(), (1.0, 1.0), (0.5, 0.5)])
def test_weights_that_are_alike_are_none(weights):
    assert window_weights(weighed(weights), cut([3, 6], HorizonConfig(pred=2, action=1), back_padding=1)) is None


def test_a_window_has_the_weight_of_its_episode():
    windows = cut([3, 6], HorizonConfig(pred=2, action=1), back_padding=1)
    np.testing.assert_array_equal(window_weights(weighed((1.0, 0.25)), windows), [1.0] * 3 + [0.25] * 6)


def test_episodes_without_weights_count_as_one_beside_weighed_ones():
    assert concatenate([weighed(()), weighed((2.0, 3.0))]).weights == [1.0, 1.0, 2.0, 3.0]
    with pytest.raises(TrainingFailed, match="2 episodes need a weight each, got 1"):
        weighed((1.0,))
