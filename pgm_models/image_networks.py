"""Networks that look at pictures with weights a user gives: VGG and AlexNet, and LPIPS, which compares by them.

Nothing is ever fetched, and nothing that is missing is replaced by something that resembles it: a metric whose weights
were not given is `MetricUnavailable`, and tables show it as n/a. Weights are safetensors files or files of torch's own
format, of which only tensors are read. Pictures are RGB 0 to 1, channels first.

The layout of names in a file is that of the usual public ones: `features.N.weight` and `features.N.bias`, N the
position in a sequence of convolutions, rectifiers and poolings; other entries (`classifier...`) are not looked at.
"""

import hashlib
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from pgm_models.image_metrics import RANGE_SLACK

COLOUR_MEAN, COLOUR_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the pictures that public VGG and AlexNet weights were trained on, which expect colours relative to them."""
KNOWN_FILES: Mapping[str, str] = MappingProxyType(
    {
        "397923af": "VGG16, ImageNet",
        "dcbb9e9d": "VGG19, ImageNet",
        "7be5be79": "AlexNet, ImageNet",
        "4df8aa71": "AlexNet, ImageNet",
        "6726825d": "Inception v3 of 2015-12-05, the one of FID",
    }
)
"""What public files hold, by how their SHA-256 begins (the last part of their public names)."""
Trunk = Literal["alexnet", "vgg16", "vgg19"]
"""A network without its classifier."""


class MetricUnavailable(Exception):
    """A metric that cannot be computed here; its text says why."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Weights:
    """Tensors out of a file."""

    path: Path
    sha256: str
    """Of the file, hexadecimal."""
    tensors: Mapping[str, Tensor]
    """By name."""

    @property
    def origin(self) -> str:
        """What the file is, as a table should say beside what was computed with it."""
        known = KNOWN_FILES.get(self.sha256[:8])
        return known or f"{self.path.name}, not a public file known here, SHA-256 {self.sha256[:12]}"


def read_weights(path: Path) -> Weights:
    """The tensors of a safetensors file or of a file of torch's own format.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it holds anything but tensors by name.
    """
    if not path.is_file():
        raise FileNotFoundError(f"weights: no file {path}")
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    loaded = _safetensors(path) if path.suffix == ".safetensors" else _torch_file(path)
    if isinstance(loaded, dict) and isinstance(loaded.get("state_dict"), dict):
        loaded = loaded["state_dict"]
    if not (isinstance(loaded, dict) and loaded and all(isinstance(value, Tensor) for value in loaded.values())):
        raise ValueError(f"weights {path}: expected tensors by name, got {type(loaded).__name__}")
    return Weights(path=path, sha256=sha256, tensors=MappingProxyType(loaded))


def _safetensors(path: Path) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        return load_file(path)
    except SafetensorError as error:
        raise ValueError(f"weights {path}: expected a safetensors file, got {error}") from error


def _torch_file(path: Path) -> object:
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError) as error:
        raise ValueError(f"weights {path}: expected a file of tensors only, got {str(error)[:200]}") from error


def fill(network: nn.Module, weights: Weights) -> None:
    """Put the weights into the network, which is then for looking only; entries it has no place for are left alone.

    Raises:
        ValueError: If one it needs is missing or of another shape; names it.
    """
    taken = {}
    for name, value in network.state_dict().items():
        given = weights.tensors.get(name)
        if given is None and name.endswith("num_batches_tracked"):
            given = value
        if given is None or given.shape != value.shape:
            got = "none" if given is None else tuple(given.shape)
            raise ValueError(f"weights {weights.path}: {name}: expected {tuple(value.shape)}, got {got}")
        taken[name] = given.to(value.dtype)
    network.load_state_dict(taken)
    network.eval().requires_grad_(False)


def check_colours(pictures: Tensor, name: str) -> None:
    """See that colours run from 0 to 1.

    Raises:
        ValueError: If they do not, as those from -1 to 1 or to 255, or are not finite.
    """
    if pictures.numel():
        low, high = (float(value) for value in pictures.detach().aminmax())
        # Written so that NaN is refused too.
        if not (low >= -RANGE_SLACK and high <= 1 + RANGE_SLACK):
            raise ValueError(f"{name}: expected colours from 0 to 1, got {low:.4g} to {high:.4g}")


class PictureFeatures(nn.Module):
    """What some layers of AlexNet or VGG say of pictures."""

    def __init__(self, trunk: Trunk, layers: Sequence[int] | None = None) -> None:
        """With random weights: `fill` them.

        Args:
            trunk: Which.
            layers: Positions in `features` of those that are given out, rectifiers; those of LPIPS unless told.
        """
        super().__init__()
        self.trunk: Trunk = trunk
        self.layers = tuple(layers if layers is not None else LPIPS_LAYERS[trunk])
        self.features = (_alexnet() if trunk == "alexnet" else _vgg(CONVOLUTIONS[trunk]))[: max(self.layers) + 1]
        self.register_buffer("mean", torch.tensor(COLOUR_MEAN)[:, None, None], persistent=False)
        self.register_buffer("std", torch.tensor(COLOUR_STD)[:, None, None], persistent=False)

    def forward(self, pictures: Float[Tensor, "batch 3 height width"]) -> list[Tensor]:
        """Of each of the layers, the earliest first.

        Raises:
            ValueError: If the pictures are too small for the last layer.
        """
        x = (pictures - self.get_buffer("mean")) / self.get_buffer("std")
        found = []
        for position, layer in enumerate(self.features.children()):
            if isinstance(layer, nn.MaxPool2d) and min(x.shape[2:]) < POOLED[self.trunk]:
                raise ValueError(f"pictures: expected larger ones for {self.trunk}, got {tuple(pictures.shape[2:])} px")
            x = layer(x)
            if position in self.layers:
                found.append(x)
        return found


