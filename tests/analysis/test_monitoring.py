import numpy as np
import pytest

from juicer.analysis.monitoring import MEASURES, Watched, Watcher, watched
from juicer.geometry import matrix_to_rot6d, rotvec_to_matrix
from juicer.storage.analyses import MonitorRow

STRIDE = 4


def chunks(number=4000, position_m=0.0, rotation_rad=0.0, ahead=0.0, seed=0):
    """Samples of a chunk of twelve actions that move by a millimetre a step, with so much noise around them."""
    rng = np.random.default_rng(seed)
    steps = 0.001 * (np.arange(12)[:, None] + ahead) * np.array([1.0, 0, 0])
    positions = steps + position_m * rng.normal(size=(number, 12, 3))
    rot6d = matrix_to_rot6d(rotvec_to_matrix(rotation_rad * rng.normal(size=(number, 12, 3))))
    return np.concatenate([positions, rot6d, np.ones((number, 12, 1))], axis=-1)


def test_spread_is_the_distance_of_samples_from_their_mean():
    found = Watcher(STRIDE).measure(chunks(position_m=0.002, rotation_rad=0.01))
    assert found["position_mm"] == pytest.approx(2 * np.sqrt(3), rel=0.02)
    assert found["rotation_deg"] == pytest.approx(np.rad2deg(0.01 * np.sqrt(3)), rel=0.02)
    assert found["gripper"] == 0


def test_chunks_that_go_on_as_was_said_before_do_not_disagree():
    watcher = Watcher(STRIDE)
    assert watcher.measure(chunks())["disagreement_mm"] == 0
    assert watcher.measure(chunks(ahead=STRIDE))["disagreement_mm"] == pytest.approx(0, abs=1e-9)
    assert watcher.measure(chunks(ahead=2 * STRIDE + 3))["disagreement_mm"] == pytest.approx(3)


