"""The presets of the repository say what they claim to say."""

from pathlib import Path

import pytest

from juicer.config import StrictConfig, parse_config, read_mapping
from juicer.policy.config import PolicyConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.training.config import TrainingConfig

PRESETS = Path(__file__).parent.parent / "configs" / "presets"


class Preset(StrictConfig):
    policy: PolicyConfig
    training: TrainingConfig


def presets(name):
    sections = read_mapping(PRESETS / f"{name}.yaml")["policies"]
    return {policy: parse_config(section, Preset, origin=policy) for policy, section in sections.items()}


@pytest.mark.parametrize("name", ["paper", "laptop", "smoke"])
def test_every_preset_holds_the_three_policies_of_the_comparison(name):
    sections = presets(name)
    assert set(sections) - {"multitask"} == {"diffusion", "mlp_chunked", "mlp_unchunked"}
    assert isinstance(sections["diffusion"].policy.head, DiffusionConfig)
    assert isinstance(sections["mlp_chunked"].policy.head, MLPHeadConfig)
    assert sections["mlp_chunked"].policy.horizons == sections["diffusion"].policy.horizons
    unchunked = sections["mlp_unchunked"].policy.horizons
    assert (unchunked.pred, unchunked.action) == (1, 1)


def test_the_paper_preset_is_the_defaults_of_the_code():
    paper = presets("paper")["diffusion"]
    # Of one task alone, the limits of all tasks together are its own.
    assert paper.policy == PolicyConfig(observation={"state": FeaturesConfig(normalisation="together")})
    assert paper.training == TrainingConfig()
    assert paper.policy.head.denoiser == UNetConfig()


@pytest.mark.parametrize("name", ["laptop", "smoke"])
def test_no_step_of_an_episode_goes_unused_with_the_presets_for_small_machines(name):
    for preset in presets(name).values():
        horizons = preset.policy.horizons
        assert preset.training.windows.back_padding >= horizons.pred - horizons.obs
