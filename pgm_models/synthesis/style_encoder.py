"""What objects look like in a picture, as style codes: a residual stem, a crop of each object, and what reads crops.

Objects share all weights, so that a code read off one can be worn by another. Crops are taken at every scale of the
stem, as a far player is a dozen pixels wide and the court fills the picture.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from pgm_models.synthesis.presets import StyleOptions

SAMPLES = 4
"""Places within a crop's pixel, along each axis, whose mean it is."""
OWN_CROP = 4
"""Of an object's own network: pixels of its crop along each axis for one of those that all objects share."""
MEAN_RGB = (0.485, 0.456, 0.406)
STD_RGB = (0.229, 0.224, 0.225)
"""Of the pictures that ResNet-18 is trained on, channel by channel, of 1."""
NORM_EPSILON = 1e-5
"""Added to the variances of a batch norm, as its makers did."""


class StyleEncoder(nn.Module):
    """Style codes of a scene's objects from a picture that shows them.

    Source: Menapace et al. 2023, Style Encoder; Girshick et al. 2014 (crops). The stem's finer scales are our addition.
    """

    def __init__(self, options: StyleOptions, objects: int, style: int) -> None:
        """Fresh weights, for that many objects and numbers of a style."""
        super().__init__()
        self.crop = options.crop
        self.stem = ResidualStem(options.widths)
        width = options.widths[-1]
        # One channel more: the share of the picture in each of the crop's pixels.
        self.inward = nn.Conv2d(sum(self.stem.channels) + 1, width, 3, padding=1)
        self.smaller = nn.Conv2d(width, width, 3, stride=2, padding=1)
        cells = width * (-(-options.crop // 2)) ** 2
        self.norm = nn.LayerNorm(cells)
        self.out = nn.Linear(cells, style)
        self.unseen = nn.Parameter(torch.zeros(objects, style))
        """The codes of objects that a picture does not show."""

    def forward(
        self, pictures: Float[Tensor, "B 3 H W"], boxes_px: Float[Tensor, "B objects 4"]
    ) -> Float[Tensor, "B objects style"]:
        """The codes.

        Args:
            pictures: 0 to 1.
            boxes_px: x0, y0, x1, y1 of each object, which may lie partly outside; NaN where it has none. Such objects,
                and those whose box meets no part of the picture, have a learned code of their own.
        """
        size = (pictures.shape[2], pictures.shape[3])
        seen = shown(boxes_px, size)
        whole = boxes_px.new_tensor([-0.5, -0.5, size[1] - 0.5, size[0] - 0.5])
        crops = cropped(self.stem(pictures), torch.where(seen[..., None], boxes_px, whole), size, self.crop)
        here = functional.relu_(self.inward(crops.flatten(0, 1)))
        here = functional.relu_(self.smaller(here)).flatten(1)
        codes = self.out(self.norm(here)).unflatten(0, seen.shape)
        return torch.where(seen[..., None], codes, self.unseen)


class OwnStyleEncoders(nn.Module):
    """The same with a network for each object, which sees the picture's crop of it alone and shares nothing.

    What the paper compares its encoder with. Codes of one object mean nothing to another.
    Source: Menapace et al. 2022, Playable Environments, and 2023, section 5.2.2.
    """

    def __init__(self, options: StyleOptions, objects: int, style: int) -> None:
        """Fresh weights, for that many objects and numbers of a style."""
        super().__init__()
        self.crop = OWN_CROP * options.crop
        side = self.crop
        for _ in range(len(options.widths) + 1):  # the stem's first convolution and pooling, and a half for each more
            side = -(-side // 2)
        cells = options.widths[-1] * side**2
        self.stems = nn.ModuleList(ResidualStem(options.widths) for _ in range(objects))
        self.norms = nn.ModuleList(nn.LayerNorm(cells) for _ in range(objects))
        self.outs = nn.ModuleList(nn.Linear(cells, style) for _ in range(objects))
        self.unseen = nn.Parameter(torch.zeros(objects, style))
        """The codes of objects that a picture does not show."""

    def forward(
        self, pictures: Float[Tensor, "B 3 H W"], boxes_px: Float[Tensor, "B objects 4"]
    ) -> Float[Tensor, "B objects style"]:
        """The codes; as of `StyleEncoder`."""
        size = (pictures.shape[2], pictures.shape[3])
        seen = shown(boxes_px, size)
        whole = boxes_px.new_tensor([-0.5, -0.5, size[1] - 0.5, size[0] - 0.5])
        boxes = torch.where(seen[..., None], boxes_px, whole)
        crops = cropped([pictures], boxes, size, self.crop, finest=0)[:, :, :3]
        parts = zip(self.stems, self.norms, self.outs, crops.unbind(dim=1), strict=True)
        codes = torch.stack([out(norm(stem(crop)[-1].flatten(1))) for stem, norm, out, crop in parts], dim=1)
        return torch.where(seen[..., None], codes, self.unseen)


def shown(boxes_px: Float[Tensor, "*any 4"], size: tuple[int, int]) -> Bool[Tensor, "*any"]:
    """Whether each box, x0, y0, x1, y1, has an area within a picture of that height and width."""
    end = boxes_px.new_tensor([size[1] - 0.5, size[0] - 0.5])
    sides = torch.minimum(boxes_px[..., 2:], end) - boxes_px[..., :2].clamp(min=-0.5)
    return (sides > 0).all(dim=-1) & torch.isfinite(boxes_px).all(dim=-1)


def cropped(
    scales: Sequence[Float[Tensor, "B _ _ _"]],
    boxes_px: Float[Tensor, "B objects 4"],
    size: tuple[int, int],
    crop: int,
    *,
    finest: int = 1,
) -> Float[Tensor, "B objects channels crop crop"]:
    """Crops of features at several scales, one scale's channels after the other's, and last the share of the picture.

    A crop's pixel is the mean of places spread over it, 0 where these are outside the picture.

    Args:
        scales: Features, the k-th of which, counted from `finest`, has a cell at every 2^k-th pixel, pixel 0 the first.
        boxes_px: x0, y0, x1, y1 of what is cropped.
        size: Of the picture, height and width.
        crop: Pixels of a crop along each axis.
        finest: Of the scales.
    """
    places = (torch.arange(crop * SAMPLES, device=boxes_px.device) + 0.5) / (crop * SAMPLES)
    x, y = (boxes_px[..., axis, None].lerp(boxes_px[..., axis + 2, None], places) for axis in (0, 1))
    within = [(line >= -0.5) & (line <= side - 0.5) for line, side in ((x, size[1]), (y, size[0]))]
    inside = (within[1][..., :, None] & within[0][..., None, :]).to(boxes_px.dtype)
    parts = []
    for number, features in enumerate(scales, start=finest):
        # grid_sample has -1 and 1 on the outer edges of the first and the last cell.
        across, down = ((2 * line / 2**number + 1) / features.shape[axis] - 1 for line, axis in ((x, 3), (y, 2)))
        grid = torch.stack(torch.broadcast_tensors(across[..., None, :], down[..., :, None]), dim=-1)
        # The objects of a picture one below the other.
        values = functional.grid_sample(features, grid.flatten(1, 2), padding_mode="border", align_corners=False)
        parts.append(values.unflatten(2, inside.shape[1:3]).movedim(2, 1) * inside[:, :, None])
    parts.append(inside[:, :, None])
    return functional.avg_pool2d(torch.cat(parts, dim=2).flatten(0, 1), SAMPLES).unflatten(0, inside.shape[:2])


class ResidualStem(nn.Module):
    """Features of pictures at halves of their size, as a ResNet-18 of any widths makes them; parts carry its names.

    Batch norms are fixed: a factor and a shift of each channel, which are trained. Statistics of the two pictures of a
    step would say little.

    Source: He et al. 2016, Deep Residual Learning for Image Recognition, table 1.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, widths: Sequence[int]) -> None:
        """Fresh weights; one stage of two blocks for each width.

        Raises:
            ValueError: If there are no widths, or more than four.
        """
        super().__init__()
        if not 1 <= len(widths) <= 4:
            raise ValueError(f"widths: expected one to four, got {tuple(widths)}")
        self.channels = (widths[0], *widths)
        """Of the scales that it gives out."""
        self.conv1 = convolution(3, widths[0], size=7, stride=2)
        self.bn1 = Factor(widths[0])
        for number, (before, width) in enumerate(zip(self.channels, widths, strict=False), start=1):
            blocks = (ResidualBlock(before, width, stride=1 if number == 1 else 2), ResidualBlock(width, width))
            self.add_module(f"layer{number}", nn.Sequential(*blocks))
        for name, value in (("mean", MEAN_RGB), ("std", STD_RGB)):
            self.register_buffer(name, torch.tensor(value)[:, None, None], persistent=False)

    def forward(self, pictures: Float[Tensor, "B 3 H W"]) -> list[Tensor]:
        """Features (B, channels, rows, columns) with a cell at every 2nd, 4th, 8th ... pixel, from RGB 0 to 1."""
        here = ((pictures - self.mean) / self.std).contiguous(memory_format=torch.channels_last)
        here = functional.relu(self.bn1(self.conv1(here)))
        scales = [here]
        here = functional.max_pool2d(here, 3, stride=2, padding=1)
        for number in range(1, len(self.channels)):
            here = self.get_submodule(f"layer{number}")(here)
            scales.append(here)
        return scales

    @torch.no_grad()
    def read_resnet18(self, path: Path) -> None:
        """Take over the weights of a trained ResNet-18, a safetensors file or a state dict of torch.

        Names are the usual ones (`conv1.weight`, `bn1.running_mean`, `layer1.0.conv1.weight`, ...), under any prefix
        that all share; those of later layers are left out. Statistics of batch norms go into factors and shifts.

        Raises:
            ValueError: If the file is no such thing, or the stem's widths are not a ResNet-18's 64, 128, 256, 512.
        """
        found = _tensors(path)
        prefix = next(
            (name.removesuffix("conv1.weight") for name in sorted(found, key=len) if "conv1.weight" in name), ""
        )

        def tensor(name: str, shape: tuple[int, ...]) -> Tensor:
            value = found.get(prefix + name)
            if value is None or tuple(value.shape) != shape:
                got = "none" if value is None else str(tuple(value.shape))
                raise ValueError(f"{path}: {prefix}{name}: expected a tensor of shape {shape}, got {got}")
            return value.to(dtype=torch.float32)

        filled: dict[str, Tensor] = {}
        for name, module in self.named_modules():
            if isinstance(module, nn.Conv2d):
                filled[f"{name}.weight"] = tensor(f"{name}.weight", tuple(module.weight.shape))
            elif isinstance(module, Factor):
                shape = tuple(module.weight.shape)
                weight, bias, mean, variance = (
                    tensor(f"{name}.{part}", shape) for part in ("weight", "bias", "running_mean", "running_var")
                )
                filled[f"{name}.weight"] = weight / torch.sqrt(variance + NORM_EPSILON)
                filled[f"{name}.bias"] = bias - mean * filled[f"{name}.weight"]
        self.load_state_dict(filled)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions around which the input is added; without training only the input counts."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        """Fresh weights."""
        super().__init__()
        self.conv1 = convolution(inputs, outputs, stride=stride)
        self.bn1 = Factor(outputs)
        self.conv2 = convolution(outputs, outputs)
        self.bn2 = Factor(outputs, 0.0)
        self.downsample = None
        if stride > 1 or inputs != outputs:
            self.downsample = nn.Sequential(convolution(inputs, outputs, size=1), Factor(outputs))
        self.stride = stride

    def forward(self, inputs: Float[Tensor, "B inputs H W"]) -> Float[Tensor, "B outputs h w"]:
        """The outputs, each side divided by the stride and rounded up."""
        # Not the stride of the 1x1 convolution: with channels last in memory, its gradients write where they must not
        # on some CPUs (torch 2.13).
        straight = inputs[:, :, :: self.stride, :: self.stride]
        if self.downsample is not None:
            straight = self.downsample(straight)
        return functional.relu(straight + self.bn2(self.conv2(functional.relu(self.bn1(self.conv1(inputs))))))


class Factor(nn.Module):
    """Channels times a factor, plus a shift: a batch norm whose statistics are fixed."""

    def __init__(self, channels: int, factor: float = 1.0) -> None:
        """That factor for all channels, and no shift."""
        super().__init__()
        self.weight = nn.Parameter(torch.full((channels,), factor))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, inputs: Float[Tensor, "B channels H W"]) -> Float[Tensor, "B channels H W"]:
        """The outputs."""
        return torch.addcmul(self.bias[:, None, None], inputs, self.weight[:, None, None])


def convolution(inputs: int, outputs: int, *, size: int = 3, stride: int = 1) -> nn.Conv2d:
    """One without a shift, whose fresh weights keep the size of what a ReLU gave."""
    made = nn.Conv2d(inputs, outputs, size, stride=stride, padding=size // 2, bias=False)
    nn.init.kaiming_normal_(made.weight, nonlinearity="relu")
    return made


def _tensors(path: Path) -> Mapping[str, Tensor]:
    """Tensors of a file by name."""
    import pickle

    from safetensors import SafetensorError
    from safetensors.torch import load_file

    try:
        if path.suffix == ".safetensors":
            return load_file(path)
        found = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, SafetensorError, pickle.UnpicklingError, EOFError) as error:
        raise ValueError(f"{path}: expected weights of a ResNet-18, got {error}") from error
    if not isinstance(found, Mapping) or not all(isinstance(value, Tensor) for value in found.values()):
        raise ValueError(f"{path}: expected tensors by name, got {type(found).__name__}")
    return cast("Mapping[str, Tensor]", found)
