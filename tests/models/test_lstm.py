"""The LSTM with resets against single steps, autograd and rsl_rl's padded episodes."""

import pytest
import torch
from rsl_rl.utils import split_and_pad_trajectories, unpad_trajectories

from spin_rl.models import ResettableLSTM

STEPS, ENVS, INPUTS, HIDDEN = 7, 5, 4, 6


@pytest.fixture
def case(device):
    torch.manual_seed(0)
    lstm = ResettableLSTM(INPUTS, HIDDEN).to(device)
    x = torch.randn(STEPS, ENVS, INPUTS, device=device, requires_grad=True)
    state = (torch.randn(1, ENVS, HIDDEN, device=device), torch.randn(1, ENVS, HIDDEN, device=device))
    resets = torch.rand(STEPS, ENVS, device=device) < 0.3
    resets[0] = False
    assert resets.any()
    return lstm, x, state, resets


def run_by_cells(lstm, x, state, resets):
    weights = [
        getattr(lstm.rnn, name) for name in ("weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0")
    ]
    h, c = state[0][0], state[1][0]
    out = []
    for x_t, reset in zip(x, resets, strict=True):
        keep = (~reset).float().unsqueeze(1)
        h, c = torch.lstm_cell(x_t, (h * keep, c * keep), *weights)
        out.append(h)
    return torch.stack(out)


def test_sequence_and_its_gradients_match_cells(case):
    lstm, x, state, resets = case
    inputs = [x, *lstm.parameters()]
    weights = torch.randn(STEPS, ENVS, HIDDEN, device=x.device)
    expected, found = run_by_cells(lstm, x, state, resets), lstm.sequence(x, state, resets)
    torch.testing.assert_close(found, expected)
    torch.testing.assert_close(
        torch.autograd.grad((found * weights).sum(), inputs),
        torch.autograd.grad((expected * weights).sum(), inputs),
    )


def test_sequence_matches_padded_episodes(case):
    lstm, x, state, resets = case
    dones = torch.zeros(STEPS, ENVS, dtype=torch.long, device=x.device)
    dones[:-1] = resets[1:]
    padded, masks = split_and_pad_trajectories(x.detach(), dones.unsqueeze(-1))
    # Episodes are sorted by environment; only the first of each starts with a state.
    first = torch.cat([torch.tensor([0], device=x.device), (dones[:-1].sum(0) + 1).cumsum(0)[:-1]])
    states = tuple(
        torch.zeros(1, padded.shape[1], HIDDEN, device=x.device).index_copy(1, first, s) for s in state
    )
    expected = unpad_trajectories(lstm.rnn(padded, states)[0], masks)
    torch.testing.assert_close(lstm.sequence(x, state, resets), expected)


def test_steps_with_resets_match_the_sequence(case):
    lstm, x, state, resets = case
    lstm.state = state
    out = []
    with torch.no_grad():
        for step in range(STEPS):
            lstm.reset(resets[step])
            out.append(lstm.step(x[step]))
        torch.testing.assert_close(torch.stack(out), lstm.sequence(x, state, resets))


def test_reset_clears_only_the_environments_that_are_done(case):
    lstm, _, state, _ = case
    lstm.state = (state[0].clone().fill_(torch.nan), state[1].clone())
    lstm.reset(torch.tensor([1, 0, 0, 1, 0], device=state[0].device))
    for done in (0, 3):
        assert (lstm.state[0][0, done] == 0).all() and (lstm.state[1][0, done] == 0).all()
    torch.testing.assert_close(lstm.state[1][0, [1, 2, 4]], state[1][0, [1, 2, 4]])
    lstm.reset()
    assert lstm.state is None
