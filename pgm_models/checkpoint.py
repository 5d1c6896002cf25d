"""Everything a training run needs to go on exactly where it stopped, in one safetensors file."""

import hashlib
import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import torch
from torch import Tensor, nn

from pgm_data.dataset.files import whole_file

CHECKPOINT_NAME = "checkpoint.safetensors"
"""File name of the newest state inside a run."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Checkpoint:
    """The state of a run after a whole number of optimiser steps."""

    step: int
    """Optimiser steps done."""
    elapsed_s: float
    """Seconds of training so far, over all its parts; the schedule may follow it."""
    network: Mapping[str, Tensor]
    """Weights and buffers being trained."""
    average: Mapping[str, Tensor]
    """Their exponential moving average: what is used and exported."""
    optimiser: Mapping[str, Tensor]
    """The optimiser's state as `parameter/key`."""
    options: Mapping[str, dict]
    """Options as resolved, JSON values: of the loop under `train`, of what is learned under `task`."""
    provenance: Mapping[str, object]
    """Data, versions and command, JSON values."""


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write the state through a temporary name, so that a broken write never replaces a good one."""
    from safetensors.torch import save_file

    parts = {"network": checkpoint.network, "average": checkpoint.average, "optimiser": checkpoint.optimiser}
    tensors = {
        f"{part}/{name}": value.detach().contiguous().clone()
        for part, named in parts.items()
        for name, value in named.items()
    }
    about = {
        "step": str(checkpoint.step),
        "elapsed_s": repr(checkpoint.elapsed_s),
        "options": json.dumps(checkpoint.options),
        "provenance": json.dumps(checkpoint.provenance),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        save_file(tensors, temporary, metadata=about)


def load_checkpoint(path: Path) -> Checkpoint:
    """The state in that file.

    Raises:
        ValueError: If the file is not a checkpoint of this project.
    """
    from safetensors import SafetensorError, safe_open

    parts: dict[str, dict[str, Tensor]] = {"network": {}, "average": {}, "optimiser": {}}
    try:
        with safe_open(path, framework="pt") as file:
            about = file.metadata() or {}
            for key in file.keys():
                part, _, name = key.partition("/")
                parts[part][name] = file.get_tensor(key)
        return Checkpoint(
            step=int(about["step"]),
            elapsed_s=float(about["elapsed_s"]),
            options=json.loads(about["options"]),
            provenance=json.loads(about["provenance"]),
            **parts,
        )
    except (SafetensorError, KeyError, ValueError) as error:
        raise ValueError(
            f"checkpoint {path}: expected a safetensors file written by pgm-train, got {error!r}"
        ) from error


def optimiser_tensors(network: nn.Module, optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """The optimiser's state as `parameter/key`."""
    names = {id(parameter): name for name, parameter in network.named_parameters()}
    return {
        f"{names[id(parameter)]}/{key}": value
        for parameter, state in optimiser.state.items()
        for key, value in state.items()
        if isinstance(value, Tensor)
    }


def restore_optimiser(network: nn.Module, optimiser: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Put the state that `optimiser_tensors` gave back, in each parameter's own memory layout."""
    for name, parameter in network.named_parameters():
        prefix = f"{name}/"
        for key, value in tensors.items():
            if key.startswith(prefix):
                like = torch.empty_like(parameter) if value.shape == parameter.shape else torch.empty_like(value)
                if optimiser.defaults.get("fused"):
                    like = like.to(parameter.device)
                optimiser.state[parameter][key.removeprefix(prefix)] = like.copy_(value)


def provenance(command: list[str]) -> dict[str, object]:
    """What made a checkpoint: command, versions and kind of machine."""
    return {
        "command": command,
        "versions": {name: version(name) for name in ("torch", "numpy")},
        "machine": f"{platform.system()} {platform.machine()}, {torch.get_num_threads()} threads",
    }


def weights_digest(options: Mapping[str, object], tensors: Mapping[str, Tensor]) -> str:
    """SHA-256 of what a model is, as JSON values, and of its tensors."""
    found = hashlib.sha256(json.dumps(options, sort_keys=True).encode())
    for name, value in sorted(tensors.items()):
        found.update(name.encode())
        found.update(value.detach().cpu().contiguous().numpy().tobytes())
    return found.hexdigest()
