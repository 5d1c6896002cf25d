"""How far a made picture is from the real one: pixel by pixel, and by what an eye looks at.

Pictures are RGB 0 to 1, channels first; a loss is one number, the mean over pictures. What an eye looks at is told by
one of two losses, which are not the same and are never called by each other's name:

- `PerceptualLoss`, Johnson et al.'s, on layers of a VGG network whose weights the user gives;
- `structure_loss`, ours, on gradients and local structure at several scales, which needs no weights.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from pgm_models.image_networks import PictureFeatures, Trunk, check_colours, fill, read_weights, trunk_of

CONTRAST = 0.03**2
"""Keeps the likeness of structure from being told of flat squares (SSIM's second constant, for colours to 1)."""
LAYERS = {"vgg16": (3, 8, 15, 22), "vgg19": (3, 8, 17, 26)}
"""relu1_2, relu2_2, relu3_3 (3_4) and relu4_3 (4_4): the last rectifier of the first four blocks."""


def l2_loss(
    made: Float[Tensor, "batch 3 height width"], real: Float[Tensor, "batch 3 height width"]
) -> Float[Tensor, ""]:
    """Mean squared difference of the colours."""
    return F.mse_loss(made, real)


@dataclass(frozen=True, kw_only=True)
class StructureOptions:
    """What `structure_loss` looks at. So weighted it is about as large as L2 where pictures are blurred by 1 px."""

    scales: int = 3
    """How many, each of half the size of the one before; those of no pixels are left out."""
    window: int = 5
    """Side of the square in which structure is compared, pixels of the scale; smaller scales are compared as one."""
    gradients: float = 0.05
    """Weight of the difference of gradients."""
    structure: float = 0.01
    """Weight of one minus the likeness of structure."""


def structure_loss(
    made: Float[Tensor, "batch 3 height width"],
    real: Float[Tensor, "batch 3 height width"],
    options: StructureOptions | None = None,
) -> Float[Tensor, ""]:
    """Mean over scales of how much gradients differ, and how little light and dark go together in small squares.

    Gradients are differences between neighbours, theirs the mean absolute difference. The likeness of structure is
    (2 covariance + c) / (variance + variance + c), as in SSIM, without its term for brightness, which is left to the
    squared difference. 0 for the same pictures.
    """
    options = options or StructureOptions()
    if made.dtype in (torch.float16, torch.bfloat16):
        made, real = made.float(), real.float()
    total, scales = made.new_zeros(()), 0
    for _ in range(options.scales):
        scales += 1
        unlike = gradient_difference(made, real) * options.gradients
        total = total + unlike + options.structure * (1 - structure_likeness(made, real, options.window))
        if min(made.shape[2:]) < 2:
            break
        made, real = F.avg_pool2d(made, 2), F.avg_pool2d(real, 2)
    return total / scales


def gradient_difference(
    made: Float[Tensor, "batch 3 height width"], real: Float[Tensor, "batch 3 height width"]
) -> Float[Tensor, ""]:
    """Mean absolute difference of the differences between neighbours, across and down; 0 where there are none."""
    difference = made - real
    total = made.new_zeros(())
    for axis in (2, 3):
        if difference.shape[axis] > 1:
            total = total + difference.diff(dim=axis).abs().mean()
    return total


def structure_likeness(
    made: Float[Tensor, "batch 3 height width"], real: Float[Tensor, "batch 3 height width"], window: int
) -> Float[Tensor, ""]:
    """Mean over squares of (2 covariance + c) / (variance + variance + c): 1 for the same, down to -1."""
    size = (min(window, made.shape[2]), min(window, made.shape[3]))

    def mean(values: Tensor) -> Tensor:
        return F.avg_pool2d(values, size, stride=1)

    mean_a, mean_b = mean(made), mean(real)
    variances = mean(made.square() + real.square()) - mean_a.square() - mean_b.square()
    covariance = mean(made * real) - mean_a * mean_b
    return ((2 * covariance + CONTRAST) / (variances.clamp(min=0.0) + CONTRAST)).mean()


class PerceptualLoss(nn.Module):
    """How far what VGG says of two pictures is apart: the mean squared difference of each of four layers, added up.

    Gradients reach the pictures; the network is not learned.
    Source: Johnson et al. 2016, eq. 2, on the four layers by which they compare style; Menapace et al. 2023 do not say
    which layers they take.
    """

    def __init__(self, trunk: Trunk) -> None:
        """With random weights: use `load_perceptual_loss`.

        Raises:
            ValueError: If the network is no VGG.
        """
        super().__init__()
        if trunk not in LAYERS:
            raise ValueError(f"perceptual loss: expected VGG16 or VGG19, got {trunk}")
        self.look = PictureFeatures(trunk, LAYERS[trunk])
        self.look.eval().requires_grad_(False)

    def forward(
        self, made: Float[Tensor, "batch 3 height width"], real: Float[Tensor, "batch 3 height width"]
    ) -> Float[Tensor, ""]:
        """The mean over pictures.

        Raises:
            ValueError: If a real colour is not between 0 and 1, or pictures are smaller than 8 pixels.
        """
        check_colours(real, "perceptual loss: real")
        with torch.no_grad():
            wanted = self.look(real)
        pairs = zip(self.look(made), wanted, strict=True)
        return torch.stack([F.mse_loss(a.float(), b.float()) for a, b in pairs]).sum()


def load_perceptual_loss(path: Path) -> PerceptualLoss:
    """The perceptual loss with the weights of that file, VGG16 or VGG19.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it holds something else.
    """
    weights = read_weights(path)
    loss = PerceptualLoss(trunk_of(weights))
    fill(loss.look, weights)
    return loss


@dataclass(frozen=True, eq=False, kw_only=True)
class EyeLoss:
    """One of the two losses of what an eye looks at, under its own name."""

    name: Literal["structure", "perceptual_vgg16", "perceptual_vgg19"]
    of: Callable[[Tensor, Tensor], Tensor]
    """Of made and real pictures."""


def eye_loss(vgg: Path | None, device: torch.device | str = "cpu") -> EyeLoss:
    """The perceptual loss where a file of VGG weights is given, else the structure loss."""
    if vgg is None:
        return EyeLoss(name="structure", of=structure_loss)
    loss = load_perceptual_loss(vgg).to(device)
    return EyeLoss(name="perceptual_vgg16" if loss.look.trunk == "vgg16" else "perceptual_vgg19", of=loss)


def reconstruction_losses(
    made: Float[Tensor, "batch 3 height width"], real: Float[Tensor, "batch 3 height width"], eye: EyeLoss
) -> dict[str, Tensor]:
    """`l2` and the eye's loss, by name, to be added up without weights as the paper does, and logged."""
    return {"l2": l2_loss(made, real), eye.name: eye.of(made, real)}
