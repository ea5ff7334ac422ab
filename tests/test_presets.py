"""The presets of the repository say what they claim to say."""

from pathlib import Path

import pytest

from juicer.config import StrictConfig, parse_config, read_mapping
from juicer.policy.config import DiffusionConfig, MLPConfig, PolicyConfig, UNetConfig
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
    assert isinstance(sections["mlp_chunked"].policy.head, MLPConfig)
    assert sections["mlp_chunked"].policy.horizons == sections["diffusion"].policy.horizons
    unchunked = sections["mlp_unchunked"].policy.horizons
    assert (unchunked.pred, unchunked.action) == (1, 1)


def test_the_paper_preset_is_the_defaults_of_the_code():
    paper = presets("paper")["diffusion"]
    assert paper.policy == PolicyConfig()
    assert paper.training == TrainingConfig()
    assert paper.policy.head.denoiser == UNetConfig()


@pytest.mark.parametrize("name", ["laptop", "smoke"])
def test_no_step_of_an_episode_goes_unused_with_the_presets_for_small_machines(name):
    for preset in presets(name).values():
        horizons = preset.policy.horizons
        assert preset.training.windows.back_padding >= horizons.pred - horizons.obs
