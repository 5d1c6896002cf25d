"""Trained networks as ONNX files, for the readers in `pgm_data.detect`."""

import json
import warnings
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from pgm_data.dataset.files import whole_file
from pgm_data.detect.ball.network import CHANNELS, Calibration
from pgm_data.detect.court_network import INPUT_SIZE
from pgm_models.checkpoint import Checkpoint
from pgm_models.detectors.ball_net import BALL_PRESETS, BallNet
from pgm_models.detectors.heatmap_net import PRESETS, ConvNorm, HeatmapNet, Residual, Up

if TYPE_CHECKING:
    import onnx

Network = TypeVar("Network", bound=nn.Module)


def network_from_checkpoint(checkpoint: Checkpoint) -> HeatmapNet:
    """The network with the averaged weights, in evaluation mode."""
    task = checkpoint.options["task"]
    network = HeatmapNet(len(task["points"]), PRESETS[task["options"]["preset"]])
    network.load_state_dict(checkpoint.average)
    return network.eval()


def ball_network_from_checkpoint(checkpoint: Checkpoint) -> BallNet:
    """The network with the averaged weights, in evaluation mode."""
    network = BallNet(BALL_PRESETS[checkpoint.options["task"]["options"]["preset"]])
    network.load_state_dict(checkpoint.average)
    return network.eval()


def fold_norms(network: Network) -> Network:
    """A copy without batch norms: each is folded into the convolution before it."""
    folded = deepcopy(network).eval()
    for module in list(folded.modules()):
        if isinstance(module, ConvNorm):
            module[0], module[1] = _fused(module[0], module[1]), nn.Identity()
        elif isinstance(module, Residual):
            module.second, module.norm = _fused(module.second, module.norm), nn.Identity()
        elif isinstance(module, Up):
            module.narrow, module.norm = _fused(module.narrow, module.norm), nn.Identity()
    return folded


def _fused(convolution: nn.Module, norm: nn.Module) -> nn.Conv2d:
    if not (isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)):
        raise TypeError(f"expected a convolution and a batch norm, got {convolution} and {norm}")
    return fuse_conv_bn_eval(convolution, norm)


def export_court(network: HeatmapNet, names: tuple[str, ...], path: Path, *, about: dict[str, object]) -> None:
    """Write the network as one ONNX file with the names of its points and `about`, JSON values, in its metadata.

    Input `picture` (1, 3, rows, columns), red green blue in 0..1; outputs `points`, `absent`, `line`: logits.
    """
    inputs = {"picture": torch.zeros(1, 3, INPUT_SIZE[1], INPUT_SIZE[0])}
    metadata = {"points": list(names), "about": about}
    write_onnx(fold_norms(network), inputs, ("points", "absent", "line"), path, metadata=metadata)


def export_ball(network: BallNet, calibration: Calibration, path: Path, *, about: dict[str, object]) -> None:
    """Write the network as one ONNX file with its calibration and `about`, JSON values, in its metadata.

    Inputs `grey` (1, 3, rows, columns) and `colour` (1, 2, rows / 2, columns / 2), any multiples of 16; output
    `answers` (1, channels, rows / 4, columns / 4).
    """
    inputs = {
        "grey": torch.zeros(1, 3, 64, 96, dtype=torch.uint8),
        "colour": torch.zeros(1, 2, 32, 48, dtype=torch.uint8),
    }
    metadata = {"ball_channels": list(CHANNELS), "calibration": asdict(calibration), "about": about}
    write_onnx(fold_norms(network), inputs, ("answers",), path, metadata=metadata, any_size=True)


def write_onnx(
    network: nn.Module,
    inputs: dict[str, torch.Tensor],
    outputs: tuple[str, ...],
    path: Path,
    *,
    metadata: dict[str, object],
    any_size: bool = False,
) -> None:
    """Write the network as one ONNX file, its metadata as JSON.

    With `any_size` the last two axes of inputs and outputs may be of any length: for networks in which nothing
    depends on it.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # the exporter warns of its own internals
        program = torch.onnx.export(
            network,
            tuple(inputs.values()),
            dynamo=True,
            input_names=list(inputs),
            output_names=list(outputs),
            verbose=False,
        )
    if program is None:
        raise RuntimeError(f"{path}: expected an ONNX program from torch.onnx.export, got none")
    model = program.model_proto
    strip_sources(model)
    if any_size:
        del model.graph.value_info[:]  # lengths of what lies between
        for value in (*model.graph.input, *model.graph.output):
            for axis in (2, 3):
                value.type.tensor_type.shape.dim[axis].dim_param = f"{value.name}_{axis}"
    write_model(model, path, metadata)


def strip_sources(model: "onnx.ModelProto") -> None:
    """Take out where each node came from in the source: more room than half the weights, and local paths."""
    for node in model.graph.node:
        del node.metadata_props[:]
        node.doc_string = ""
    for value in (*model.graph.input, *model.graph.output, *model.graph.value_info, *model.graph.initializer):
        del value.metadata_props[:]
        value.doc_string = ""
    del model.graph.metadata_props[:]
    del model.metadata_props[:]


def write_model(model: "onnx.ModelProto", path: Path, metadata: Mapping[str, object]) -> None:
    """Write a checked model whole or not at all, its metadata as JSON."""
    import onnx

    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=json.dumps(value))
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_bytes(model.SerializeToString())
