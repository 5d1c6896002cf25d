"""The network that tells contacts from a ball's track, and its one ONNX file."""

import json
import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

from pgm_data.dataset.files import whole_file
from pgm_data.detect.ball.track_features import FEATURES, STEP_S
from pgm_data.detect.ball.track_network import CLASSES

WIDTH = 32
DILATIONS = (1, 2, 4, 8, 16, 24, 8, 2)


class Look(nn.Module):
    """A residual look at five places so many steps apart."""

    def __init__(self, width: int, dilation: int) -> None:
        """Channels, and steps between the places."""
        super().__init__()
        self.look = nn.Conv1d(width, width, 5, padding=2 * dilation, dilation=dilation)
        self.norm = nn.BatchNorm1d(width)
        self.mix = nn.Conv1d(width, width, 1)

    def forward(self, x: Tensor) -> Tensor:
        """The input and what was seen."""
        return x + self.mix(torch.relu(self.norm(self.look(x))))


class TrackEventNet(nn.Module):
    """Logits of what happens in each step: (batch, classes, steps) from features (batch, features, steps)."""

    def __init__(self, width: int = WIDTH, dilations: tuple[int, ...] = DILATIONS) -> None:
        """Channels, and steps between the places of each look."""
        super().__init__()
        self.stem = nn.Conv1d(FEATURES, width, 5, padding=2)
        self.looks = nn.Sequential(*(Look(width, d) for d in dilations))
        self.norm = nn.BatchNorm1d(width)
        self.head = nn.Conv1d(width, len(CLASSES), 1)

    def forward(self, features: Tensor) -> Tensor:
        """The logits."""
        return self.head(torch.relu(self.norm(self.looks(self.stem(features)))))


def export_track_events(network: TrackEventNet, path: Path, *, about: dict[str, object]) -> None:
    """Write the network as one ONNX file that takes any number of steps; `about`, JSON values, is its metadata."""
    import onnx

    steps = torch.export.Dim("steps", min=2, max=1 << 20)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # the exporter warns of its own internals
        program = torch.onnx.export(
            network.eval(),
            (torch.zeros(1, FEATURES, 512),),
            dynamo=True,
            input_names=["features"],
            output_names=["logits"],
            dynamic_shapes=({2: steps},),
            verbose=False,
        )
    if program is None:
        raise RuntimeError(f"{path}: expected an ONNX program from torch.onnx.export, got none")
    model = program.model_proto
    # Where each node came from in the source takes room, and holds local paths.
    for node in model.graph.node:
        del node.metadata_props[:]
        node.doc_string = ""
    for value in (*model.graph.input, *model.graph.output, *model.graph.value_info, *model.graph.initializer):
        del value.metadata_props[:]
        value.doc_string = ""
    del model.graph.metadata_props[:]
    del model.metadata_props[:]
    for key, value in {"classes": list(CLASSES), "step_s": STEP_S, "about": about}.items():
        model.metadata_props.add(key=key, value=json.dumps(value))
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_bytes(model.SerializeToString())
