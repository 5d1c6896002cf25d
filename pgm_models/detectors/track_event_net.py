"""The network that tells contacts from a ball's track, and its one ONNX file."""

import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

from pgm_data.detect.ball.track_features import FEATURES, STEP_S
from pgm_data.detect.ball.track_network import CLASSES
from pgm_models.detectors.export import strip_sources, write_model

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
    strip_sources(program.model_proto)
    write_model(program.model_proto, path, {"classes": list(CLASSES), "step_s": STEP_S, "about": about})
