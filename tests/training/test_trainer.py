import dataclasses
import math
import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import torch

from juicer.errors import ConfigError, TrainingFailed
from juicer.policy.checkpoint import load_policy, save_checkpoint
from juicer.policy.config import HorizonConfig, PolicyConfig
from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.flow.config import FlowConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.tasks import as_shown
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise
from juicer.training.state import STATE_FILE
from juicer.training.trainer import train

HEADS = {
    "mlp": MLPHeadConfig(width=32, blocks=1),
    "flow": FlowConfig(denoiser=MLPDenoiserConfig(width=32, blocks=1, step_embedding=8)),
    "unet": DiffusionConfig(denoiser=UNetConfig(channels=(16, 16, 16), step_embedding=8)),
}


class Curves:
    def __init__(self):
        self.points = {}

    def log(self, metrics, step):
        self.points |= {(name, step): value for name, value in metrics.items()}


class KilledError(Exception):
    pass


def kill_at(step):
    def progress(done, total, **facts):
        if done >= step:
            raise KilledError

    return progress


def assert_equal_checkpoints(first, second):
    for states in ((first.weights, second.weights), (first.ema or {}, second.ema or {})):
        assert states[0].keys() == states[1].keys()
        for name, value in states[0].items():
            assert torch.equal(value, states[1][name]), name


@pytest.mark.parametrize("noise", [None, PhysicalStateNoise()])
def test_a_killed_training_resumes_bit_for_bit(episodes, tasks, policy_config, training_config, tmp_path, noise):
    config = training_config.model_copy(update={"state_noise": noise, "report_every": 1})
    straight_curves, curves = Curves(), Curves()
    straight = train([episodes()], policy_config, tasks, config, seed=3, metrics=straight_curves)
    arguments = ([episodes()], policy_config, tasks, config)
    with pytest.raises(KilledError):
        train(*arguments, seed=3, scratch=tmp_path, metrics=curves, progress=kill_at(23))
    assert (tmp_path / STATE_FILE).exists()
    torch.rand(5)
    resumed = train(*arguments, seed=3, scratch=tmp_path, metrics=curves)
    assert_equal_checkpoints(straight.checkpoint, resumed.checkpoint)
    assert curves.points == straight_curves.points
    assert resumed.facts == straight.facts


def test_a_resumed_training_continues_and_does_not_start_again(
    episodes, tasks, policy_config, training_config, tmp_path
):
    arguments, reports = ([episodes()], policy_config, tasks, training_config), []
    with pytest.raises(KilledError):
        train(*arguments, seed=3, scratch=tmp_path, progress=kill_at(20))
    train(*arguments, seed=3, scratch=tmp_path, progress=lambda done, total, **facts: reports.append((done, facts)))
    assert [done for done, _ in reports] == [20, 30, 40]
    assert {"loss", "seconds_left"} <= set(reports[0][1])


