import torch

from juicer.policy.encoder import build_encoder
from juicer.policy.encoders.proprioception.config import ProprioceptionConfig


def test_proprioception_is_scaled_to_what_was_seen_and_bounded(tasks, observe):
    encoder = build_encoder(ProprioceptionConfig(clip=2.0), tasks, obs_horizon=2)
    seen = {"proprioception": torch.from_numpy(observe(40)["proprioception"]).view(20, 2, 16)}
    encoder.fit(seen)
    tokens = encoder(encoder.prepare(seen))
    assert tokens.shape == (20, *encoder.token_size) == (20, 2, 16)
    assert torch.allclose(tokens.amin((0, 1)), torch.tensor(-1.0))
    assert torch.allclose(tokens.amax((0, 1)), torch.tensor(1.0))
    far = encoder.prepare({"proprioception": 100 + seen["proprioception"]})
    assert torch.equal(far, torch.full((20, 2, 16), 2.0))
