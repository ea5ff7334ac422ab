"""Configurations: small files, strict keys, one schema for single runs and studies."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from flows.conditions import defaults
from flows.config import CollectInferConfig, StudyConfig
from flows.runs import load_runs
from juicer.augmentation.config import AugmentationConfig, DepartureConfig, ToleranceConfig
from juicer.errors import ConfigError
from juicer.seed_ranges import Purpose, claim

CONFIGS = Path(__file__).parents[2] / "configs"


def write(folder: Path, text: str, name: str = "run.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.name)
def test_every_configuration_of_the_repository_is_valid(path):
    for config in load_runs(path):
        for name, seed in config.models:
            training = config.loop(name).training(config.method(name), seed)
            has_noise = name.endswith("state_noise")  # in the paper's study, of several settings
            assert (training.training.state_noise is not None) == has_noise


def test_file_says_which_flow_it_is_for(tmp_path):
    (single,) = load_runs(write(tmp_path, "condition: ta\nseed: 3\n"))
    (study,) = load_runs(write(tmp_path, "flow: study\nseeds: [1, 2]\n"))
    assert isinstance(single, CollectInferConfig)
    assert single.models == (("ta", 3),)
    assert isinstance(study, StudyConfig)
    assert set(study.conditions) == set(defaults()["conditions"]) - {"multitask"}


def test_base_is_overruled_by_the_file_and_the_file_by_the_command_line(tmp_path):
    write(tmp_path, "rounds: 2\nrecord: {demonstrations: 7, seed: 1}\n", "base.yaml")
    path = write(tmp_path, "base: base.yaml\nrecord: {demonstrations: 8}\n")
    (config,) = load_runs(path, ["record.seed=2"])
    assert (config.rounds, config.record.demonstrations, config.record.seed) == (2, 8, 2)


def test_task_and_randomness_reach_every_section_that_does_not_set_its_own(tmp_path):
    (config,) = load_runs(write(tmp_path, "task: one_leg\nrandomness: med\nevaluate: {randomness: high}\n"))
    assert config.recording.task == config.ingestion.task == config.evaluation.task == "one_leg"
    assert config.recording.randomness == config.collection(0, 1).randomness == "med"
    assert config.evaluation.randomness == "high"


def test_who_corrects_is_who_records_unless_another_operator_is_asked_for(tmp_path):
    conditions = "conditions: {bc: {}, hasty: {title: H, changes: {record: {temperament: {kind: steady}}}}}\n"
    human = f"flow: study\nseeds: [0]\nrecord: {{temperament: {{kind: human}}}}\n{conditions}"
    (config,) = load_runs(write(tmp_path, human))
    assert config.correction.temperament == config.recording.temperament
    assert (config.correction.temperament.kind, config.loop("hasty").correction.temperament.kind) == ("human", "steady")
    (config,) = load_runs(write(tmp_path, f"{human}correct: {{temperament: {{kind: steady}}}}\n"))
    assert (config.correction.temperament.kind, config.recording.temperament.kind) == ("steady", "human")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("recrod: {}\n", r"unknown key 'recrod'; did you mean 'record'\?"),
        ("record: {demonstration: 3}\n", r"'record\.demonstration'; did you mean 'demonstrations'\?"),
        ("flow: studdy\n", r"unknown flow 'studdy'; did you mean 'study'\?"),
        ("rounds: 0\n", r"run\.yaml:1: rounds: must be greater than 0, got 0"),
        ("condition: bcc\n", r"condition: unknown condition 'bcc'; did you mean 'bc'\?$"),
        ("flow: study\nseeds: [1, 1]\n", "each may be named only once"),
        (
            "train: {diffusion: {seed: 3}}\n",
            r"run\.yaml:1: unknown key 'train'; it is now 'policies', as in .*\.steps$",
        ),
        ("shifts:\n  mine: {kind: pusch}\n", r"run\.yaml:2: shifts\.mine: kind must be one of outside.*mean 'push'"),
        ("shifts: {mine: {kind: friction, factor: 99}}\n", r"shifts\.mine\.factor: must be at most 10, got 99"),
        ("shifts: {mine: {factor: 2.0}}\n", r"shifts\.mine: must say its 'kind'"),
        ("shifts: {'a b': {kind: push}}\n", r"letters, digits, '_' and '-'"),
        (
            "shifts: {mine: {kind: outside}}\nevaluate: {randomness: high}\n",
            "no region to be outside of; take low or med",
        ),
        ("evaluate: {shift: {kind: push}}\n", r"unknown key 'evaluate\.shift'"),
        ("base: gone.yaml\n", r"gone\.yaml' does not exist"),
        ("- 1\n", "must hold a mapping"),
        ("flow: [study]\n", "unknown flow"),
        ("record: !!set {seed}\n", r"line 1: tags such as 'tag:yaml\.org,2002:set' have no meaning here"),
        ("{1: 2}\n", "line 1: a key must be a word, got 1"),
        (
            "policies: {diffusion: {training: {step: 3}}}\n",
            r"'policies\.diffusion\.training\.step'; did you mean 'steps'\?",
        ),
    ],
)
def test_mistake_gets_one_sentence_that_names_the_remedy(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        load_runs(write(tmp_path, text))


def test_name_or_folder_may_look_like_a_date(tmp_path):
    path = write(tmp_path, "name: 2026-11-22\nlogs: 2026-11-20\n")
    (config,) = load_runs(path, ["labels=2026-02-30"])
    assert (config.name, config.logs, config.labels) == (
        "2026-11-22",
        tmp_path / "2026-11-20",
        Path.cwd() / "2026-02-30",
    )


def test_seed_below_zero_is_refused_wherever_it_is_said(tmp_path):
    (config,) = load_runs(write(tmp_path, "condition: bc\n"))
    with pytest.raises(ConfigError, match="seed: must be at least 0, got -1"):
        config.narrowed((), (-1,))


def test_base_may_have_a_base_of_its_own(tmp_path):
    write(tmp_path, "base: smoke\nrecord: {demonstrations: 5, seed: 1}\n", "lower.yaml")
    write(tmp_path, "base: lower.yaml\nrecord: {seed: 2}\n", "base.yaml")
    (config,) = load_runs(write(tmp_path, "base: base.yaml\ncondition: bc\n"))
    assert (config.record.demonstrations, config.record.seed) == (5, 2)
    assert config.policies["diffusion"] == load_runs("smoke")[0].policies["diffusion"]


def test_base_that_leads_back_to_itself_is_refused(tmp_path):
    write(tmp_path, "base: x.yaml\n", "base.yaml")
    write(tmp_path, "base: base.yaml\n", "x.yaml")
    with pytest.raises(ConfigError, match="base leads back to"):
        load_runs(write(tmp_path, "base: base.yaml\n"))


def test_collections_of_different_models_and_rounds_never_share_an_initial_state():
    config = StudyConfig(rounds=3)
    taken: set[int] = set()
    for seed in config.seeds:
        for turn in (1, 2, 3):
            collect = config.collection(seed, turn)
            states = set(claim(Purpose.COLLECTION, collect.first, collect.max_episodes))
            assert not states & taken
            taken |= states


@pytest.mark.parametrize("rounds", [1, 100])
def test_largest_seed_has_initial_states_for_its_last_round_and_the_next_is_refused(tmp_path, rounds):
    path = write(tmp_path, f"condition: ci\nrounds: {rounds}\nseed: 49\n")
    (config,) = load_runs(path)
    collect = config.collection(49, rounds)
    assert claim(Purpose.COLLECTION, collect.first, collect.max_episodes)
    too_large = r"seed 50 is too large: .* for seeds up to 49; take a smaller seed"
    study = write(tmp_path, f"flow: study\nconditions: [bc, ci]\nrounds: {rounds}\nseeds: [0, 50]\n", "study.yaml")
    for way in (
        lambda: load_runs(path, ["seed=50"]),
        lambda: config.narrowed((), (50,)),
        lambda: load_runs(study),
    ):
        with pytest.raises(ConfigError, match=too_large):
            way()
    with pytest.raises(ConfigError, match=r"lower collect\.max_episodes"):
        load_runs(path, ["collect.max_episodes=1000001"])
    # What does not collect needs none.
    assert config.narrowed(("bc",), (50,)).seeds == (50,)


def test_evaluation_beyond_the_last_initial_state_is_refused_before_anything_is_trained(tmp_path):
    path = write(tmp_path, "evaluate: {episodes: 100}\n")
    assert load_runs(path, ["evaluate.first=999900"])
    with pytest.raises(ConfigError, match=r"lower evaluate\.first or evaluate\.episodes"):
        load_runs(path, ["evaluate.first=999901"])


def test_seed_is_checked_against_every_task_that_a_model_mixes(tmp_path):
    tasks = "{one_leg: {}, lamp: {collect: {max_episodes: 400}}}"
    text = f"flow: study\nconditions: [multitask]\nseeds: [30]\ntasks: {tasks}\n"
    with pytest.raises(ConfigError, match=r"seed 30 is too large: .* up to 24"):
        load_runs(write(tmp_path, text))


def test_seeds_train_different_models_from_one_recipe():
    config = StudyConfig()
    bc, ta = config.method("bc"), config.method("ta")
    assert config.training(bc, 0).seed != config.training(bc, 1).seed
    assert config.training(bc, 1) == config.training(ta, 1)


def test_what_has_no_randomness_has_one_seed():
    study = StudyConfig(conditions=("replay", "bc"), seeds=(0, 1))
    assert study.models == (("replay", 0), ("bc", 0), ("bc", 1))


def test_of_the_parts_of_a_study_that_with_its_first_seed_replays():
    study = StudyConfig(conditions=["replay", "bc"], seeds=(3, 4))
    assert study.models == (("replay", 3), ("bc", 3), ("bc", 4))
    assert study.narrowed((), (3,)).models == (("replay", 3), ("bc", 3))
    assert study.narrowed((), (4,)).models == (("bc", 4),)
    with pytest.raises(
        ConfigError,
        match="there is nothing to run: a condition that replays has seed 3 only, which is not one of the seeds",
    ):
        study.narrowed(("replay",), (4,))
    with pytest.raises(
        ValidationError,
        match="there is nothing to run: a condition that replays has seed 7 only, which is not one of the seeds",
    ):
        StudyConfig(conditions=["replay"], seeds=(3, 4), analysed_seed=7)


def test_what_people_name_may_be_called_task(tmp_path):
    text = "flow: study\nconditions: {task: {title: T, policy: task}}\npolicies: {task: {base: diffusion}}\n"
    (run,) = load_runs(write(tmp_path, text))
    assert (run.models[0], run.method("task").policy) == (("task", 0), "task")


def test_conditions_that_people_could_not_tell_apart_are_refused(tmp_path):
    text = "flow: study\nconditions: {mine: {title: BC}, bc: {}}\n"
    with pytest.raises(ConfigError, match="'mine' and 'bc' have the same title, 'BC'; give one of them another"):
        load_runs(write(tmp_path, text))


def test_study_can_be_narrowed_to_what_it_has():
    study = StudyConfig(conditions=("bc", "ta"), seeds=(0, 1))
    narrow = study.narrowed(("ta",), (1,))
    assert narrow.models == (("ta", 1),)
    with pytest.raises(ConfigError, match=r"no condition 'ci'"):
        study.narrowed(("ci",), ())
    with pytest.raises(ConfigError, match=r"no seed 7; its seeds are 0, 1"):
        study.narrowed((), (7,))
    assert CollectInferConfig().narrowed(("bc",), (4,)).seeds == (4,)


def test_paper_augments_as_the_paper_does():
    (config,) = load_runs(CONFIGS / "paper.yaml")
    cone = DepartureConfig(
        lift_m=(0.0, 0.18),
        distance_m=(0.2, 0.5),
        polar_deg=(5.0, 80.0),
        rotation_deg=180.0,
        step_m=(0.02, 0.02),
        step_deg=(7.5, 7.5),
    )
    tolerance = ToleranceConfig(position_m=0.017, rotation_deg=20.0, gripper_width_m=0.005)
    for section, count in ((config.augment, 50), (config.augment_retraining, 150)):
        expected = AugmentationConfig(
            num_snippets=count,
            departures={"paper": cone},
            steps_after_gripper_change=30,
            tolerance=tolerance,
            end_tolerance=tolerance,
        )
        assert section.model_dump(exclude={"seed"}) == expected.model_dump()


def test_a_file_may_be_about_several_tasks(tmp_path):
    text = "flow: study\nname: all\nconditions: [bc, multitask]\nrounds: 2\ntasks: {one_leg: {rounds: 3}, lamp: {}}\n"
    first, second = load_runs(write(tmp_path, text), ["seeds=[4]"])
    assert [(run.name, run.task, run.rounds, run.seeds) for run in (first, second)] == [
        ("all_one_leg", "one_leg", 3, (4,)),
        ("all_lamp", "lamp", 2, (4,)),
    ]
    assert second.evaluation.task == second.recording.task == second.ingestion.task == "lamp"
    assert first.mix == second.mix
    assert {task: (loop.task, loop.recording.task, loop.rounds) for task, loop in first.mix.items()} == {
        "one_leg": ("one_leg", "one_leg", 3),
        "lamp": ("lamp", "lamp", 2),
    }
    # A flow is handed its configuration as JSON.
    assert StudyConfig.model_validate_json(first.model_dump_json()) == first


def test_the_model_for_several_tasks_is_trained_alike_whoever_asks_for_it(tmp_path):
    text = (
        "flow: study\nconditions: [multitask]\npolicies: {diffusion: {training: {steps: 7000}}, multitask: {}}\n"
        "tasks: {one_leg: {}, lamp: {policies: {diffusion: {training: {steps: 9000}}}}}\n"
    )
    trainings = [run.final_training(run.method("multitask"), 0) for run in load_runs(write(tmp_path, text))]
    assert [training.training.steps for training in trainings] == [7000, 7000]


def test_one_model_for_several_tasks_needs_no_study(tmp_path):
    runs = load_runs(write(tmp_path, "condition: multitask\ntasks: [lamp, one_leg]\n"))
    assert [(run.task, list(run.mix)) for run in runs] == [
        ("lamp", ["lamp", "one_leg"]),
        ("one_leg", ["lamp", "one_leg"]),
    ]


def test_choosing_a_model_for_several_tasks_where_there_is_one_is_refused():
    with pytest.raises(ConfigError, match="condition multitask needs several tasks"):
        CollectInferConfig().narrowed(("multitask",), ())


def test_a_list_of_tasks_will_do(tmp_path):
    runs = load_runs(write(tmp_path, "flow: study\nconditions: [bc]\ntasks: [lamp, round_table]\n"))
    assert [run.task for run in runs] == ["lamp", "round_table"]
    assert not runs[0].mix


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("flow: study\nconditions: [multitask]\n", "needs several tasks"),
        ("flow: study\nconditions: [multitask]\ntasks: [lamp]\n", "needs several tasks"),
        ("condition: multitask\n", "needs several tasks"),
        ("condition: multitask\ntasks: [lamp]\n", "needs several tasks"),
        ("flow: study\nconditions: [multitask]\ntrain: 3\ntasks: [lamp, one_leg]\n", "train"),
        ("tasks: []\n", "'tasks' must list tasks"),
        ("task: lamp\ntasks: [lamp]\n", "without 'task'"),
        ("tasks: {lamp: {roundz: 3}}\n", "rounds"),
        ("tasks: [lamp, lamp]\n", "each may be named only once, and lamp is there twice"),
        ("tasks: {lamp: {task: one_leg}}\n", "tasks.lamp must not have a 'task' of its own"),
        ("tasks: {lmap: {}}\n", "unknown task 'lmap'; did you mean 'lamp'"),
        ("tasks: [one_leg, {lamp: {}}]\n", "'tasks' must list tasks"),
        ("tasks: {lamp: 5}\n", "'tasks' must list tasks"),
        ("tasks: {1: {}}\n", "a key must be a word, got 1"),
        ("tasks: lamp\n", "'tasks' must list tasks"),
        ("flow: study\nconditions:\ntasks: [lamp]\n", "conditions: must be a list"),
        ("flow: study\nconditions: 5\ntasks: [lamp]\n", "conditions: must be a list"),
    ],
)
def test_wrong_tasks_are_told(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        load_runs(write(tmp_path, text))


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.name)
def test_every_condition_of_a_study_of_the_repository_can_be_run_alone(path):
    """Prefect validates what a flow is given once more, as JSON."""
    for whole in load_runs(path):
        for condition in whole.conditions if isinstance(whole, StudyConfig) else ():
            part = whole.narrowed([condition], [])
            again = StudyConfig.model_validate(part.model_dump(mode="json"))
            assert again == part
            assert list(again.conditions) == [condition]
            assert again.narrowed([condition], []) == part
