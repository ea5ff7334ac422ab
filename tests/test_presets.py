"""The presets of the repository say what they claim to say."""

import math
from pathlib import Path

import pytest
import torch

from juicer.config import StrictConfig, parse_config, read_mapping
from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import PolicyNetwork
from juicer.training.config import TrainingConfig

MOUNTED = {"mounted_m": 0.005, "mounted_cosine": 0.94}
PRESETS = Path(__file__).parent.parent / "configs" / "presets"


class Preset(StrictConfig):
    policy: PolicyConfig
    training: TrainingConfig


def presets(name):
    sections = read_mapping(PRESETS / f"{name}.yaml")["policies"]
    return {policy: parse_config(section, Preset, origin=policy) for policy, section in sections.items()}


@pytest.mark.parametrize("name", ["paper", "paper_image", "laptop", "laptop_image_e2e", "smoke"])
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


def test_the_paper_preset_on_images_differs_in_what_is_seen_alone():
    states, images = presets("paper"), presets("paper_image")
    for name, preset in images.items():
        assert preset.training == states[name].training
        assert preset.policy.model_copy(update={"observation": {}}) == states[name].policy.model_copy(
            update={"observation": {}}
        )
    shipped = {name: read_mapping(PRESETS / f"{name}.yaml") for name in ("paper", "paper_image")}
    for section in ("augment", "augment_retraining"):
        assert shipped["paper"][section] == shipped["paper_image"][section]


def test_the_paper_policy_on_images_has_as_many_weights_as_the_original():
    policy = presets("paper_image")["diffusion"].policy
    assert [str(view) for view in policy.learned_views] == ["wrist whole 224x224", "front static 280x240"]
    tasks = {"one_leg": FeatureSpec(num_parts=2, pairs=(PairSpec(first=0, second=1, target=(0,) * 7),), **MOUNTED)}
    with torch.device("meta"):
        network = PolicyNetwork(policy, tasks)
    assert sum(weights.numel() for weights in network.parameters()) == 91_607_946
    assert sum(math.prod(size) for size in network.encoders.sizes.values()) == 272


@pytest.mark.parametrize("name", ["laptop", "laptop_image_e2e", "smoke"])
def test_no_step_of_an_episode_goes_unused_with_the_presets_for_small_machines(name):
    for preset in presets(name).values():
        horizons = preset.policy.horizons
        assert preset.training.windows.back_padding >= horizons.pred - horizons.obs
