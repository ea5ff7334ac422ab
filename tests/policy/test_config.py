import pytest
from pydantic import ValidationError

from juicer.config import parse_config
from juicer.errors import ConfigError
from juicer.policy.config import HorizonConfig, PolicyConfig, rough_parameters
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import build_policy


def test_the_defaults_are_the_paper_policy():
    config = PolicyConfig()
    assert (config.horizons.obs, config.horizons.pred, config.horizons.action) == (1, 32, 8)
    assert config.head.denoiser == UNetConfig(channels=(256, 512, 1024), kernel_size=5, groups=8, step_embedding=256)
    assert config.head.prediction == "epsilon"
    assert config.action_frame == "absolute"


def test_the_kind_of_the_head_chooses_its_settings():
    config = parse_config({"head": {"kind": "mlp", "width": 64}}, PolicyConfig, origin="test")
    assert config.head == MLPHeadConfig(width=64)


def test_a_setting_of_another_head_is_refused():
    with pytest.raises(ConfigError, match="unknown key"):
        parse_config({"head": {"kind": "mlp", "inference_steps": 8}}, PolicyConfig, origin="test")


def test_a_chunk_must_cover_what_is_executed():
    with pytest.raises(ValidationError, match="must not exceed pred"):
        HorizonConfig(obs=2, pred=8, action=8)


@pytest.mark.parametrize(
    "head", [{"kind": "diffusion"}, {"kind": "mlp"}, {"denoiser": {"kind": "mlp"}, "kind": "diffusion"}]
)
def test_the_size_of_a_policy_is_known_to_within_a_twentieth_before_it_is_built(head, spec):
    config = parse_config({"head": head}, PolicyConfig, origin="test")
    assert rough_parameters(config) == pytest.approx(build_policy(config, {"toy": spec}, 0).num_parameters, rel=0.05)


def test_a_policy_larger_than_memory_is_refused():
    channels = {"kind": "diffusion", "denoiser": {"kind": "unet", "channels": [4096, 8192, 16384]}}
    with pytest.raises(ConfigError, match=r"a policy of about .* weights is too large; at most 500,000,000 are taken"):
        parse_config({"head": channels}, PolicyConfig, origin="test")


def test_a_unet_needs_a_length_it_can_halve_twice():
    with pytest.raises(ValidationError, match="multiple of 4"):
        PolicyConfig(horizons=HorizonConfig(pred=30))


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"kernel_size": 4}, "kernel_size must be odd"), ({"channels": (12, 512, 1024)}, "multiples of groups")],
)
def test_impossible_unet_layers_are_refused(settings, message):
    with pytest.raises(ValidationError, match=message):
        UNetConfig(**settings)
