"""Losses of pictures against slow loops, their invariances, and the perceptual loss with weights from a file."""

from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from safetensors.torch import save_file

from pgm_models.image_networks import COLOUR_MEAN, COLOUR_STD, PictureFeatures
from pgm_models.synthesis.losses import (
    PerceptualLoss,
    StructureOptions,
    eye_loss,
    gradient_difference,
    l2_loss,
    load_perceptual_loss,
    reconstruction_losses,
    structure_likeness,
    structure_loss,
)


def pair(height: int = 12, width: int = 14, batch: int = 2, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """A made and a real batch."""
    draw = torch.Generator().manual_seed(seed)
    real = torch.rand(batch, 3, height, width, generator=draw)
    return (0.7 * real + 0.3 * torch.rand(real.shape, generator=draw)), real


@pytest.fixture(scope="module")
def vgg16(tmp_path_factory) -> Path:
    """VGG16 with random weights in a file of the usual layout, half precision, some of its classifier too."""
    torch.manual_seed(0)
    network = PictureFeatures("vgg16", range(30))
    path = tmp_path_factory.mktemp("weights") / "vgg.safetensors"
    tensors = {name: value.half() for name, value in network.state_dict().items()}
    save_file(tensors | {"classifier.6.bias": torch.zeros(1000)}, path)
    return path


def test_l2_is_the_mean_squared_difference():
    made, real = pair()
    assert l2_loss(made, real).item() == pytest.approx(np.mean((made.numpy() - real.numpy()) ** 2), rel=1e-5)


def test_gradients_differ_as_a_loop_over_neighbours_says():
    made, real = pair(4, 5, 1)
    difference = (made - real)[0].numpy()
    across = [abs(difference[c, y, x + 1] - difference[c, y, x]) for c in range(3) for y in range(4) for x in range(4)]
    down = [abs(difference[c, y + 1, x] - difference[c, y, x]) for c in range(3) for y in range(3) for x in range(5)]
    assert gradient_difference(made, real).item() == pytest.approx(np.mean(across) + np.mean(down), rel=1e-5)


def test_structure_is_as_alike_as_a_loop_over_windows_says():
    made, real = pair(6, 8, 1)
    values = []
    for colour in range(3):
        for y in range(4):
            for x in range(6):
                a, b = (p[0, colour, y : y + 3, x : x + 3].double().numpy().ravel() for p in (made, real))
                cov = np.cov(a, b, bias=True)
                values.append((2 * cov[0, 1] + 0.0009) / (cov[0, 0] + cov[1, 1] + 0.0009))
    assert structure_likeness(made, real, 3).item() == pytest.approx(np.mean(values), abs=1e-5)


def test_scales_are_averaged_each_of_half_the_size():
    made, real = pair(16, 20)
    options = StructureOptions(scales=3, window=5, gradients=0.3, structure=0.7)
    wanted = 0.0
    for scale in range(3):
        a, b = (F.avg_pool2d(p, 2**scale) for p in (made, real))
        unlike = 1 - structure_likeness(a, b, 5)
        wanted += (0.3 * gradient_difference(a, b) + 0.7 * unlike).item() / 3
    assert structure_loss(made, real, options).item() == pytest.approx(wanted, rel=1e-5)


def test_equal_pictures_cost_nothing_and_others_something():
    made, real = pair()
    assert structure_loss(real, real).item() == pytest.approx(0.0, abs=1e-7)
    assert structure_loss(made, real).item() > 1e-3


def test_structure_does_not_mind_brightness_and_l2_does():
    _, real = pair()
    brighter = real + 0.1
    assert structure_loss(brighter, real).item() < 1e-5
    assert l2_loss(brighter, real).item() == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 9), (3, 2), (5, 7)])
def test_small_and_odd_patches_have_finite_losses_and_gradients(height, width):
    made, real = pair(height, width)
    made.requires_grad_()
    loss = structure_loss(made, real)
    loss.backward()
    assert torch.isfinite(loss)
    assert made.grad is not None
    assert torch.isfinite(made.grad).all()


def test_flat_black_pictures_have_finite_gradients():
    made = torch.zeros(1, 3, 8, 8, requires_grad=True)
    structure_loss(made, torch.zeros(1, 3, 8, 8)).backward()
    assert made.grad is not None
    assert torch.isfinite(made.grad).all()


def test_gradients_of_the_structure_loss_are_right():
    made, real = (p.double() for p in pair(3, 4, 1))
    made.requires_grad_()
    assert torch.autograd.gradcheck(lambda p: structure_loss(p, real, StructureOptions(scales=2, window=3)), (made,))


def test_half_precision_is_summed_in_full():
    made, real = pair(32, 32)
    half = structure_loss(made.bfloat16(), real.bfloat16())
    assert half.dtype == torch.float32
    assert half.item() == pytest.approx(structure_loss(made, real).item(), rel=0.05)


def test_the_perceptual_loss_is_that_of_the_files_layers(vgg16):
    made, real = pair(16, 24, 1)
    loss = load_perceptual_loss(vgg16)
    given = {name: value.float() for name, value in loss.look.state_dict().items()}

    def layers(pictures: torch.Tensor) -> list[torch.Tensor]:
        """relu1_2, relu2_2, relu3_3 and relu4_3 by the positions of the public layout."""
        x = (pictures - torch.tensor(COLOUR_MEAN)[:, None, None]) / torch.tensor(COLOUR_STD)[:, None, None]
        found = []
        for block in ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21)):
            if found:
                x = F.max_pool2d(x, 2)
            for position in block:
                weight, bias = given[f"features.{position}.weight"], given[f"features.{position}.bias"]
                x = F.conv2d(x, weight, bias, padding=1).relu()
            found.append(x)
        return found

    wanted = sum(((a - b) ** 2).mean() for a, b in zip(layers(made), layers(real), strict=True))
    assert loss(made, real).item() == pytest.approx(float(wanted), rel=1e-4)
    assert loss(real, real).item() == 0.0


def test_the_perceptual_loss_moves_pictures_and_not_its_network(vgg16):
    made, real = pair(16, 16, 1)
    made.requires_grad_()
    loss = load_perceptual_loss(vgg16)
    loss(made, real).backward()
    assert made.grad is not None
    assert made.grad.abs().sum() > 0
    assert not any(parameter.requires_grad for parameter in loss.parameters())


def test_the_perceptual_loss_refuses_colours_of_another_range_and_tiny_pictures():
    loss = PerceptualLoss("vgg16")
    made, real = pair(8, 8, 1)
    with pytest.raises(ValueError, match="perceptual loss: real: expected colours from 0 to 1"):
        loss(made, real * 2 - 1)
    with pytest.raises(ValueError, match="expected larger ones for vgg16, got \\(4, 9\\) px"):
        loss(*pair(4, 9, 1))
    with pytest.raises(ValueError, match="expected VGG16 or VGG19, got alexnet"):
        PerceptualLoss("alexnet")


def test_each_of_the_eyes_losses_goes_by_its_own_name(vgg16):
    made, real = pair(16, 16, 1)
    without, with_weights = eye_loss(None), eye_loss(vgg16)
    assert set(reconstruction_losses(made, real, without)) == {"l2", "structure"}
    terms = reconstruction_losses(made, real, with_weights)
    assert set(terms) == {"l2", "perceptual_vgg16"}
    assert terms["l2"].item() == pytest.approx(l2_loss(made, real).item())
