"""Where the time of PPO's update goes, and what other forms of it cost."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import torch

from spin_rl.models import ScandotModel, ScandotRecurrentModel
from spin_rl.runners.ppo.algorithm import PPO
from spin_rl.runners.ppo.runner import PPORunner
from spin_rl.speed.env import RandomDriver
from spin_rl.speed.rows import Row, cost_row
from spin_rl.speed.timing import Stopwatch, Subject, Timing, interleave

_LSTM_CRITIC = {
    "class_name": "spin_rl.models:ScandotRecurrentModel",
    "rnn_hidden_dim": 256,
    "hidden_dims": [],
}
NUM_BLOCKS = 3
_UNIT = "us a sample"


def measure_update(driver: RandomDriver, cfg: dict[str, Any], seconds: float, watch: Stopwatch) -> list[Row]:
    """Time the parts of one optimizer step, and whole updates of other forms, on one rollout.

    Args:
        driver: Drives the environment that fills the rollout.
        cfg: Section `runner` of the configuration.
        seconds: Time to measure for.
        watch: Waits for the device.

    Returns:
        Rows in microseconds per sample: parts of the configured update, each per pass over the rollout; and
        whole updates, all epochs, beside the configured one.
    """
    algorithm = _with_rollout(driver, cfg)
    samples = driver.env.num_envs * cfg["num_steps_per_env"]

    def timed(functions: dict[str, Callable[[], object]], passes: float) -> dict[str, Timing]:
        subjects = {
            name: Subject(lambda calls, run=function: watch.time(run, calls), samples * passes)
            for name, function in functions.items()
        }
        return interleave(subjects, seconds / 2, NUM_BLOCKS)

    parts = timed(_parts(algorithm), 1.0 / algorithm.num_mini_batches)
    forms = {name: _with_rollout(driver, form) for name, form in _forms(cfg, driver.env.num_envs).items()}
    updates = timed({name: form.update for name, form in forms.items()}, 1.0)
    rows = [cost_row(f"update: {name}", timing, _UNIT) for name, timing in parts.items()]
    configured = updates["as configured"]
    rows.append(cost_row("update: as configured", configured, _UNIT))
    rows += [
        cost_row(f"update: {name}", timing, _UNIT, "as configured", configured)
        for name, timing in updates.items()
        if timing is not configured
    ]
    return rows


def _forms(cfg: dict[str, Any], num_envs: int) -> dict[str, dict[str, Any]]:
    """Return configurations that differ from the given one in one respect, by what differs."""
    algorithm = cfg["algorithm"]
    epochs, batches = algorithm["num_learning_epochs"], algorithm["num_mini_batches"]
    forms = {"as configured": cfg}

    def vary(name: str, section: str, **values: Any) -> None:
        forms[name] = cfg | {section: cfg[section] | values}

    for number in sorted({2, 3, 5} - {epochs}):
        vary(f"{number} epochs instead of {epochs}", "algorithm", num_learning_epochs=number)
    for number in sorted({2, 4, 8, 16} - {batches}):
        if number <= num_envs:
            vary(f"{number} minibatches instead of {batches}", "algorithm", num_mini_batches=number)
    if not cfg["critic"].get("rnn_hidden_dim"):
        vary("recurrent critic", "critic", **_LSTM_CRITIC)
    if cfg["actor"].get("rnn_hidden_dim", 128) != 128:
        vary("LSTM-128 actor", "actor", rnn_hidden_dim=128)
    return forms


def _with_rollout(driver: RandomDriver, cfg: dict[str, Any]) -> PPO:
    """Build models and algorithm of a configuration, with one rollout in its storage."""
    env = driver.env
    algorithm = PPORunner(env, deepcopy(cfg), None, env.device).alg
    algorithm.train_mode()
    with torch.no_grad():
        obs = env.get_observations()
        for _ in range(cfg["num_steps_per_env"]):
            obs, rewards, dones, extras = env.step(algorithm.act(obs))
            algorithm.process_env_step(obs, rewards, dones, extras)
        algorithm.compute_returns(obs)
    return algorithm


def _parts(algorithm: PPO) -> dict[str, Callable[[], object]]:
    """Return what the step on one minibatch consists of; forward passes go with their backward passes."""
    actor, critic = algorithm.actor, algorithm.critic
    batch = algorithm.storage.mini_batches(algorithm.num_mini_batches)[0]
    index = torch.arange(batch.actions.shape[1], device=batch.actions.device)
    encoded = actor.encode(batch.observations).detach()

    def encoder(model: ScandotModel) -> Callable[[], object]:
        return lambda: model.encode(batch.observations).sum().backward()

    def memory() -> None:
        state = batch.states[0]
        assert isinstance(actor, ScandotRecurrentModel) and state is not None
        actor.lstm.sequence(encoded.requires_grad_(), state, batch.resets).sum().backward()

    parts: dict[str, Callable[[], object]] = {
        "gathering the minibatch": lambda: algorithm.storage._select(index, algorithm.storage.dones),
        "encoder of the actor": encoder(actor),
    }
    if actor.is_recurrent:
        parts["LSTM of the actor"] = memory
    return parts | {
        "critic": lambda: (
            critic(batch.observations, hidden_state=batch.states[1], resets=batch.resets).sum().backward()
        ),
        "all gradients, these included": lambda: algorithm._compute_gradients(batch),
        "Adam": algorithm.optimizer.step,
    }
