"""The network of an exported policy and its memory, by onnxruntime on one core."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spin_rl.config import ConfigError
from spin_rl.deploy.contract import ACTION_OUTPUT, FLOAT32, STATE, Contract
from spin_rl.deploy.metadata import read_metadata
from spin_rl.extras import require

_ONNX_TYPES = {"tensor(float)": FLOAT32, "tensor(uint8)": "uint8"}


class Network:
    """An exported policy that is stepped.

    Attributes:
        contract: What it reads and what its actions mean.
    """

    def __init__(self, path: str | Path) -> None:
        """Load a file.

        Raises:
            ConfigError: There is no such file, it is no exported policy, or onnxruntime is missing.
        """
        onnxruntime = require("onnxruntime", "onnxruntime", "deploy", "policy")
        if not Path(path).is_file():
            raise ConfigError(
                f"policy: there is no file {path}; spin-export policy=<name> out={path} makes one"
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, ["CPUExecutionProvider"])
        except Exception as error:  # its exceptions have no common class but this one
            reason = str(error).strip().splitlines()[0]
            raise ConfigError(f"policy: {path} is no ONNX file that can be run: {reason}") from None
        metadata = self._session.get_modelmeta().custom_metadata_map
        self.contract: Contract = read_metadata(metadata, f"policy: {path}")
        self._outputs = [ACTION_OUTPUT, *STATE.values()]
        self._check(str(path))
        self.reset()

    def reset(self) -> None:
        """Clear the memory, at the start of an episode or after a pause."""
        self._memory = {
            name: np.full(memory.shape, memory.initial, dtype=FLOAT32)
            for name, memory in self.contract.state.items()
        }

    def __call__(self, groups: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the action of one step, shape (10,), not clipped; all groups have shape (1, size)."""
        inputs = {name: groups[name] for name in self.contract.observation_names}
        action, *memory = self._session.run(self._outputs, inputs | self._memory)
        self._memory = dict(zip(STATE, memory, strict=True))
        return np.asarray(action, dtype=np.float64)[0]

    @property
    def memory(self) -> dict[str, np.ndarray]:
        """What the next step remembers, by the input's name."""
        return self._memory

    def _check(self, path: str) -> None:
        """Compare inputs and outputs with the metadata."""
        found = {i.name: (_ONNX_TYPES.get(i.type), i.shape) for i in self._session.get_inputs()}
        wanted = {group.name: (group.dtype, [1, group.size]) for group in self.contract.observations}
        wanted |= {name: (FLOAT32, list(memory.shape)) for name, memory in self.contract.state.items()}
        outputs = [output.name for output in self._session.get_outputs()]
        if found != wanted or sorted(outputs) != sorted(self._outputs):
            raise ConfigError(f"policy: {path}: inputs and outputs are not those of its metadata")
