"""The metadata of an exported policy's file: every field of its `Contract` is one entry, as JSON."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping

from spin_rl.config import ConfigError, from_mapping
from spin_rl.deploy.contract import FORMAT, Contract


def write_metadata(contract: Contract) -> dict[str, str]:
    """Turn a contract into the metadata of an ONNX file: JSON of every field."""
    return {key: json.dumps(value) for key, value in dataclasses.asdict(contract).items()}


def read_metadata(metadata: Mapping[str, str], name: str) -> Contract:
    """Read the metadata of an ONNX file.

    Args:
        metadata: What `write_metadata` wrote.
        name: Of the file, for messages.

    Raises:
        ConfigError: It was not exported by this program, or by a version that this one does not know.
    """
    fields = [field.name for field in dataclasses.fields(Contract)]
    missing = [field for field in fields if field not in metadata]
    if "format" in missing:
        raise ConfigError(f"{name}: no policy exported by spin-export, its metadata lacks 'format'")
    if missing:  # what is left out would go unnoticed otherwise, such as a guard
        raise ConfigError(f"{name}: its metadata lacks {missing[0]!r}; export it again with this version")
    try:
        values = {field: json.loads(metadata[field]) for field in fields}
    except json.JSONDecodeError as error:
        raise ConfigError(f"{name}: damaged metadata: {error}") from None
    if values["format"] != FORMAT:
        raise ConfigError(f"{name}: has format {values['format']}; this program reads {FORMAT}")
    try:
        return from_mapping(Contract, values)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None
