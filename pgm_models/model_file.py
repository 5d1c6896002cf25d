"""The file a trained model is kept in: weights, what they are the weights of, and what made them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from torch import Tensor, nn

from pgm_data.dataset.files import whole_file
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint

MODEL_NAME = "model.safetensors"
"""File name of a run's averaged weights with all that is needed to use them."""
Kind = Literal["animation", "synthesis"]
"""Models that are trained by `pgm-train KIND`."""
_OWN: Mapping[Kind, str] = MappingProxyType({"animation": "layout", "synthesis": "fields"})
"""Of the options what only this kind of model has: checkpoints do not say whose they are."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredModel:
    """A model as it lies in a file."""

    place: Path
    """Where it was found."""
    kind: Kind
    options: Mapping
    """What the model is apart from its weights, JSON values."""
    tensors: Mapping[str, Tensor]
    """Weights and buffers by name, and what else is kept beside them."""
    more: Mapping[str, str] = field(default_factory=dict)
    """Other text kept in the file."""

    def into(self, model: nn.Module, *, apart: tuple[str, ...] = ()) -> None:
        """Give the model these weights, and put it in evaluation mode without gradients.

        Args:
            model: As the options say.
            apart: Tensors that are none of its weights.

        Raises:
            ValueError: If they are another model's.
        """
        try:
            model.load_state_dict({name: value for name, value in self.tensors.items() if name not in apart})
        except RuntimeError as error:
            raise ValueError(f"{self.place}: expected the weights of its {self.kind} model, got {error}") from error
        model.eval().requires_grad_(False)


def write_model(
    path: Path,
    kind: Kind,
    model: nn.Module,
    options: Mapping[str, object],
    about: Mapping[str, object],
    *,
    tensors: Mapping[str, Tensor] | None = None,
    more: Mapping[str, str] | None = None,
) -> None:
    """Write weights and options as one safetensors file, whole or not at all.

    Args:
        path: Of the file.
        kind: Of model.
        model: Whose weights and buffers are kept.
        options: What it is apart from those, JSON values.
        about: What made it, JSON values.
        tensors: Kept beside the weights, under other names.
        more: Other text to keep.
    """
    from safetensors.torch import save_file

    metadata = {f"pgm_{kind}": json.dumps(options), "about": json.dumps(about), **(more or {})}
    kept = {**model.state_dict(), **(tensors or {})}
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        save_file(
            {name: value.detach().cpu().contiguous().clone() for name, value in kept.items()}, temporary, metadata
        )


def stored_model(run: Path, kind: Kind, *, shipped: tuple[str, ...] = ()) -> StoredModel:
    """What a run's folder or a file holds: a whole model, or else the averaged weights of the newest checkpoint.

    Args:
        run: Of `pgm-train`, or a file.
        kind: Of model that is wanted.
        shipped: Names that would do too, for the message.

    Raises:
        ValueError: If there is none; says what was found.
    """
    for path in (run, run / MODEL_NAME):
        if path.is_file():
            return _read(path, kind)
    wanted = " or one of ".join([f"a run of pgm-train {kind}", *([", ".join(shipped)] if shipped else [])])
    if (run / CHECKPOINT_NAME).is_file():
        found = load_checkpoint(run / CHECKPOINT_NAME)
        described = found.options.get("task", {}).get("model")
        if not isinstance(described, dict) or _OWN[kind] not in described:
            raise ValueError(f"{run}: expected {wanted}, got one of another model")
        return StoredModel(place=run / CHECKPOINT_NAME, kind=kind, options=described, tensors=found.average)
    what = "an empty or foreign folder" if run.is_dir() else "nothing there"
    raise ValueError(f"{run}: expected {wanted}, got {what}")


def _read(path: Path, kind: Kind) -> StoredModel:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt") as file:
            about = dict(file.metadata() or {})
            if (described := about.pop(f"pgm_{kind}", None)) is None:
                raise ValueError(
                    f"{path}: expected a model of pgm-train {kind}, got a safetensors file of something else"
                )
            tensors = {name: file.get_tensor(name) for name in file.keys()}
    except SafetensorError as error:
        raise ValueError(f"{path}: expected a model of pgm-train {kind}, got {error}") from error
    return StoredModel(place=path, kind=kind, options=json.loads(described), tensors=tensors, more=about)
