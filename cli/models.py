"""Trained models that commands are given."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from .console import UsageError

if TYPE_CHECKING:
    import torch

Model = TypeVar("Model")


def loaded(load: "Callable[[Path, torch.device], Model]", run: Path, device: str, *, place: str = "RUN") -> Model:
    """A model on its device.

    Args:
        load: Reads a run, a model file or a shipped name.
        run: Which.
        device: As the option `--device` names it.
        place: Of the run, in errors.

    Raises:
        UsageError: If there is no such device or model.
    """
    from pgm_models.processes import device_of

    try:
        found = device_of(device)
    except ValueError as error:
        raise UsageError(f"--{error}") from error
    try:
        return load(run, found)
    except ValueError as error:
        raise UsageError(f"{place}: {error}") from error
