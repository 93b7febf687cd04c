"""Scandot encoders against a loop over tokens, and their invariances."""

import pytest
import torch

from spin_rl.models import NoPointNet, PointNet


def make_tokens(device, num_steps=3, num_envs=5, num_tokens=6):
    """Tokens with between none and all of them valid, and some flags of the valid ones unset."""
    generator = torch.Generator().manual_seed(0)
    tokens = torch.randn(num_steps, num_envs, num_tokens, 32, generator=generator)
    flags = torch.rand(num_steps, num_envs, num_tokens, 8, generator=generator) < 0.1
    flags[0, 0] = False
    flags[0, 1] = True
    tokens[..., 24:] = flags.float()
    return tokens.to(device)


def encode_by_loop(net, tokens):
    latents = []
    for sample in tokens.flatten(0, -3):
        chosen = [net.mlp(token) for token in sample if token[24:].any()]
        latents.append(torch.stack(chosen).max(dim=0).values if chosen else tokens.new_zeros(net.latent))
    return torch.stack(latents).view(*tokens.shape[:-2], net.latent)


def test_latent_is_the_maximum_over_the_valid_tokens(device):
    torch.manual_seed(0)
    net, tokens = PointNet().to(device), make_tokens(device)
    expected = encode_by_loop(net, tokens)
    assert (expected == 0).all(dim=-1).sum() >= 1  # the case of no valid token is among them
    torch.testing.assert_close(net(tokens), expected)


def test_gradients_match_the_loop(device):
    torch.manual_seed(0)
    net, tokens = PointNet(hidden=(16,)).to(device), make_tokens(device)
    weights = torch.randn(3, 5, 16, device=device)
    expected = torch.autograd.grad((encode_by_loop(net, tokens) * weights).sum(), list(net.parameters()))
    found = torch.autograd.grad((net(tokens) * weights).sum(), list(net.parameters()))
    torch.testing.assert_close(found, expected)


def test_order_of_obstacles_does_not_matter(device):
    net, tokens = PointNet().to(device), make_tokens(device)
    torch.testing.assert_close(net(tokens[:, :, torch.randperm(6)]), net(tokens))


def test_latent_is_zero_and_gradients_finite_without_valid_tokens(device):
    net, tokens = PointNet().to(device), make_tokens(device)
    tokens[..., 24:] = 0.0
    latent = net(tokens)
    latent.sum().backward()
    assert (latent == 0).all()
    assert all(p.grad is None or p.grad.isfinite().all() for p in net.parameters())


@pytest.mark.parametrize("flag", range(8))
def test_one_flag_makes_a_token_valid(device, flag):
    net, tokens = PointNet().to(device), make_tokens(device)
    tokens[..., 24:] = 0.0
    tokens[..., 2, 24 + flag] = 1.0
    torch.testing.assert_close(net(tokens), net.mlp(tokens[..., 2, :]))


def test_concatenation_depends_on_the_order(device):
    net, tokens = NoPointNet(6).to(device), make_tokens(device)
    assert net(tokens).shape == (3, 5, 16)
    assert not torch.allclose(net(tokens.flip(2)), net(tokens))
