"""An LSTM whose state can be cleared in the middle of a sequence, so that rollouts need no padding."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn
from torch.nn import functional

LSTMState = tuple[torch.Tensor, torch.Tensor]
"""Hidden and cell state, each of shape (1, num_envs, hidden_dim), as `torch.nn.LSTM` has them."""


class ResettableLSTM(nn.Module):
    """One LSTM layer for rollouts (one step) and for updates (sequences with resets inside).

    `torch.nn.LSTM` cannot clear its state at an episode's end, so rsl_rl cuts every rollout into episodes
    and pads them all to the full length. Here the state is cleared in place: no padding, no copy of the
    observations, no hidden state stored per step, and no host synchronization.
    """

    def __init__(self, input_dim: int, hidden_dim: int) -> None:
        super().__init__()
        self.rnn = nn.LSTM(input_dim, hidden_dim)
        self.hidden_dim = hidden_dim
        self.state: LSTMState | None = None

    def step(self, x: torch.Tensor) -> torch.Tensor:
        """Advance the kept state by one step: (num_envs, input_dim) -> (num_envs, hidden_dim)."""
        out, self.state = self.rnn(x.unsqueeze(0), self.state)
        return out.squeeze(0)

    def sequence(self, x: torch.Tensor, state: LSTMState, resets: torch.Tensor) -> torch.Tensor:
        """Run whole sequences and clear the state of an environment before the steps that its mask names.

        Args:
            x: Inputs, shape (num_steps, num_envs, input_dim).
            state: State before the first step.
            resets: True where an episode starts, shape (num_steps, num_envs), bool.

        Returns:
            Outputs, shape (num_steps, num_envs, hidden_dim).
        """
        keep = (~resets).unsqueeze(-1).to(x.dtype)
        w_ih, w_hh, b_ih, b_hh = (
            getattr(self.rnn, f"{name}_l0") for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
        )
        h, c = state[0].squeeze(0), state[1].squeeze(0)
        if x.is_cuda:  # the fused cell is one kernel there
            out = []
            for x_t, keep_t in zip(x, keep, strict=True):
                h, c = torch.lstm_cell(x_t, (h * keep_t, c * keep_t), w_ih, w_hh, b_ih, b_hh)
                out.append(h)
            return torch.stack(out)
        return _LSTMSequence.apply(x, h, c, keep, w_ih, w_hh, b_ih, b_hh)

    def reset(self, dones: torch.Tensor | None = None) -> None:
        """Clear the kept state of the environments in the mask (num_envs,), or of all without one."""
        if dones is None:
            self.state = None
        elif self.state is not None:
            mask = dones.view(1, -1, 1) > 0
            # Not a product: zero times a non-finite state would keep it.
            self.state = (self.state[0].masked_fill(mask, 0.0), self.state[1].masked_fill(mask, 0.0))


class _LSTMSequence(torch.autograd.Function):
    """An LSTM layer with resets on the CPU, with hand-written gradients.

    Autograd would run one product per step for each weight gradient and keep every intermediate result;
    here each weight gradient is one product over the whole sequence, and the gates' memory is reused for
    their gradients.
    """

    @staticmethod
    def forward(
        ctx: Any,
        x: torch.Tensor,
        h: torch.Tensor,
        c: torch.Tensor,
        keep: torch.Tensor,
        w_ih: torch.Tensor,
        w_hh: torch.Tensor,
        b_ih: torch.Tensor,
        b_hh: torch.Tensor,
    ) -> torch.Tensor:
        """Map input (T, N, D), state (N, H), keep (T, N, 1), zeros and ones, and weights to (T, N, H)."""
        num_steps, num_envs, _ = x.shape
        dim = w_hh.shape[1]
        gates = functional.linear(x, w_ih, b_ih + b_hh)
        h_prev, c_prev, c_tanh, out = (x.new_empty(num_steps, num_envs, dim) for _ in range(4))
        w_t = w_hh.t()
        for t in range(num_steps):
            torch.mul(h, keep[t], out=h_prev[t])
            torch.mul(c, keep[t], out=c_prev[t])
            gates[t].addmm_(h_prev[t], w_t)
            in_gate, forget, cell, out_gate = gates[t].split(dim, dim=1)
            # tanh(x) = 2 sigmoid(2x) - 1, which Torch computes several times faster on the CPU.
            cell.mul_(2.0)
            gates[t].sigmoid_()
            cell.mul_(2.0).sub_(1.0)
            c = torch.addcmul(forget * c_prev[t], in_gate, cell)
            torch.sigmoid(2.0 * c, out=c_tanh[t])
            c_tanh[t].mul_(2.0).sub_(1.0)
            h = torch.mul(out_gate, c_tanh[t], out=out[t])
        ctx.save_for_backward(x, w_ih, w_hh, gates, h_prev, c_prev, c_tanh, keep)
        return out

    @staticmethod
    def backward(ctx: Any, *grads: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        """Gradients of the input and the weights; the state before the sequence is data."""
        (d_out,) = grads
        x, w_ih, w_hh, gates, h_prev, c_prev, c_tanh, keep = ctx.saved_tensors
        num_steps, num_envs, dim = h_prev.shape
        dh = h_prev.new_zeros(num_envs, dim)
        dc = h_prev.new_zeros(num_envs, dim)
        for t in reversed(range(num_steps)):
            in_gate, forget, cell, out_gate = gates[t].split(dim, dim=1)
            slope = torch.addcmul(gates[t], gates[t], gates[t], value=-1.0)  # of a sigmoid: s (1 - s)
            slope_in, slope_forget, slope_cell, slope_out = slope.split(dim, dim=1)
            torch.mul(cell, cell, out=slope_cell).neg_().add_(1.0)  # of a tanh: 1 - s^2
            dh.add_(d_out[t])
            d_tanh = dh * out_gate
            dc.add_(d_tanh).addcmul_(d_tanh * c_tanh[t], c_tanh[t], value=-1.0)
            slope_out.mul_(dh).mul_(c_tanh[t])
            slope_in.mul_(dc).mul_(cell)
            slope_cell.mul_(dc).mul_(in_gate)
            slope_forget.mul_(dc).mul_(c_prev[t])
            dc.mul_(forget).mul_(keep[t])
            torch.mm(slope, w_hh, out=dh).mul_(keep[t])
            gates[t].copy_(slope)
        d_gates = gates.flatten(0, 1)
        d_x = torch.mm(d_gates, w_ih).view_as(x) if ctx.needs_input_grad[0] else None
        d_w_ih = torch.mm(d_gates.t(), x.flatten(0, 1))
        d_w_hh = torch.mm(d_gates.t(), h_prev.flatten(0, 1))
        d_b = d_gates.sum(dim=0)
        return d_x, None, None, None, d_w_ih, d_w_hh, d_b, d_b