CONVOLUTIONS: Mapping[str, tuple[int, ...]] = MappingProxyType({"vgg16": (2, 2, 3, 3, 3), "vgg19": (2, 2, 4, 4, 4)})
"""How many each of VGG's blocks has."""
POOLED: Mapping[str, int] = MappingProxyType({"alexnet": 3, "vgg16": 2, "vgg19": 2})
"""Side of the squares that are pooled, pixels."""
LPIPS_LAYERS: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {"alexnet": (1, 4, 7, 9, 11), "vgg16": (3, 8, 15, 22, 29), "vgg19": (3, 8, 17, 26, 35)}
)
"""The last rectifier of each block of VGG, and all five of AlexNet."""


def _vgg(convolutions: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    channels = 3
    for width, number in zip((64, 128, 256, 512, 512), convolutions, strict=True):
        for _ in range(number):
            layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            channels = width
        layers.append(nn.MaxPool2d(2))
    return nn.Sequential(*layers)


def _alexnet() -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(3, 64, 11, stride=4, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(64, 192, 5, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(192, 384, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(384, 256, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(256, 256, 3, padding=1),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
    )


def trunk_of(weights: Weights) -> Trunk:
    """Which network the weights are of, told by where its convolutions lie.

    Raises:
        ValueError: If by that it is none of them.
    """
    shapes = {name: tuple(value.shape) for name, value in weights.tensors.items()}
    for name in ("alexnet", "vgg16", "vgg19"):
        with torch.device("meta"):
            network = _alexnet() if name == "alexnet" else _vgg(CONVOLUTIONS[name])
        expected = {f"features.{key}": tuple(value.shape) for key, value in network.state_dict().items()}
        held = {key: shape for key, shape in shapes.items() if key.startswith("features.")}
        if expected == held:
            return name
    raise ValueError(
        f"weights {weights.path}: expected AlexNet, VGG16 or VGG19 as features.N.weight and features.N.bias, "
        f"got {len(shapes)} others, as {next(iter(shapes))}"
    )


class Lpips(nn.Module):
    """LPIPS: a weighted distance between what layers say of two pictures, 0 for the same.

    Source: Zhang et al. 2018, eq. 1, version 0.1 of its linear heads.
    """

    def __init__(self, trunk: Trunk) -> None:
        """With random weights."""
        super().__init__()
        self.look = PictureFeatures(trunk)
        widths = (64, 192, 384, 256, 256) if trunk == "alexnet" else (64, 128, 256, 512, 512)
        # Names as in the public files of heads: each holds a dropout, which does nothing here, and the convolution.
        self.heads = nn.ModuleDict(
            {
                f"lin{index}": nn.ModuleDict(
                    {"model": nn.ModuleDict({"1": nn.Conv2d(width, 1, 1, bias=False)})},
                )
                for index, width in enumerate(widths)
            }
        )
        self.origin = "random weights"

    def forward(
        self, made: Float[Tensor, "batch 3 height width"], real: Float[Tensor, "batch 3 height width"]
    ) -> Float[Tensor, " batch"]:
        """The distance of each pair.

        Raises:
            ValueError: If a colour is not between 0 and 1.
        """
        for name, pictures in (("made", made), ("real", real)):
            check_colours(pictures, f"LPIPS: {name}")
        total = made.new_zeros(len(made))
        for a, b, head in zip(self.look(made), self.look(real), self.heads.values(), strict=True):
            weight = head.get_parameter("model.1.weight")
            total = total + F.conv2d((_unit(a) - _unit(b)).square(), weight).mean(dim=(1, 2, 3))
        return total


def _unit(features: Tensor) -> Tensor:
    """Features of each pixel with a length of 1."""
    return features / (features.norm(dim=1, keepdim=True) + 1e-10)


def load_lpips(trunk: Path | None, heads: Path | None) -> Lpips:
    """LPIPS with the weights of those files.

    Args:
        trunk: AlexNet or VGG16 as trained on ImageNet.
        heads: The linear heads for it, `lin0.model.1.weight` to `lin4.model.1.weight`.

    Raises:
        MetricUnavailable: If one was not given.
        FileNotFoundError: If one is not there.
        ValueError: If one holds something else.
    """
    if trunk is None or heads is None:
        raise MetricUnavailable("LPIPS: weights not given")
    look, linear = read_weights(trunk), read_weights(heads)
    name = trunk_of(look)
    if name == "vgg19":
        raise ValueError(f"weights {trunk}: expected AlexNet or VGG16, for which there are heads, got VGG19")
    network = Lpips(name)
    fill(network.look, look)
    fill(network.heads, linear)
    negative = [key for key, head in linear.tensors.items() if key.startswith("lin") and bool((head < 0).any())]
    if negative:
        raise ValueError(f"weights {heads}: {negative[0]}: expected none below 0, as LPIPS has them, got some")
    network.origin = f"{look.origin}; heads {linear.origin}"
    return network.eval().requires_grad_(False)


def shown(value: float | MetricUnavailable, digits: int = 3) -> str:
    """A figure for a table; n/a, and why, where there is none."""
    return f"n/a ({value})" if isinstance(value, MetricUnavailable) else f"{value:.{digits}f}"
