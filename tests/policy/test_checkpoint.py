import json

import numpy as np
import pytest
import torch

from juicer.errors import ConfigError, InvalidCheckpoint
from juicer.policy.checkpoint import Checkpoint, CheckpointMetadata, load_checkpoint, load_policy, save_checkpoint
from juicer.policy.config import PolicyConfig, sampled_in
from juicer.policy.denoisers.mlp.config import MLPDenoiserConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import build_policy

CONFIG = PolicyConfig(head=DiffusionConfig(denoiser=MLPDenoiserConfig(width=16, blocks=1), prediction="sample"))


@pytest.fixture
def checkpoint(spec, observe):
    states = []
    for seed in (1, 2):
        network = build_policy(CONFIG, {"toy": spec}, seed)
        network.encoders.fit({name: torch.from_numpy(values) for name, values in observe(50).items()})
        states.append(network.state_dict())
    metadata = CheckpointMetadata(policy=CONFIG, tasks={"toy": spec}, acting_weights="ema", step=10)
    return Checkpoint(metadata, weights=states[0], ema=states[1])


def act(policy, observations):
    return policy.predict(observations, [np.random.default_rng(0) for _ in range(3)])


def test_a_policy_acts_the_same_after_saving_and_loading(checkpoint, observe, tmp_path):
    save_checkpoint(tmp_path, checkpoint)
    loaded = load_policy(tmp_path, "toy")
    np.testing.assert_array_equal(act(loaded, observe(3)), act(checkpoint.policy("toy"), observe(3)))


def test_a_chunk_is_sampled_in_other_steps_than_configured_if_asked(checkpoint, observe, tmp_path):
    save_checkpoint(tmp_path, checkpoint)
    own = load_policy(tmp_path, "toy")
    np.testing.assert_array_equal(
        act(load_policy(tmp_path, "toy", inference_steps=CONFIG.head.inference_steps), observe(3)), act(own, observe(3))
    )
    assert not np.array_equal(act(load_policy(tmp_path, "toy", inference_steps=1), observe(3)), act(own, observe(3)))
    with pytest.raises(ConfigError, match="head 'diffusion': inference_steps must not exceed train_timesteps, got 101"):
        load_policy(tmp_path, "toy", inference_steps=101)


def test_a_head_without_steps_is_not_asked_for_other_ones():
    with pytest.raises(ConfigError, match="a head of kind 'mlp' has no inference_steps"):
        sampled_in(PolicyConfig(head=MLPHeadConfig()), 4)


def test_the_moving_average_acts_if_the_checkpoint_says_so(checkpoint, observe, spec, tmp_path):
    metadata = checkpoint.metadata.model_copy(update={"acting_weights": "raw"})
    raw = Checkpoint(metadata, checkpoint.weights, checkpoint.ema)
    assert not np.array_equal(act(raw.policy("toy"), observe(3)), act(checkpoint.policy("toy"), observe(3)))


def test_a_checkpoint_is_safetensors_and_json_and_nothing_else(checkpoint, tmp_path):
    save_checkpoint(tmp_path, checkpoint)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ema.safetensors", "policy.json", "weights.safetensors"]
    loaded = load_checkpoint(tmp_path)
    assert loaded.metadata == checkpoint.metadata
    assert all(torch.equal(loaded.weights[name], value) for name, value in checkpoint.weights.items())


def schema(version):
    def damage(folder):
        content = json.loads((folder / "policy.json").read_text())
        (folder / "policy.json").write_text(json.dumps({**content, "schema_version": version}))

    return damage


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "policy.json").unlink(), "is not a checkpoint"),
        (lambda folder: (folder / "policy.json").write_text("{"), "cannot be read"),
        (lambda folder: (folder / "policy.json").write_text('{"schema_version": 5}'), "is not valid: policy"),
        (schema(99), "schema version 99, .* use the version of juicer that wrote it"),
        (schema(4), "schema version 4, .* train the policy again"),
        (lambda folder: (folder / "ema.safetensors").unlink(), "cannot be read"),
        (lambda folder: (folder / "ema.safetensors").write_bytes(b"1234"), "cannot be read"),
    ],
)
def test_a_damaged_checkpoint_is_refused_with_a_sentence(checkpoint, tmp_path, damage, message):
    save_checkpoint(tmp_path, checkpoint)
    damage(tmp_path)
    with pytest.raises(InvalidCheckpoint, match=message):
        load_policy(tmp_path, "toy")


def test_weights_that_do_not_fit_their_configuration_are_refused(checkpoint, tmp_path):
    save_checkpoint(tmp_path, Checkpoint(checkpoint.metadata, checkpoint.weights, {"stem": torch.zeros(1)}))
    with pytest.raises(InvalidCheckpoint, match="does not fit"):
        load_policy(tmp_path, "toy")


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without a GPU")
def test_a_device_that_is_not_there_is_refused_before_anything_acts(checkpoint, tmp_path):
    save_checkpoint(tmp_path, checkpoint)
    with pytest.raises(ConfigError, match="torch cannot use the device 'cuda'"):
        load_policy(tmp_path, "toy", device="cuda")


def test_a_policy_computes_on_the_device_it_is_given(checkpoint, observe):
    # The device without memory stands in for a GPU: whatever were left on the processor could not be combined with it.
    policy = checkpoint.policy("toy", device="meta")
    with pytest.raises(NotImplementedError, match="meta"):
        act(policy, observe(3))
    assert {value.device.type for value in policy._network.state_dict().values()} == {"meta"}
