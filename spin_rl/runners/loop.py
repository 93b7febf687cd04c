"""The training loop of all algorithms: it shows progress, stops, saves and resumes cleanly.

One class, and so one file: each of its parts reads and writes the state of the run. What can do without that
state is elsewhere: checkpoints and when they are saved, progress, signals and limits, processes.
"""

from __future__ import annotations

import copy
import json
import math
import sys
import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, cast

import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

from spin_rl.files import reason
from spin_rl.runners.checkpoint import (
    find_checkpoint,
    load_module_state,
    save_checkpoint,
    set_aside,
    to_cpu,
)
from spin_rl.runners.contents import check_checkpoint, check_weights
from spin_rl.runners.distributed import Processes
from spin_rl.runners.interface import TrainingEnv
from spin_rl.runners.limits import Interrupted, Limits
from spin_rl.runners.progress import (
    ProgressLine,
    RecentEpisodes,
    ScalarWriter,
    episode_tag,
    format_duration,
    join_statistics,
)
from spin_rl.runners.saving import Saver
from spin_rl.stop_request import StopRequest


class TrainingLoop(OnPolicyRunner):
    """Trains by the algorithm that the configuration names; see `train`. Subclasses check and describe it.

    Beside rsl_rl's methods an algorithm has: `trained`, the models that a checkpoint holds by name, with the
    policy as "actor"; `models`, those whose memory follows the episodes; `optimizer` and `learning_rate`;
    `set_progress`, `extra_state` and `load_extra_state` as PPO; and `skipped_steps` in what `update` returns.
    """

    alg: Any

    def __init__(
        self,
        env: TrainingEnv,
        cfg: dict[str, Any],
        run_dir: Path | None = None,
        device: str = "cpu",
        snapshot: dict[str, Any] | None = None,
    ) -> None:
        """Check the configuration and build models and algorithm.

        Args:
            env: Environment on the same device.
            cfg: `num_steps_per_env`, `save_interval` [iterations], `save_minutes` (optional), `seed`,
                `obs_groups`, and a section for each model and for `algorithm`: a `class_name` and its
                constructor's arguments.
            run_dir: Folder for checkpoints and TensorBoard events; None writes nothing.
            device: Torch device; under torchrun that of this process.
            snapshot: Whole configuration of the run, kept in checkpoints beside `cfg`.

        Raises:
            ValueError: A setting is unknown or impossible; one line that names it.
        """
        obs = env.get_observations()
        self._check(cfg, obs, env.num_envs)
        # Not asked for when saving: every call draws noise, and saving must not change a run.
        self._obs_dims = {name: value.shape[-1] for name, value in obs.items()}
        self.processes = Processes(device)
        torch.manual_seed(cfg.get("seed", 0) + self.processes.rank)
        # rsl_rl's `VecEnv` asks for more than rsl_rl uses.
        super().__init__(cast(VecEnv, env), copy.deepcopy(cfg), None, device)
        if self.processes.parallel:
            self.alg.broadcast_parameters()
        self.env: TrainingEnv = env
        self.run_dir = run_dir
        self.config_text = json.dumps({"runner": cfg, "run": snapshot}, default=_class_name, sort_keys=True)
        self.env_steps = self._env_steps_before = 0
        self.minutes = 0.0
        self.skipped_steps = 0
        self.episodes = RecentEpisodes()
        self._loaded: Path | None = None
        self._stop = StopRequest()
        self._deadline = math.inf

    @property
    def steps_per_iteration(self) -> int:
        """Environment steps of one rollout in all processes."""
        return self.cfg["num_steps_per_env"] * self.env.num_envs * self.processes.world_size

    def train(self, max_iterations: int, max_minutes: float | None = None) -> dict[str, Any]:
        """Train until a limit or a signal, with checkpoints on the way and at the end.

        Args:
            max_iterations: Iterations of the whole run: a resumed one counts those before its checkpoint.
            max_minutes: Wall time of this call [min].

        Returns:
            Summary: env_steps, env_steps_per_second, minutes, iterations, success_rate and other
            statistics of the last episodes, skipped_steps, stopped_by ("max_iterations", "max_minutes" or
            a signal) and checkpoint.

        Raises:
            ValueError: A limit is not positive.
            FloatingPointError: Losses stay non-finite, or weights are; no such weights are saved.
            OSError: The last checkpoint cannot be written.
            Exception: Whatever else goes wrong; what was learned until then is saved first.
        """
        limits = Limits(max_iterations, max_minutes, self.current_learning_iteration)
        minutes_before = self.minutes
        self._env_steps_before = self.env_steps
        stopped_by = self._reason_to_stop(None, limits)
        line = ProgressLine() if self.processes.is_main else None
        events = self.run_dir if self.processes.is_main else None
        saver = Saver(self.run_dir, self.cfg["save_interval"], self.cfg.get("save_minutes"))
        self._leave_other_branch()
        with StopRequest() as self._stop, closing(self._scalar_writer(events, limits)) as writer:
            start = time.monotonic()
            self._deadline = math.inf if max_minutes is None else start + 60.0 * max_minutes
            try:
                self._begin()
                obs = self.env.get_observations()
                self.alg.train_mode()
                while stopped_by is None:
                    self.alg.set_progress(limits.progress(self.current_learning_iteration))
                    obs, scalars = self._iterate(obs)
                    limits.advance(self.processes.max(time.monotonic() - start))
                    self.minutes = minutes_before + limits.elapsed_s / 60.0
                    self._dump_non_finite()
                    writer.write(self.current_learning_iteration, scalars)
                    if line:
                        line.show(self._text(limits))
                    stopped_by = self._reason_to_stop(self._stop.name, limits)
                    due = saver.is_due(self.current_learning_iteration, limits.elapsed_s)
                    if stopped_by is None and due:
                        self._save_on_the_way(saver, limits.elapsed_s)
            except Interrupted:
                stopped_by = self._stop.name or "max_minutes"
            except Exception:
                self._save_before_raising(saver)
                raise
            checkpoint = self._save_numbered(saver)
        assert stopped_by is not None
        summary = self._summary(limits, stopped_by, checkpoint)
        if line:
            line.end(self._end_text(summary))
        return summary

    def learn(self, num_learning_iterations: int, init_at_random_ep_len: bool = False) -> None:
        """Train for some more iterations; rsl_rl's name for it."""
        if init_at_random_ep_len:
            raise ValueError("init_at_random_ep_len is up to the environment.")
        self.train(self.current_learning_iteration + num_learning_iterations)

    def save(self, path: str | Path, infos: dict | None = None) -> None:
        """Write a checkpoint; all processes call it, the main one writes."""
        state = self._state()
        if self.processes.is_main:
            save_checkpoint(Path(path), state)

    def load(
        self,
        path: str | Path,
        load_cfg: dict | None = None,
        strict: bool = True,
        map_location: str | None = None,
    ) -> dict:
        """Continue from a checkpoint: models, optimizer, counters, random states, environment.

        Args:
            path: Checkpoint file or run folder; see `find_checkpoint`.
            load_cfg: Not used.
            strict: Not used: a checkpoint fits or is refused.
            map_location: Not used: tensors go to the runner's device.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: It is damaged, of another architecture, or learned from another teacher; one line
                that names the file and what differs.
        """
        path, state = find_checkpoint(path)
        fits = all(name in state for name in self.alg.trained)
        check_checkpoint(state, str(path))
        if not fits or len(state["processes"][0]["memory"]) != len(self.alg.models):
            raise ValueError(f"{path} is of another algorithm; to start from its weights use init={path}.")
        for name, model in self.alg.trained.items():
            load_module_state(model, state[name], name, str(path))
        own = state["processes"][self.processes.rank % len(state["processes"])]
        for name, restore in {
            "optimizer": lambda: self._restore_optimizer(state),
            "algorithm": lambda: self.alg.load_extra_state(state.get("algorithm", {})),
            # With another number of processes the environments' states are shared out again.
            "processes.env": lambda: self.env.load_state_dict(own["env"]),
            "processes": lambda: self._restore_process(own, len(state["processes"])),
        }.items():
            try:
                restore()
            except ValueError as error:  # one line already
                raise ValueError(f"{path}: {error}") from None
            except (LookupError, TypeError, AttributeError, RuntimeError) as error:
                first = str(error).partition("\n")[0]
                raise ValueError(f"{path}: {name} does not fit: {type(error).__name__}: {first}") from error
        self.current_learning_iteration = state["iteration"]
        self.env_steps, self.minutes, self.skipped_steps = (
            state["env_steps"],
            state["minutes"],
            state["skipped_steps"],
        )
        self._loaded = path
        return state

    def close(self) -> None:
        """Leave the group of processes."""
        self.processes.leave()

    def _restore_optimizer(self, state: dict[str, Any]) -> None:
        """Take over the optimizer's memory and the learning rate; other settings are those of this run."""
        optimizer = self.alg.optimizer
        own = optimizer.state_dict()
        saved = own["state"] | state["optimizer"]["state"]
        optimizer.load_state_dict(own | {"state": saved})
        self.alg.learning_rate = state["learning_rate"]
        for group in optimizer.param_groups:
            group["lr"] = self.alg.learning_rate
            for parameter in group["params"]:
                memory = optimizer.state.get(parameter)
                if memory and not _fits(memory, parameter):
                    raise ValueError("optimizer: its memory has not the shapes of the parameters")

    def _restore_process(self, own: dict[str, Any], processes: int) -> None:
        """Take over random states and the models' memory, where there are as many processes as there were."""
        if processes != self.processes.world_size:
            return
        torch.set_rng_state(own["rng_cpu"])
        if own["rng_cuda"] is not None and torch.device(self.device).type == "cuda":
            torch.cuda.set_rng_state(own["rng_cuda"], self.device)
        for model, memory in zip(self.alg.models, own["memory"], strict=True):
            if memory and memory[0].shape[1] == self.env.num_envs:
                model.reset(hidden_state=tuple(part.to(self.device) for part in memory))

    def _begin(self) -> None:
        """Do what is left before the first iteration of a call of `train`."""

    def _check_stop(self) -> None:
        """Raise `Interrupted` if the run has to end, for a subclass that waits inside of an iteration."""
        if self._stop.name is not None or time.monotonic() >= self._deadline:
            raise Interrupted

    def _iterate(self, obs: TensorDict) -> tuple[TensorDict, dict[str, float]]:
        """Collect and learn once; return the next observations and the scalars to log."""
        start = time.monotonic()
        obs, statistics, steps = self._collect(obs)
        middle = time.monotonic()
        losses = self._learn()
        end = time.monotonic()
        self.current_learning_iteration += 1
        self.env_steps += steps
        self.skipped_steps += round(losses["skipped_steps"])
        self.episodes.add(statistics)
        scalars = {name if "/" in name else f"Loss/{name}": value for name, value in losses.items()}
        scalars |= {episode_tag(name): value for name, value in statistics.items()}
        scalars |= {
            "Loss/learning_rate": self.alg.learning_rate,
            "Perf/env_steps": self.env_steps,
            "Perf/total_fps": steps / (end - start),
            "Perf/collection_time": middle - start,
            "Perf/learning_time": end - middle,
        }
        return obs, scalars | self._scalars(losses)

    def _collect(self, obs: TensorDict) -> tuple[TensorDict, dict[str, float], int]:
        """Make one rollout; return the next observations, statistics and the environment steps."""
        with torch.no_grad():
            for _ in range(self.cfg["num_steps_per_env"]):
                obs, rewards, dones, extras = self.env.step(self.alg.act(obs))
                self.alg.process_env_step(obs, rewards, dones, extras)
            self.alg.compute_returns(obs)
        own = self.env.episode_stats()  # reads from the device
        statistics = join_statistics(self.processes.gather_all(own))
        return obs, statistics, self.steps_per_iteration

    def _learn(self) -> dict[str, float]:
        """Learn from what was collected."""
        return self.alg.update()

    def _check(self, cfg: dict[str, Any], obs: TensorDict, num_envs: int) -> None:
        """Raise a ValueError if the configuration is impossible; one line that names the setting."""
        raise NotImplementedError

    def _scalars(self, losses: dict[str, float]) -> dict[str, float]:
        """Return further scalars to log; `losses` are what the algorithm's update returned."""
        return {}

    def _results(self) -> str:
        """Describe how well the policy does, for the progress line."""
        success, mean_return = self.episodes.mean("success_rate"), self.episodes.mean("mean_return")
        if math.isnan(success):
            return "no episode over yet"
        level = self.episodes.mean("level")
        return f"level {level:.2f} | success {success:.1%} | return {mean_return:.2f}"

    def _state(self, alone: bool = False) -> dict[str, Any]:
        """Everything that `load` restores, complete in the main process.

        Args:
            alone: Ask nothing of the other processes, which may be gone; theirs is then left out.
        """
        alg, on_gpu = self.alg, torch.device(self.device).type == "cuda"
        memory: list[tuple[torch.Tensor, ...] | None] = [None] * len(alg.models)
        if getattr(self.env, "restores_episodes", False):
            states = [model.get_hidden_state() for model in alg.models]
            memory = [state and tuple(part.cpu() for part in state) for state in states]
        own = {
            "env": to_cpu(self.env.state_dict()),
            "rng_cpu": torch.get_rng_state(),
            "rng_cuda": torch.cuda.get_rng_state(self.device) if on_gpu else None,
            "memory": memory,
        }
        return {
            **{name: model.state_dict() for name, model in alg.trained.items()},
            "optimizer": alg.optimizer.state_dict(),
            "learning_rate": alg.learning_rate,
            "algorithm": alg.extra_state(),
            "iteration": self.current_learning_iteration,
            "env_steps": self.env_steps,
            "minutes": self.minutes,
            "skipped_steps": self.skipped_steps,
            "num_actions": self.env.num_actions,
            "obs_dims": self._obs_dims,
            "config": self.config_text,
            "processes": [own] if alone else self.processes.gather(own),
        }

    def _dump_non_finite(self) -> None:
        """Keep what the worlds that turned non-finite did before; every process has its own worlds."""
        if self.run_dir is not None:
            for path in self.env.dump_non_finite(self.run_dir / "non_finite"):
                print(f"\nA world turned non-finite and was reset; its last states: {path}", flush=True)

    def _scalar_writer(self, folder: Path | None, limits: Limits) -> ScalarWriter:
        project, config = self.cfg.get("wandb_project"), json.loads(self.config_text)
        return ScalarWriter(folder, limits.first_iteration, project, config)

    def _reason_to_stop(self, signal_name: str | None, limits: Limits) -> str | None:
        """Name the signal or the limit that ends the run now, all processes at once."""
        (signalled,) = self.processes.any(signal_name is not None)
        if signalled:
            return signal_name or "a signal to another process"
        if self.current_learning_iteration >= limits.max_iterations:
            return "max_iterations"
        return "max_minutes" if limits.time_is_over else None

    def _leave_other_branch(self) -> None:
        """Set aside what this folder holds of iterations after the checkpoint that the run goes on from."""
        if self._loaded is None or self.run_dir is None or not self.processes.is_main:
            return
        if self._loaded.parent.resolve() == (self.run_dir / "checkpoints").resolve():
            for path in set_aside(self._loaded):
                print(f"Set aside, of another branch: {path}", flush=True)

    def _save_on_the_way(self, saver: Saver, elapsed_s: float) -> None:
        """Save, or go on without if there is no room: it is tried again."""
        problem = None
        try:
            self._save_numbered(saver)
        except OSError as error:
            problem = reason(error)
            print(
                f"\nwarning: {problem}; training goes on, saving is tried again", file=sys.stderr, flush=True
            )
        (failed,) = self.processes.any(problem is not None)
        saver.note(elapsed_s, failed)

    def _save_numbered(self, saver: Saver) -> Path | None:
        if self.run_dir is None:
            return None
        state = self._state()
        if self.processes.is_main:
            self._check_weights()
            saver.write(self.current_learning_iteration, state)
        return saver.last

    def _save_before_raising(self, saver: Saver) -> None:
        """Keep what was learned until an error, which is not to be hidden by another one."""
        if self.run_dir is None or not self.processes.is_main:
            return
        try:
            self._check_weights()
            saver.write(self.current_learning_iteration, self._state(alone=True))
        except Exception as error:
            print(f"\nwarning: nothing was saved before the error: {error}", file=sys.stderr, flush=True)
        else:
            print(f"\nSaved before the error: {saver.last}", file=sys.stderr, flush=True)

    def _check_weights(self) -> None:
        """Keep weights that compute nothing from taking the place of good ones.

        Raises:
            FloatingPointError: They are not finite, or too large.
        """
        for name, model in self.alg.trained.items():
            try:
                check_weights(model.state_dict(), name)
            except ValueError as error:
                raise FloatingPointError(f"{error}: not saved, the last good checkpoint stays") from None

    def _steps_per_second(self, limits: Limits) -> float:
        steps = self.env_steps - self._env_steps_before
        return steps / limits.elapsed_s if steps else 0.0

    def _summary(self, limits: Limits, stopped_by: str, checkpoint: Path | None) -> dict[str, Any]:
        names = ("success_rate", "collision_rate", "timeout_rate", "mean_return", "mean_length_s")
        return {
            "env_steps": self.env_steps,
            "env_steps_per_second": self._steps_per_second(limits),
            "minutes": self.minutes,
            "iterations": self.current_learning_iteration,
            **{name: self.episodes.mean(name) for name in names},
            "skipped_steps": self.skipped_steps,
            "stopped_by": stopped_by,
            "checkpoint": None if checkpoint is None else str(checkpoint),
        }

    def _text(self, limits: Limits) -> str:
        iteration = self.current_learning_iteration
        by_iterations = limits.ends_by_iterations(iteration)
        parts = [
            f"iteration {iteration}" + (f"/{limits.max_iterations}" if by_iterations else ""),
            f"{self.env_steps / 1e6:.3f} M env steps",
            f"{self._steps_per_second(limits):.0f}/s",
            self._results(),
            f"{format_duration(limits.seconds_left(self.current_learning_iteration))} left",
        ]
        if self.skipped_steps:
            parts.append(f"{self.skipped_steps} optimizer steps skipped: not finite")
        return " | ".join(parts)

    def _end_text(self, summary: dict[str, Any]) -> str:
        where = f"; checkpoint: {summary['checkpoint']}" if summary["checkpoint"] else ""
        return (
            f"Stopped by {summary['stopped_by']} after {summary['iterations']} iterations, "
            f"{summary['env_steps']:,} env steps, {summary['minutes']:.1f} min{where}"
        )

    def _configure_multi_gpu(self) -> None:
        """Set rsl_rl's fields for data-parallel training, on CPUs too."""
        processes = self.processes
        self.is_distributed = processes.parallel
        self.gpu_world_size, self.gpu_global_rank = processes.world_size, processes.rank
        self.gpu_local_rank = processes.local_rank
        ranks = {"global_rank": processes.rank, "local_rank": processes.local_rank}
        self.cfg["multi_gpu"] = ranks | {"world_size": processes.world_size} if processes.parallel else None


def _fits(memory: Mapping[str, torch.Tensor], parameter: torch.Tensor) -> bool:
    """Whether what Adam remembers is of a parameter."""
    shapes = {memory[key].shape for key in ("exp_avg", "exp_avg_sq")}
    return shapes == {parameter.shape} and memory["step"].shape == () and memory["step"].item() >= 0


def _class_name(value: Any) -> str:
    """Write a class as the name by which a configuration could have given it."""
    if not isinstance(value, type):
        raise TypeError(f"The configuration holds {value!r}, which JSON cannot.")
    return f"{value.__module__}:{value.__qualname__}"
