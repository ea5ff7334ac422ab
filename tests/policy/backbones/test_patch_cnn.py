import pytest
import torch

from juicer.policy.backbone import SpatialSoftmax, build_backbone
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig


@pytest.mark.parametrize("size", [(96, 96), (64, 128), (24, 32), (8, 8)])
@pytest.mark.parametrize("settings", [{}, {"quarter_blocks": 0, "maps": 5, "grid": 2, "eighth": 16}])
def test_features_have_the_length_that_was_said_whatever_the_size(size, settings):
    config = PatchCNNConfig(**settings)
    backbone = build_backbone(config, size)
    assert backbone(torch.zeros(2, 3, *size)).shape == (2, config.num_features)


@pytest.mark.parametrize("settings", [{}, {"quarter": 128, "eighth": 256, "eighth_blocks": 4}])
def test_its_size_is_known_before_it_is_built(settings):
    config = PatchCNNConfig(**settings)
    parameters = sum(each.numel() for each in build_backbone(config, (96, 96)).parameters())
    assert config.rough_parameters() == pytest.approx(parameters, rel=0.01)


def test_an_image_that_is_not_made_of_whole_patches_is_refused():
    with pytest.raises(ValueError, match="multiples of 8 pixels"):
        PatchCNNConfig().check_size(96, 100)


def test_it_sees_the_same_however_images_lie_in_memory():
    backbone = build_backbone(PatchCNNConfig(), (32, 32))
    images = torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(backbone(images.contiguous(memory_format=torch.channels_last)), backbone(images))


def test_the_place_of_a_bright_spot_is_told_to_the_pixel_also_in_bfloat16():
    softmax = SpatialSoftmax(1, 1)
    torch.nn.init.constant_(softmax.maps.weight, 100.0)
    image = torch.zeros(1, 1, 101, 201)
    image[0, 0, 25, 150] = 1
    with torch.autocast("cpu", torch.bfloat16):
        assert softmax(image).tolist() == [pytest.approx([0.5, -0.5], abs=1e-4)]
