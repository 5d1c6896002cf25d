"""The denoising network from an ONNX file, run by onnxruntime on the CPU."""

import json
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from pgm_data.detect.onnx_file import open_network

STEP_INPUTS: tuple[str, ...] = ("x", "known", "text", "text_known", "rate", "log_snr", "constants")
"""Arguments of the step, in order, and names of the inputs of the file."""
Array = TypeVar("Array", Tensor, np.ndarray)


class OnnxStep:
    """What `Denoiser.forward` gives, by onnxruntime; for tensors of any device, or arrays of numpy."""

    def __init__(self, path: Path, threads: int = 2) -> None:
        """Open the file that `export_step` or `quantise_step` wrote.

        Raises:
            ValueError: If the file is not one.
        """
        self._session = open_network(path, threads=threads, what="animation step")
        self._inputs = tuple(entry.name for entry in self._session.get_inputs())
        outputs = [entry.name for entry in self._session.get_outputs()]
        unknown = [name for name in self._inputs if name not in STEP_INPUTS]
        if unknown or "x" not in self._inputs or outputs != ["prediction"]:
            raise ValueError(
                f"animation step {path}: expected inputs among {', '.join(STEP_INPUTS)} and the output prediction, "
                f"got {', '.join(self._inputs)} and {', '.join(outputs)}"
            )
        written = self._session.get_modelmeta().custom_metadata_map
        self.metadata: dict[str, object] = {key: json.loads(value) for key, value in written.items() if _is_json(value)}
        """What `export_step` was given to keep in the file."""

    def __call__(
        self, x: Array, known: Array, text: Array, text_known: Array, rate: Array, log_snr: Array, constants: Array
    ) -> Array:
        """The prediction (B, T, C), of the kind, type and device of `x`; see `Denoiser.forward`."""
        given = dict(zip(STEP_INPUTS, (x, known, text, text_known, rate, log_snr, constants), strict=True))
        feed = {name: _as_array(given[name]) for name in self._inputs}
        (prediction,) = self._session.run(["prediction"], feed)
        if isinstance(x, Tensor):
            return torch.from_numpy(prediction).to(device=x.device, dtype=x.dtype)
        return np.asarray(prediction, dtype=x.dtype)


def _as_array(values: Tensor | np.ndarray) -> np.ndarray:
    """Flags as they are, numbers as float32."""
    if isinstance(values, Tensor):
        values = (values.float() if values.is_floating_point() else values).detach().cpu().numpy()
    return np.ascontiguousarray(values, dtype=bool if values.dtype == bool else np.float32)


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True
