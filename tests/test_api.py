"""The front door for Python, and the page that shows it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from juicer import api
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Episode, Outcome
from juicer.errors import (
    ArtifactError,
    ArtifactNotFound,
    ConfigError,
    InvalidAction,
    InvalidCheckpoint,
    JuicerError,
    PolicyFailed,
    WrongArtifactKind,
)
from juicer.evaluation import wilson_interval
from juicer.policy.replay import ReplayPolicy
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.storage.annotations import Annotation, write_annotations
from juicer.storage.episodes import write_episodes
from juicer.storage.evaluations import EXAMPLES, EvaluationRow, write_evaluation
from juicer.storage.frames import frame_of
from juicer.storage.selections import SelectionRow, write_selection
from juicer.training.mixing import DatasetConfig
from stages.dataset import dataset
from stages.runtime.execution import perform_here
from stages.runtime.session import Session

PAGE = Path(__file__).parents[1] / "docs" / "library.md"
KINDS = ("episodes", "checkpoint", "evaluation")


def stay(observation: Any) -> Any:
    return np.append(observation["proprioception"][:9], 1.0)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory, insertions: list[Episode]) -> ArtifactStore:
    """Two demonstrations, a policy that repeats them, its evaluation, and a report that names it."""
    store = ArtifactStore(tmp_path_factory.mktemp("somewhere") / "data")
    facts = {"task": "one_leg", "randomness": "low"}
    with store.create(Recipe("ingest", "episodes", config=facts)) as draft:
        write_episodes(draft.path, insertions, {})
        draft.summary |= {"episodes": 2, "rejections": {}}
    with store.create(Recipe("memorise", "checkpoint", inputs={"episodes": (draft.ref,)})) as draft:
        poses = np.stack([episode.steps["part_poses"][0] for episode in insertions])
        actions = [episode.steps["action"] for episode in insertions]
        ReplayPolicy(poses, actions, [0, 4], steps=100).save(draft.path, "one_leg")
        draft.summary["tasks"] = ["one_leg"]
    with store.create(Recipe("evaluate", "evaluation", inputs={"checkpoint": (draft.ref,)}, config=facts)) as draft:
        write_evaluation(draft.path, [EvaluationRow.of(*numbered) for numbered in enumerate(insertions)])
        examples = draft.path / EXAMPLES
        examples.mkdir()
        write_episodes(examples, insertions[:1], {})
        draft.summary |= {"episodes": 2, "successes": 2, "success_rate": 1.0}
    report = {"title": "smoke", "task": "one_leg", "rows": [{"condition": "ta_ci", "seed": 0}]}
    with store.create(Recipe("report", "report", inputs={"evaluations": (draft.ref,)}, config=report)) as draft:
        (draft.path / "report.html").write_text("")
    return store


def ids(store: ArtifactStore) -> dict[str, str]:
    return {kind: store.refs(kind)[0].id for kind in KINDS}


@pytest.mark.usefixtures("drawing")
def test_the_examples_of_the_page_run(
    store: ArtifactStore, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], drawing: None
):
    monkeypatch.chdir(Path(store.url).parent)
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL))
    exec(compile(code, str(PAGE), "exec"), {"__name__": "library"})
    printed = capsys.readouterr().out
    assert "0 of 4 episodes of one_leg (high) succeeded: 0.0% (95 % interval 0.0% to 49.0%)" in printed
    assert "stay alone succeeded from 0 of 4 initial states, ReplayPolicy alone from 0: p = 1" in printed
    assert Path("episode.mp4").stat().st_size > 1000


def test_importing_it_imports_nothing_heavy():
    script = (
        "import sys\nfrom juicer import api\n"
        "heavy = {'numpy', 'pandas', 'scipy', 'torch', 'mujoco', 'zarr', 'gymnasium', 'pyarrow'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_what_is_in_a_store_is_found_by_the_beginning_of_its_id(store: ArtifactStore, insertions: list[Episode]):
    known = ids(store)
    episodes = api.load_episodes(store, known["episodes"][:5])
    np.testing.assert_array_equal(episodes.read(1).steps["action"], insertions[1].steps["action"])
    evaluation = api.load_evaluation(store, f"evaluation/{known['evaluation']}")
    assert (evaluation.task, evaluation.randomness, evaluation.successes, len(evaluation.rows)) == (
        "one_leg",
        "low",
        2,
        2,
    )
    assert evaluation.interval == wilson_interval(2, 2)
    (run,) = api.rollout(api.load_policy(store, known["checkpoint"], "one_leg"), "one_leg", [0], max_steps=3)
    np.testing.assert_array_equal(run.steps["action"], insertions[0].steps["action"][:3])


def test_tables_are_data_frames(store: ArtifactStore, insertions: list[Episode]):
    known = ids(store)
    episodes = api.load_episodes(store, known["episodes"]).table
    assert episodes["episode_id"].tolist() == [episode.record.episode_id for episode in insertions]
    assert episodes["length"].tolist() == [len(episode) for episode in insertions]
    assert episodes["policy"].isna().all()
    evaluation = api.load_evaluation(store, known["evaluation"]).table
    assert evaluation.groupby("outcome")["seed"].count().to_dict() == {"success": 2}
    assert list(frame_of([], Annotation).columns) == ["episode_id", "step", "critical_state", "author", "confidence"]
    assert api.load_table(store, known["episodes"]).equals(episodes)
    assert api.load_table(store, "ta_ci").equals(evaluation)
    mixed = dataset(Session(store, perform_here), episodes=(store.refs("episodes")[0],), config=DatasetConfig())
    assert api.load_table(store, mixed.id)["episode_id"].tolist() == episodes["episode_id"].tolist()
    wanted = "'evaluation or episodes or annotations or selection or dataset' is needed"
    with pytest.raises(WrongArtifactKind, match=wanted):
        api.load_table(store, known["checkpoint"])
    with pytest.raises(WrongArtifactKind, match="'episodes or evaluation' is needed"):
        api.load_episodes(store, known["checkpoint"])
    with pytest.raises(ArtifactError, match=r"recordings\.parquet"):
        api.load_recordings(store, known["episodes"])


def test_what_is_not_there_is_told(store: ArtifactStore, tmp_path: Path):
    with pytest.raises(ArtifactNotFound, match="no artifact answers to 'ffff'"):
        api.load_episodes(store, "ffff")
    with pytest.raises(ArtifactNotFound, match="there is no such folder"):
        api.open_store(tmp_path / "dta")
    with pytest.raises(InvalidCheckpoint, match="show 'one_leg', not 'lamp'"):
        api.load_policy(store, ids(store)["checkpoint"], "lamp")
    assert api.open_store(store.url).resolve(ids(store)["episodes"]) == ArtifactRef("episodes", ids(store)["episodes"])


def test_an_evaluation_starts_where_ours_start_and_does_not_depend_on_what_runs_beside():
    alone = api.evaluate(stay, "one_leg", episodes=3, first=5, num_envs=1, max_steps=3)
    assert [row.seed for row in alone.rows] == list(SEED_RANGES[Purpose.EVALUATION][5:8])
    assert (alone.successes, alone.rate, alone.outcomes) == (0, 0.0, {"timeout": 3})
    assert alone == api.evaluate(stay, "one_leg", episodes=3, first=5, num_envs=3, max_steps=3)
    assert str(alone) == "0 of 3 episodes of one_leg (low) succeeded: 0.0% (95 % interval 0.0% to 56.1%)"


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"episodes": 0}, "episodes must be a whole number of at least 1, got 0"),
        ({"episodes": 2.5}, "episodes must be a whole number"),
        ({"episodes": 2_000_000}, "initial states"),
        ({"first": -1}, "first must be a whole number of at least 0"),
        ({"num_envs": 0}, "num_envs must be at least 1"),
        ({"max_steps": 0}, "max_steps must be a whole number"),
        ({"randomness": "wild"}, "randomness 'wild'"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: Any, problem: str):
    with pytest.raises(ConfigError, match=problem):
        api.evaluate(stay, "one_leg", **settings)


class Short:
    """Plans fewer actions than it says."""

    obs_horizon, action_horizon = 1, 4

    def predict(self, observations: Any, streams: Any) -> Any:
        return np.zeros((len(streams), 3, 10))


@pytest.mark.parametrize(
    ("call", "problem"),
    [
        (lambda: api.open_store(3), "opened by the path of a folder or a URL, not by 3"),
        (lambda: api.open_store(""), "not by ''"),
        (lambda: api.open_store("~nobody-at-all/data"), "there is no such user"),
        (lambda: api.artifacts("data"), "a store is needed, such as open_store.. gives, not 'data'"),
        (lambda: api.make(rander_mode="rgb_array"), "no setting 'rander_mode'; did you mean 'render_mode'"),
        (lambda: api.make([]), "unknown task"),
        (lambda: api.rollout(stay, "one_leg", 5), "seeds must be a sequence of initial-state seeds"),
        (lambda: api.rollout(stay, "one_leg", [0], root_seed=-1), "root_seed must be a whole number"),
        (lambda: next(api.rollout(stay, "one_leg", ["a"])), "a seed must be a whole number"),
        (lambda: api.initial_states(0), "episodes must be a whole number of at least 1"),
        (
            lambda: api.evaluate(lambda seen: np.zeros(9), "one_leg", episodes=1),
            r"at step 0 of the episode from initial state 3000000: .* shape \(9,\), not \(10,\)",
        ),
        (
            lambda: api.evaluate(Short(), "one_leg", episodes=1),
            r"at step 0 of the episode from initial state 3000000: .* shape \(1, 3, 10\), but \(1, at least 4, 10\)",
        ),
        (
            lambda: api.evaluate(lambda seen: "left", "one_leg", episodes=1),
            "at step 0 of the episode from initial state 3000000: .* real numbers",
        ),
    ],
)
def test_a_wrong_call_ends_in_a_sentence(call: Any, problem: str):
    with pytest.raises(JuicerError, match=problem):
        call()


def test_a_policy_of_one_task_needs_no_name_of_it(store: ArtifactStore, tmp_path: Path):
    assert type(api.load_policy(store, "ta_ci")) is ReplayPolicy
    several = ArtifactStore(tmp_path)
    with several.create(Recipe("train", "checkpoint")) as draft:
        draft.summary["tasks"] = ["one_leg", "lamp"]
    with pytest.raises(ConfigError, match=r"was trained for 2 tasks \(one_leg, lamp\); choose one"):
        api.load_policy(several, draft.ref.id)


def test_a_replay_is_told_how_long_its_episodes_may_take(store: ArtifactStore, insertions: list[Episode]):
    last = insertions[0].steps["action"][-1]
    seen = {"part_poses": insertions[0].steps["part_poses"][:1]}
    for told, steps in ((None, 100), (20, 100), (250, 250)):
        replay = api.load_policy(store, "ta_ci", max_steps=told)
        assert replay.action_horizon == steps
        np.testing.assert_array_equal(replay.predict(seen, [np.random.default_rng(0)])[0, -1], last)
    with pytest.raises(ConfigError, match="max_steps must be a whole number of at least 1, got 0"):
        api.load_policy(store, "ta_ci", max_steps=0)


def test_an_evaluation_of_ones_own_is_compared_with_a_stored_one(store: ArtifactStore):
    stored = api.load_evaluation(store, "ta_ci")
    seeds = [row.seed for row in stored.rows]
    rows = tuple(EvaluationRow(row.episode, row.seed, Outcome.TIMEOUT, 0, 1000) for row in stored.rows)
    mine = api.Evaluation("mine", "one_leg", "low", None, rows)
    assert (api.compare(mine, stored).second_only, len(seeds)) == (2, 2)
    assert list(api.initial_states(2, first=3)) == [3_000_003, 3_000_004]


def test_every_rate_says_what_its_policy_saw(store: ArtifactStore):
    assert "observes" in api.models(store)
    assert api.evaluate(stay, "one_leg", episodes=1, max_steps=2).observes == "state"
    replay = api.load_policy(store, "ta_ci")
    assert api.evaluate(replay, "one_leg", episodes=1, max_steps=2).observes == "state"


def test_annotations_and_selections_are_tables(tmp_path: Path):
    store = ArtifactStore(tmp_path)
    with store.create(Recipe("annotate", "annotations")) as annotations:
        write_annotations(annotations.path, [Annotation("0" * 16, 12, 0, "human", 1.0)])
    with store.create(Recipe("select", "selection")) as selection:
        write_selection(selection.path, [SelectionRow("0" * 16, False, "too long")])
    assert api.load_table(store, annotations.ref.id)["step"].tolist() == [12]
    assert api.load_table(store, selection.ref.id)["reason"].tolist() == ["too long"]


def test_an_evaluation_gives_the_episodes_that_it_keeps(store: ArtifactStore, insertions: list[Episode]):
    (kept,) = api.load_episodes(store, "ta_ci")
    np.testing.assert_array_equal(kept.steps["action"], insertions[0].steps["action"])
    assert len(api.load_curves(store, "ta_ci")) == 0


def test_an_unknown_task_is_refused():
    for call in (lambda: api.make("one_lag"), lambda: api.evaluate(stay, "one_lag")):
        with pytest.raises(ConfigError, match="did you mean 'one_leg'"):
            call()


def test_a_policy_that_is_wrong_ends_in_a_sentence():
    with pytest.raises(InvalidAction, match=r"at step 0 of the episode from initial state 3000000 .* finite"):
        api.evaluate(lambda seen: np.full(10, np.nan), "one_leg", episodes=1)
    with pytest.raises(PolicyFailed, match="ZeroDivisionError"):
        api.evaluate(lambda seen: 1 / 0, "one_leg", episodes=1)
    with pytest.raises(PolicyFailed, match="is neither"):
        api.evaluate(None, "one_leg")


def test_what_a_policy_of_ones_own_may_see_is_named():
    assert api.state("part_poses").dtype == "float32"
    assert api.image("front", width=64, height=48).shape == (48, 64, 3)
    with pytest.raises(ConfigError, match="unknown observation 'part_pose'; did you mean 'part_poses'"):
        api.state("part_pose")
    with pytest.raises(ConfigError, match="unknown camera 'wirst'; did you mean 'wrist'"):
        api.image("wirst", 64, 48)
    with pytest.raises(ConfigError, match="width must be a whole number of at least 1, got 0"):
        api.image("wrist", 0, 48)
