"""An estimator learns, goes on where it was killed, and says how far off it is."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch

from juicer.errors import TrainingFailed
from juicer.estimation import learning
from juicer.estimation.drawn import DrawnStates
from juicer.estimation.learning import (
    AVERAGE_DECAY,
    LARGEST_GRADIENT,
    WARMUP_STEPS,
    WEIGHT_DECAY,
    learn,
    measure,
)
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.backbones.resnet.config import ResNetConfig
from juicer.policy.config import FeatureSpec, PairSpec
from juicer.policy.encoders.estimated.config import EstimatedConfig, EstimatorConfig
from juicer.policy.encoders.estimated.estimator import build_estimator
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.features import state_features
from juicer.policy.feature_spec import feature_spec
from juicer.policy.torch_settings import compute_settings
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import TASK_NAMES
from juicer.tasks.specification import Grasp, Insertion
from juicer.training.optimisation import Optimisation, Schedule
from juicer.views import View

VIEW = View(camera="front", width=16, height=16)
CRITICAL_STATES = (("grasp leg", Grasp(1)), ("insert leg", Insertion(0)))


def spec(num_pairs=1):
    pair = PairSpec(first=0, second=1, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
    return FeatureSpec(num_parts=2, pairs=(pair,) * num_pairs, mounted_m=0.005, mounted_cosine=0.94)


def configuration(**changes):
    small = {"steps": 40, "batch_size": 16, "width": 32, "threads": 1, "views": {"front": VIEW}}
    backbone = PatchCNNConfig(quarter=8, eighth=8, quarter_blocks=0, eighth_blocks=1, maps=4)
    return EstimatedConfig(estimator=EstimatorConfig(backbone=backbone, **{**small, **changes}))


def drawn_states(number=64, seed=0):
    """States whose images tell where the second part is by their brightness."""
    rng = np.random.default_rng(seed)
    brightness = rng.integers(0, 256, number)
    images = np.broadcast_to(brightness[:, None, None, None], (number, 16, 16, 3)).astype(np.uint8)
    proprioception = np.zeros((number, 16), np.float32)
    proprioception[:, 3:9] = (1, 0, 0, 0, 1, 0)
    poses = np.tile(np.array([0, 0, 0, 1, 0, 0, 0], np.float32), (number, 2))
    poses[:, 7] = brightness / 255 * 0.1
    observations = {"proprioception": proprioception, "part_poses": poses}
    return DrawnStates({VIEW.name: images}, observations, rng.integers(-1, 2, number))


def learned(config, scratch=None, **changes):
    return learn(
        build_estimator(config, "toy", spec(), seed=0),
        drawn_states(), drawn_states(32, seed=1), CRITICAL_STATES, seed=0, identity="x", scratch=scratch, **changes,
    )  # fmt: skip


def test_it_learns_where_a_part_is():
    config = configuration(steps=400)
    before = measure(build_estimator(config, "toy", spec(), seed=0), drawn_states(32, seed=1), CRITICAL_STATES)
    errors = learned(config).errors
    assert errors.loss < 0.2 * before.loss
    assert errors.error_mm["insert leg"] < 10
    assert set(errors.error_mm) == set(errors.error_deg) == {"grasp leg", "insert leg"}


@pytest.mark.parametrize(("precision", "used"), [("fp32", torch.float32), ("bf16", torch.bfloat16)])
def test_it_learns_in_the_precision_that_is_set(precision, used):
    estimator = build_estimator(configuration(steps=1, precision=precision), "toy", spec(), seed=0)
    seen = []
    estimator.choice.register_forward_hook(lambda module, shown, answer: seen.append(answer.dtype))
    facts = learn(estimator, drawn_states(), drawn_states(32), CRITICAL_STATES, seed=0, identity="x").facts
    assert facts == {"device": "cpu", "precision": precision}
    assert seen[0] is used


def test_measuring_looks_at_every_image_once():
    estimator = build_estimator(configuration(), "toy", spec(), seed=0)
    looked_at = []
    estimator.backbones[0].register_forward_hook(lambda module, shown, answer: looked_at.append(len(answer)))
    measure(estimator, drawn_states(32), CRITICAL_STATES)
    assert looked_at == [32]


def test_a_loss_that_is_no_number_is_told_with_its_remedy():
    estimator = build_estimator(configuration(), "toy", spec(), seed=0)
    torch.nn.init.constant_(estimator.choice.weight, float("nan"))
    with pytest.raises(TrainingFailed, match=r"no longer a number by step 40; lower learning_rate of the estimator"):
        learn(estimator, drawn_states(), drawn_states(32), CRITICAL_STATES, seed=0, identity="x")


def test_a_true_estimate_has_no_error():
    class Knowing(torch.nn.Module):
        def __init__(self, estimator, shown):
            super().__init__()
            self.config, self.normalizer, self.spec = estimator.config, estimator.normalizer, estimator.spec
            self.see, self.compute_loss = estimator.see, estimator.compute_loss
            observations = {name: torch.from_numpy(values) for name, values in shown.observations.items()}
            self.true = state_features(observations, spec(), estimator.config.features)

        def features(self, seen, proprioception):
            return self.true

    shown = drawn_states(32)
    errors = measure(Knowing(build_estimator(configuration(), "toy", spec(), seed=0), shown), shown, CRITICAL_STATES)
    assert set(errors.error_mm.values()) == {0}


@pytest.mark.parametrize("pairs", ["next", "all"])
def test_the_error_at_a_critical_state_is_that_of_its_own_pair(pairs):
    """Estimates are true but for the pair that comes last, whose target is elsewhere than that of the others."""
    first = PairSpec(first=0, second=1, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
    last = PairSpec(first=0, second=2, target=(0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0))
    both = FeatureSpec(num_parts=3, pairs=(first, last), mounted_m=0.005, mounted_cosine=0.94)
    config = configuration().model_copy(update={"features": FeaturesConfig(pairs=pairs)})
    shown = drawn_states(32)
    poses = np.concatenate([shown.observations["part_poses"], shown.observations["part_poses"][:, 7:]], axis=1)
    drawn = replace(
        shown,
        observations={**shown.observations, "part_poses": poses},
        critical_states=np.arange(32).astype(shown.critical_states.dtype) % 2,
    )
    estimator = build_estimator(config, "toy", both, seed=0)
    wrong = {name: torch.from_numpy(values.copy()) for name, values in drawn.observations.items()}
    wrong["part_poses"][:, 14] += 0.02
    estimator.features = lambda seen, proprioception: state_features(wrong, both, config.features)
    states = (("insert first", Insertion(0)), ("insert last", Insertion(1)))
    errors = measure(estimator, drawn, states).error_mm
    if pairs == "all":
        assert errors == {"insert first": pytest.approx(0, abs=0.01), "insert last": pytest.approx(20, abs=0.1)}
    else:
        assert errors["insert first"] == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(("backbone", "threads"), [(PatchCNNConfig(), 2), (ResNetConfig(norm="batch"), 1)])
def test_threads_share_no_batch_whose_statistics_they_would_change_in_any_order(backbone, threads, monkeypatch):
    pools = []

    class Counted(ThreadPoolExecutor):
        def __init__(self, max_workers):
            pools.append(max_workers)
            super().__init__(max_workers)

    monkeypatch.setattr("juicer.estimation.learning.ThreadPoolExecutor", Counted)
    estimator = configuration(steps=1, batch_size=64, threads=2).estimator.model_copy(update={"backbone": backbone})
    one, two = (learned(EstimatedConfig(estimator=estimator)).estimator.state_dict() for _ in range(2))
    assert pools == [threads, threads]
    for name, value in one.items():
        torch.testing.assert_close(two[name], value, rtol=0, atol=0, msg=name)


def test_a_killed_training_goes_on_to_the_same_weights(tmp_path, monkeypatch):
    monkeypatch.setattr("juicer.estimation.learning.SAVE_EVERY", 10)
    monkeypatch.setattr("juicer.estimation.learning.REPORT_EVERY", 5)
    whole = learned(configuration()).estimator

    class Killed(Exception):
        pass

    def stop(done, total, **facts):
        if done == 25:
            raise Killed

    with pytest.raises(Killed):
        learned(configuration(), scratch=tmp_path, progress=stop)
    seen = []
    resumed = learned(configuration(), scratch=tmp_path, progress=lambda done, *_, **__: seen.append(done)).estimator
    assert seen[0] == 25
    for name, value in whole.state_dict().items():
        torch.testing.assert_close(resumed.state_dict()[name], value, rtol=0, atol=0, msg=name)


@pytest.mark.parametrize("threads", [1, 2])
def test_its_steps_are_those_of_a_plain_optimiser(threads, monkeypatch):
    # Processors with matrix instructions round factors to bfloat16 in training.
    monkeypatch.setattr(learning, "compute_settings", lambda threads, _: compute_settings(threads, "highest"))
    config = configuration(steps=3, threads=threads, precision="fp32", batch_size=64)
    drawn = drawn_states()
    plain = build_estimator(config, "toy", spec(), seed=0)
    observations = {name: torch.from_numpy(values) for name, values in drawn.observations.items()}
    features = state_features(observations, plain.spec, config.features)
    plain.normalizer.fit(features)
    images = [torch.from_numpy(drawn.images[VIEW.name].copy())]
    schedule = Schedule(config.estimator.learning_rate, WARMUP_STEPS, config.estimator.steps)
    optimisation = Optimisation(plain, schedule, weight_decay=WEIGHT_DECAY, average_decay=AVERAGE_DECAY)
    for step in range(3):
        optimisation.forget_gradients()
        plain.compute_loss(plain.see(images, features[:, :16]), features).backward()
        torch.nn.utils.clip_grad_norm_(plain.parameters(), LARGEST_GRADIENT)
        optimisation.step(step)

    network = build_estimator(config, "toy", spec(), seed=0)
    learn(network, drawn, drawn_states(32, seed=1), CRITICAL_STATES, seed=0, identity="x")
    for name, value in plain.state_dict().items():
        torch.testing.assert_close(network.state_dict()[name], value, rtol=1e-3, atol=1e-5, msg=name)


def test_threads_share_a_batch_and_change_nothing_but_last_digits():
    one, two = (learned(configuration(steps=3, threads=threads)).estimator for threads in (1, 2))
    for name, value in one.state_dict().items():
        torch.testing.assert_close(two.state_dict()[name], value, rtol=1e-2, atol=1e-3, msg=name)


def test_of_several_pairs_one_is_chosen_and_never_a_blend():
    estimator = build_estimator(configuration(), "toy", spec(num_pairs=3), seed=0)
    shown = drawn_states(8)
    estimates = estimator(
        {
            "proprioception": torch.from_numpy(shown.observations["proprioception"]),
            VIEW.name: torch.from_numpy(shown.images[VIEW.name].copy()),
        }
    )
    which = estimates[:, -2:]
    assert ((which == 0) | (which == 1)).all()
    assert (which.sum(dim=-1) <= 1).all()


@pytest.mark.parametrize("task", TASK_NAMES)
def test_the_features_of_every_task_are_estimated_in_their_places(task):
    env = AssemblyEnv(task)
    observations = [env.reset(seed=seed)[0] for seed in range(4)]
    shown = {name: torch.from_numpy(np.stack([each[name] for each in observations])) for name in observations[0]}
    config = configuration()
    estimator = build_estimator(config, task, feature_spec(task), seed=0)
    features = state_features(shown, estimator.spec, config.features)
    estimator.normalizer.fit(features)
    images = torch.zeros(4, VIEW.height, VIEW.width, 3, dtype=torch.uint8)
    estimates = estimator({"proprioception": shown["proprioception"], VIEW.name: images})
    assert estimates.shape == features.shape
    torch.testing.assert_close(estimates[:, :16], features[:, :16])
    assert estimator.compute_loss(estimator.see([images], features[:, :16]), features).isfinite()


def test_it_learns_which_pair_is_next():
    choices = torch.arange(12).remainder(3)
    which = torch.nn.functional.one_hot(choices, 3)[:, 1:].float()
    estimator = build_estimator(configuration(), "toy", spec(num_pairs=3), seed=0)
    features = torch.cat([torch.zeros(12, estimator.normalizer.offset.shape[0] - 2), which], dim=-1)
    images = (120 * choices[:, None, None, None]).expand(12, 16, 16, 3).to(torch.uint8)
    optimizer = torch.optim.AdamW(estimator.parameters(), lr=1e-2)
    for _ in range(60):
        optimizer.zero_grad()
        estimator.compute_loss(estimator.see([images], features[:, :16]), features).backward()
        optimizer.step()
    estimates = estimator({"proprioception": features[:, :16], VIEW.name: images})
    torch.testing.assert_close(estimates[:, -2:], which)