def test_a_training_killed_by_the_system_resumes_bit_for_bit(episodes, tasks, policy_config, training_config, tmp_path):
    data = episodes()
    np.savez(tmp_path / "data.npz", ends=data.episode_ends, action=data.actions, **data.observations)
    (tmp_path / "policy.json").write_text(policy_config.model_dump_json())
    (tmp_path / "spec.json").write_text(tasks["toy"].model_dump_json())
    (tmp_path / "training.json").write_text(training_config.model_dump_json())
    script = textwrap.dedent(
        f"""
        import os, pathlib, signal
        import numpy as np
        from juicer.policy.config import FeatureSpec, PolicyConfig
        from juicer.training.config import TrainingConfig
        from juicer.training.trainer import train
        from juicer.training.windows import TrainingEpisodes

        folder = pathlib.Path({str(tmp_path)!r})
        arrays = dict(np.load(folder / "data.npz"))
        ends, action = arrays.pop("ends"), arrays.pop("action")
        data = TrainingEpisodes(arrays, action, ends, [f"demo/{{i}}" for i in range(len(ends))], ["teleop"] * len(ends))

        def die(done, total, **facts):
            if done == 20:
                os.kill(os.getpid(), signal.SIGKILL)

        train(
            [data],
            PolicyConfig.model_validate_json((folder / "policy.json").read_text()),
            dict(toy=FeatureSpec.model_validate_json((folder / "spec.json").read_text())),
            TrainingConfig.model_validate_json((folder / "training.json").read_text()),
            seed=3,
            scratch=folder / "scratch",
            progress=die,
        )
        """
    )
    killed = subprocess.run([sys.executable, "-c", script], env={**os.environ, "OMP_NUM_THREADS": "1"}, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert (tmp_path / "scratch" / STATE_FILE).exists()
    arguments = ([data], policy_config, tasks, training_config)
    resumed = train(*arguments, seed=3, scratch=tmp_path / "scratch")
    assert_equal_checkpoints(resumed.checkpoint, train(*arguments, seed=3).checkpoint)


def test_a_state_of_other_settings_is_not_continued(episodes, tasks, policy_config, training_config, tmp_path, caplog):
    with pytest.raises(KilledError):
        train([episodes()], policy_config, tasks, training_config, seed=3, scratch=tmp_path, progress=kill_at(20))
    other = train([episodes()], policy_config, tasks, training_config, seed=4, scratch=tmp_path)
    assert "of other data or settings" in caplog.text
    assert_equal_checkpoints(
        other.checkpoint, train([episodes()], policy_config, tasks, training_config, seed=4).checkpoint
    )


def test_a_damaged_state_is_passed_over(episodes, tasks, policy_config, training_config, tmp_path, caplog):
    (tmp_path / STATE_FILE).write_bytes(b"half a state")
    train([episodes()], policy_config, tasks, training_config, seed=3, scratch=tmp_path)
    assert "cannot be read" in caplog.text


def test_the_seed_decides_and_the_caller_does_not(episodes, tasks, policy_config, training_config):
    torch.manual_seed(1)
    first = train([episodes()], policy_config, tasks, training_config, seed=3)
    torch.manual_seed(2)
    again = train([episodes()], policy_config, tasks, training_config, seed=3)
    drawn = torch.rand(1)
    torch.manual_seed(2)
    assert torch.equal(drawn, torch.rand(1)), "training moved the caller's random state"
    assert_equal_checkpoints(first.checkpoint, again.checkpoint)
    other = train([episodes()], policy_config, tasks, training_config, seed=4)
    assert not torch.equal(
        first.checkpoint.weights["head.denoiser.stem.weight"], other.checkpoint.weights["head.denoiser.stem.weight"]
    )


def test_training_lowers_the_error_on_held_out_episodes(episodes, tasks, policy_config, training_config):
    config = training_config.model_copy(update={"steps": 400, "batch_size": 64, "learning_rate": 3e-3})
    curves = Curves()
    train([episodes([40] * 20)], policy_config, tasks, config, seed=0, metrics=curves)
    error_mm = [curves.points[("validation/position_error_mm", step)] for step in (20, 400)]
    assert error_mm[1] < 0.6 * error_mm[0]
    assert error_mm[1] < 20
    assert curves.points[("validation/gripper_accuracy", 400)] > 0.9


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS.keys())
@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_every_head_trains_and_acts(episodes, tasks, training_config, tmp_path, head, precision):
    policy = PolicyConfig(head=head, horizons=HorizonConfig(pred=8, action=4))
    config = training_config.model_copy(update={"steps": 10, "warmup_steps": 2, "precision": precision})
    trained = train([episodes()], policy, tasks, config, seed=0)
    save_checkpoint(tmp_path, trained.checkpoint)
    rows = {name: values[:3] for name, values in episodes().observations.items()}
    actions = load_policy(tmp_path, "toy").predict(rows, [np.random.default_rng(0)] * 3)
    assert np.isfinite(actions).all()
    assert math.isfinite(trained.facts["train/loss"])


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS.keys())
def test_every_head_resumes_bit_for_bit(episodes, tasks, training_config, tmp_path, head):
    policy = PolicyConfig(head=head, horizons=HorizonConfig(pred=8, action=4))
    changes = {"steps": 10, "warmup_steps": 2, "save_every": 4, "report_every": 1, "precision": "bf16"}
    arguments = ([episodes()], policy, tasks, training_config.model_copy(update=changes))
    with pytest.raises(KilledError):
        train(*arguments, seed=3, scratch=tmp_path, progress=kill_at(6))
    resumed = train(*arguments, seed=3, scratch=tmp_path)
    assert_equal_checkpoints(train(*arguments, seed=3).checkpoint, resumed.checkpoint)


def test_steps_that_take_long_are_saved_more_often(
    episodes, tasks, policy_config, training_config, tmp_path, monkeypatch
):
    monkeypatch.setattr("juicer.training.trainer.LONGEST_UNSAVED_S", 0.0)
    changes = {"steps": 10, "warmup_steps": 2, "save_every": 100, "report_every": 1}
    arguments = ([episodes()], policy_config, tasks, training_config.model_copy(update=changes))
    with pytest.raises(KilledError):
        train(*arguments, seed=3, scratch=tmp_path, progress=kill_at(6))
    steps: list[int] = []
    resumed = train(*arguments, seed=3, scratch=tmp_path, progress=lambda done, *_, **__: steps.append(done))
    assert steps == [6, 7, 8, 9, 10]
    assert_equal_checkpoints(train(*arguments, seed=3).checkpoint, resumed.checkpoint)


@pytest.mark.parametrize(("has_bfloat16", "precision"), [(True, "bf16"), (False, "fp32")])
def test_what_the_processor_chose_is_told(
    episodes, tasks, policy_config, training_config, monkeypatch, has_bfloat16, precision
):
    monkeypatch.setattr("juicer.policy.torch_settings.has_fast_bfloat16", lambda: has_bfloat16)
    config = training_config.model_copy(update={"precision": "auto", "steps": 6})
    trained = train([episodes()], policy_config, tasks, config, seed=0)
    assert (trained.facts["device"], trained.facts["precision"]) == ("cpu", precision)


