"""The presets of the repository say what they claim to say."""

import math

import pytest
import torch

from flows.runs import load_runs
from flows.shipped import PRESETS, names
from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.heads.mlp.config import MLPHeadConfig
from juicer.policy.network import PolicyNetwork
from juicer.training.config import TrainingConfig

MOUNTED = {"mounted_m": 0.005, "mounted_cosine": 0.94}


def presets(name):
    return read_preset(name).policies


def read_preset(name):
    (run,) = load_runs(PRESETS / f"{name}.yaml")
    return run


@pytest.mark.parametrize("name", names(PRESETS))
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
    # Of one task alone, the limits of all tasks together are its own. The original shows parts as they lie.
    original = FeaturesConfig(normalisation="together", symmetry=False)
    assert paper.policy == PolicyConfig(observation={"state": original})
    assert paper.training == TrainingConfig()
    assert paper.policy.head.denoiser == UNetConfig()


@pytest.mark.parametrize(("name", "states"), [("paper_image", "paper"), ("laptop_image", "laptop")])
def test_a_preset_on_images_differs_from_that_on_states_in_what_is_seen_alone(name, states):
    seeing, told = read_preset(name), read_preset(states)
    for policy, preset in seeing.policies.items():
        assert preset.training == told.policies[policy].training
        assert preset.policy.views_seen
        assert preset.policy.model_copy(update={"observation": told.policies[policy].policy.observation}) == (
            told.policies[policy].policy
        )
    assert seeing.name == f"juicer_{name}"
    assert seeing.model_copy(update={"policies": told.policies, "name": told.name}) == told


def test_the_paper_policy_on_images_has_as_many_weights_as_the_original():
    policy = presets("paper_image")["diffusion"].policy
    assert [str(view) for view in policy.learned_views] == ["wrist whole 224x224", "front static 280x240"]
    tasks = {"one_leg": FeatureSpec(num_parts=2, pairs=(PairSpec(first=0, second=1, target=(0,) * 7),), **MOUNTED)}
    with torch.device("meta"):
        network = PolicyNetwork(policy, tasks)
    assert sum(weights.numel() for weights in network.parameters()) == 91_607_946
    assert sum(math.prod(size) for size in network.encoders.sizes.values()) == 272


@pytest.mark.parametrize("name", ["laptop", "laptop_image", "laptop_image_e2e", "smoke"])
def test_no_step_of_an_episode_goes_unused_with_the_presets_for_small_machines(name):
    for preset in presets(name).values():
        horizons = preset.policy.horizons
        assert preset.training.windows.back_padding >= horizons.pred - horizons.obs