def episodes(failing, succeeding, failing_steps=100, succeeding_steps=60):
    """Watched rollouts of one score each from start to end."""
    scores = [*failing, *succeeding]
    failed = [True] * len(failing) + [False] * len(succeeding)
    lengths = [failing_steps] * len(failing) + [succeeding_steps] * len(succeeding)
    traces = [np.full(-(-length // STRIDE), score) for score, length in zip(scores, lengths, strict=True)]
    return Watched.of(traces, failed, lengths, STRIDE, window=3)


def test_area_is_how_often_a_failure_has_the_higher_score():
    spread = episodes(failing=[3.0, 1.0], succeeding=[0.5, 2.0, 1.0, 0.1])
    place = spread.before_any_success
    assert place * STRIDE < 60
    assert spread.separation(place).auc == pytest.approx((4 + 2.5) / 8)


def test_episodes_that_have_ended_are_not_compared():
    spread = episodes(failing=[1.0], succeeding=[2.0])
    assert spread.separation(spread.before_any_success).auc == 0
    assert spread.separation(20) is None
    full = 2 * STRIDE
    assert [step for step, _ in spread.curve()] == list(range(full, 60, STRIDE))


def test_a_longer_rollout_does_not_look_worse_for_being_longer():
    rng = np.random.default_rng(0)
    traces = [rng.random(25) for _ in range(200)] + [rng.random(15) for _ in range(200)]
    lengths = [100] * 200 + [60] * 200
    spread = Watched.of(traces, [True] * 200 + [False] * 200, lengths, STRIDE, window=1)
    assert spread.separation(spread.before_any_success).auc == pytest.approx(0.5, abs=0.07)


def test_the_interval_holds_the_area_and_narrows_with_more_rollouts():
    rng = np.random.default_rng(3)
    widths = []
    for number in (10, 90):
        spread = episodes(rng.normal(1.0, 1, number), rng.normal(0, 1, number))
        separation = spread.separation(spread.before_any_success)
        low, high = separation.interval(np.random.default_rng(0))
        assert low < separation.auc < high
        widths.append(high - low)
    assert widths[1] < widths[0] / 2


def test_of_fewer_than_ten_failures_every_area_is_possible():
    spread = episodes([5.0] * 9, [0.0] * 90)
    separation = spread.separation(spread.before_any_success)
    assert separation.auc == 1
    assert separation.interval(np.random.default_rng(0)) == (0, 1)


def test_alarms_are_false_as_often_as_was_asked_and_early():
    rng = np.random.default_rng(1)
    calm = [rng.exponential(size=25) for _ in range(400)]
    rising = [np.concatenate([rng.exponential(size=10), np.full(15, 20.0)]) for _ in range(20)]
    spread = Watched.of(calm + rising, [False] * 400 + [True] * 20, [100] * 420, STRIDE, window=1)
    alarms = spread.alarms(0.05)
    assert alarms.false_alarms == pytest.approx(0.05, abs=0.03)
    assert alarms.found == 1
    assert alarms.leads[len(alarms.leads) // 2] == 100 - 10 * STRIDE


def test_alarms_of_noise_are_found_in_failures_no_oftener_than_in_successes():
    rng = np.random.default_rng(2)
    traces = [rng.random(100) for _ in range(1000)] + [rng.random(15) for _ in range(1000)]
    lengths = [100 * STRIDE] * 1000 + [15 * STRIDE] * 1000
    for window in (1, 5):
        alarms = Watched.of(traces, [True] * 1000 + [False] * 1000, lengths, STRIDE, window).alarms(0.05)
        assert alarms.found == pytest.approx(alarms.false_alarms, abs=0.03)
        # Failures last until the limit; that an alarm by chance came long before is no merit.
        assert max(alarms.leads) <= 15 * STRIDE


def test_a_rollout_that_ends_before_its_window_is_full_has_no_score_and_raises_no_alarm():
    traces, failed = [np.ones(9)] * 5 + [np.full(2, 5.0)], [True] + [False] * 5
    spread = Watched.of(traces, failed, [36] * 5 + [8], STRIDE, window=3)
    assert np.isnan(spread.scores[5]).all()
    assert spread.separation(spread.before_any_success) is None
    assert spread.alarms(0.05).false_alarms == 0


@pytest.mark.parametrize(
    ("failing_steps", "succeeding_steps", "clause"),
    [
        ([100], [], "there is no success"),
        ([], [60], "there is no failure"),
        ([100], [8, 60], "the first success ends before a window of predictions is full"),
        ([20], [60], "there is no failure that is still running when the first success ends"),
        ([20, 100], [60], ""),
    ],
)
def test_what_cannot_be_compared_is_told_why(failing_steps, succeeding_steps, clause):
    lengths = [*failing_steps, *succeeding_steps]
    failed = [True] * len(failing_steps) + [False] * len(succeeding_steps)
    spread = Watched.of([np.ones(-(-length // STRIDE)) for length in lengths], failed, lengths, STRIDE, window=3)
    assert spread.why_not_compared() == clause


def test_without_a_success_there_is_no_threshold_and_no_alarm():
    spread = episodes(failing=[1.0, 2.0], succeeding=[])
    assert spread.before_any_success is None
    assert spread.alarms(0.05).leads == ()
    assert spread.alarms(0.05).false_alarms is None


def test_a_window_averages_the_last_predictions_and_the_highest_so_far_stays():
    spread = Watched.of([np.array([0.0, 3.0, 0.0, 9.0, 0.0])], [False], [20], STRIDE, window=2)
    np.testing.assert_allclose(spread.scores, [[np.nan, 1.5, 1.5, 4.5, 4.5]])


def test_a_table_is_watched_episode_by_episode():
    rows = [
        MonitorRow(episode, 7 + episode, step, 1.0 + episode, 2.0, 0.0, 0.5, outcome, 8)
        for episode, outcome in enumerate(("success", "timeout"))
        for step in (0, 4)
    ]
    for measure in MEASURES:
        spread = watched(rows, measure, STRIDE, window=2)
        assert spread.failed.tolist() == [False, True]
    np.testing.assert_allclose(watched(rows, "position_mm", STRIDE, 2).scores, [[np.nan, 1], [np.nan, 2]])


def test_an_alarm_is_early_by_the_steps_until_half_of_the_successes_are_over():
    calm, rising = [np.zeros(10)] * 4, [np.array([0.0, 0.0, 5.0] + [5.0] * 97), np.array([0.0] * 9 + [5.0] * 91)]
    lengths = [32, 36, 40, 40, 400, 400]
    spread = Watched.of(calm + rising, [False] * 4 + [True] * 2, lengths, STRIDE, window=1)
    assert spread.alarms(0.05).leads == (38 - 9 * STRIDE, 38 - 2 * STRIDE)