def test_without_a_moving_average_the_last_weights_act(episodes, tasks, policy_config, training_config):
    config = training_config.model_copy(update={"ema_decay": None, "validation_fraction": 0.0})
    trained = train([episodes()], policy_config, tasks, config, seed=0)
    assert trained.checkpoint.ema is None
    assert trained.checkpoint.metadata.acting_weights == "raw"
    assert "validation/loss" not in trained.facts


def test_short_snippets_count_beside_demonstrations(episodes, tasks, policy_config, training_config):
    snippets = episodes((5, 6), seed=1, family="snippet")
    config = training_config.model_copy(update={"validation_fraction": 0.0})
    alone = train([episodes()], policy_config, tasks, config, seed=0)
    mixed = train([episodes(), snippets], policy_config, tasks, config, seed=0)
    assert mixed.facts["num_windows"] == alone.facts["num_windows"] + 5 + 6


def test_the_original_noise_is_refused_with_relative_actions(episodes, tasks, policy_config, training_config):
    config = training_config.model_copy(update={"state_noise": OriginalStateNoise()})
    with pytest.raises(ConfigError, match="use state_noise 'physical'"):
        train([episodes()], policy_config, tasks, config, seed=0)


@pytest.mark.parametrize("device", ["cuda:99", "gpu"])
def test_a_device_that_is_not_there_is_named_before_anything_else(tasks, policy_config, training_config, device):
    with pytest.raises(ConfigError, match=f"cannot use the device '{device}' .*set JUICER_DEVICE to cpu"):
        train([], policy_config, tasks, training_config, seed=0, device=device)


def test_a_loss_that_is_no_number_ends_the_training(episodes, tasks, policy_config, training_config):
    config = training_config.model_copy(update={"learning_rate": 1e30, "warmup_steps": 0})
    with pytest.raises(TrainingFailed, match=r"lower training\.learning_rate"):
        train([episodes()], policy_config, tasks, config, seed=0)


def test_one_policy_learns_several_tasks(episodes, tasks, policy_config, training_config):
    both = {"toy": tasks["toy"], "other": tasks["toy"]}

    def shown(task, seed):
        data = episodes(seed=seed, family=task)
        return dataclasses.replace(data, observations=as_shown(data.observations, both, task))

    trained = train([shown("toy", 0), shown("other", 1)], policy_config, both, training_config, seed=3)
    assert list(trained.checkpoint.metadata.tasks) == ["toy", "other"]
    assert trained.facts["num_windows"] > 100
    assert trained.checkpoint.weights["encoders.embedding.weight"].shape == (2, policy_config.task_embedding)


@pytest.mark.parametrize("weight", [1.0, 0.25])
def test_weights_that_are_alike_change_nothing(policy_config, training_config, tasks, episodes, weight):
    plain = train([episodes()], policy_config, tasks, training_config, seed=3)
    weighed = dataclasses.replace(episodes(), weights=[weight] * 5)
    assert_equal_checkpoints(
        train([weighed], policy_config, tasks, training_config, seed=3).checkpoint, plain.checkpoint
    )


def test_weights_change_what_is_learned(policy_config, training_config, tasks, episodes):
    curves = [Curves(), Curves()]
    for weight, metrics in zip((1.0, 100.0), curves, strict=True):
        weighed = dataclasses.replace(episodes(), weights=[1.0, 1.0, 1.0, 1.0, weight])
        train([weighed], policy_config, tasks, training_config, seed=3, metrics=metrics)
    assert curves[0].points != curves[1].points


def test_a_training_goes_on_from_the_weights_that_act_and_their_limits(
    episodes, tasks, policy_config, training_config, tmp_path
):
    first = train([episodes()], policy_config, tasks, training_config, seed=0)
    save_checkpoint(tmp_path / "first", first.checkpoint)
    # Of farther away: the limits of these alone would be others.
    more = [episodes(), episodes(seed=9, family="own", source="rollout")]
    few = training_config.model_copy(update={"steps": 1, "warmup_steps": 0, "learning_rate": 1e-9})
    further = train(more, policy_config, tasks, few, seed=0, start=tmp_path / "first").checkpoint
    known, start = further.weights, first.checkpoint.ema
    assert known.keys() == start.keys()
    for name, values in start.items():
        torch.testing.assert_close(known[name], values, atol=1e-6, rtol=0)
    anew = train(more, policy_config, tasks, few, seed=0).checkpoint
    assert any(not torch.equal(anew.weights[name], values) for name, values in start.items() if "normalizer" in name)


def test_a_training_goes_on_from_the_same_policy_only(episodes, tasks, policy_config, training_config, tmp_path):
    save_checkpoint(tmp_path, train([episodes()], policy_config, tasks, training_config, seed=0).checkpoint)
    other = policy_config.model_copy(update={"action_frame": "absolute"})
    with pytest.raises(ConfigError, match="goes on only from the same policy for the same tasks"):
        train([episodes()], other, tasks, training_config, seed=0, start=tmp_path)
