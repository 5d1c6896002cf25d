from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch.nn import functional

from pgm_models.synthesis.presets import StyleOptions
from pgm_models.synthesis.style_encoder import Factor, OwnStyleEncoders, ResidualStem, StyleEncoder, cropped, shown

NAN = float("nan")


def drawn(*sizes: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*sizes, generator=torch.Generator().manual_seed(seed))


def encoder_of(objects: int, widths: tuple[int, ...] = (4, 6), crop: int = 4) -> StyleEncoder:
    """One whose blocks count and whose unseen codes are not those of any other."""
    torch.manual_seed(0)
    encoder = StyleEncoder(StyleOptions(widths=widths, crop=crop), objects, 5)
    for parameter in encoder.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    return encoder


def resnet18(widths: tuple[int, ...], prefix: str = "") -> dict[str, torch.Tensor]:
    """Weights of a ResNet-18 of those widths under the usual names, with a last layer that no stem has."""
    state: dict[str, torch.Tensor] = {}

    def convolution(name: str, outputs: int, inputs: int, size: int) -> None:
        state[name + ".weight"] = (
            torch.randn(outputs, inputs, size, size, generator=generator) / (inputs * size**2) ** 0.5
        )

    def norm(name: str, width: int) -> None:
        for part, low in (("weight", 0.5), ("bias", -0.5), ("running_mean", -0.5), ("running_var", 0.5)):
            state[f"{name}.{part}"] = low + torch.rand(width, generator=generator)
        state[f"{name}.num_batches_tracked"] = torch.tensor(7)

    generator = torch.Generator().manual_seed(3)
    convolution("conv1", widths[0], 3, 7)
    norm("bn1", widths[0])
    for layer, width in enumerate(widths, start=1):
        for block in (0, 1):
            name, before = f"layer{layer}.{block}", widths[max(layer - 2, 0)] if block == 0 else width
            convolution(name + ".conv1", width, before, 3)
            norm(name + ".bn1", width)
            convolution(name + ".conv2", width, width, 3)
            norm(name + ".bn2", width)
            if block == 0 and layer > 1:
                convolution(name + ".downsample.0", width, before, 1)
                norm(name + ".downsample.1", width)
    state["fc.weight"] = torch.zeros(10, 4)
    return {prefix + name: value for name, value in state.items()}


def resnet18_features(state: dict[str, torch.Tensor], pictures: torch.Tensor, layers: int) -> list[torch.Tensor]:
    """What a ResNet-18 in use gives after its first convolution and after each layer, written out."""

    def convolved(here: torch.Tensor, name: str, stride: int) -> torch.Tensor:
        weight = state[name + ".weight"]
        return functional.conv2d(here, weight, stride=stride, padding=weight.shape[2] // 2)

    def normed(here: torch.Tensor, name: str) -> torch.Tensor:
        mean, variance = state[f"{name}.running_mean"], state[f"{name}.running_var"]
        return functional.batch_norm(here, mean, variance, state[f"{name}.weight"], state[f"{name}.bias"], eps=1e-5)

    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    here = (pictures - mean[:, None, None]) / std[:, None, None]
    here = normed(convolved(here, "conv1", 2), "bn1").relu()
    features = [here]
    here = functional.max_pool2d(here, 3, 2, 1)
    for layer in range(1, layers + 1):
        for block in (0, 1):
            name, stride = f"layer{layer}.{block}", 2 if layer > 1 and block == 0 else 1
            straight = here
            if f"{name}.downsample.0.weight" in state:
                straight = normed(convolved(here, f"{name}.downsample.0", stride), f"{name}.downsample.1")
            here = normed(convolved(here, f"{name}.conv1", stride), f"{name}.bn1").relu()
            here = (straight + normed(convolved(here, f"{name}.conv2", 1), f"{name}.bn2")).relu()
        features.append(here)
    return features


@pytest.mark.parametrize("form", ["safetensors", "pth"])
def test_a_stem_with_the_weights_of_a_resnet_gives_its_features(tmp_path: Path, form: str) -> None:
    path, prefix = tmp_path / f"resnet18.{form}", "backbone." if form == "pth" else ""
    state = resnet18((64, 128), prefix)
    save_file(state, path) if form == "safetensors" else torch.save(state, path)
    stem = ResidualStem((64, 128))
    stem.read_resnet18(path)
    pictures = drawn(2, 3, 37, 42)
    expected = resnet18_features({name.removeprefix(prefix): value for name, value in state.items()}, pictures, 2)
    said = stem(pictures)
    assert len(said) == 3
    for mine, theirs in zip(said, expected, strict=True):
        torch.testing.assert_close(mine.detach(), theirs, rtol=1e-4, atol=1e-4)


def test_weights_of_something_else_are_refused(tmp_path: Path) -> None:
    stem = ResidualStem((4, 8))
    before = {name: value.clone() for name, value in stem.state_dict().items()}
    path = tmp_path / "stem.safetensors"
    with pytest.raises(ValueError, match="stem.safetensors: expected weights of a ResNet-18"):
        stem.read_resnet18(path)
    path.write_bytes(b"no weights at all")
    with pytest.raises(ValueError, match="stem.safetensors: expected weights of a ResNet-18"):
        stem.read_resnet18(path)
    save_file(resnet18((4, 16)), path)
    with pytest.raises(ValueError, match=r"layer2.0.conv1.weight: expected .* \(8, 4, 3, 3\), got \(16, 4, 3, 3\)"):
        stem.read_resnet18(path)
    save_file({"embedding": torch.zeros(3)}, path)
    with pytest.raises(ValueError, match="conv1.weight: expected .* got none"):
        stem.read_resnet18(path)
    listed = tmp_path / "list.pth"
    torch.save([torch.zeros(3)], listed)
    with pytest.raises(ValueError, match="expected tensors by name, got list"):
        stem.read_resnet18(listed)
    listed.write_bytes(b"neither")
    with pytest.raises(ValueError, match="list.pth: expected weights of a ResNet-18"):
        stem.read_resnet18(listed)
    assert all(torch.equal(value, before[name]) for name, value in stem.state_dict().items())


def test_cells_of_each_scale_lie_on_every_second_fourth_eighth_pixel() -> None:
    torch.manual_seed(0)
    stem = ResidualStem((4, 4, 6)).requires_grad_(False).double()
    for module in stem.modules():
        if isinstance(module, torch.nn.Conv2d):
            module.weight.data += module.weight.data.flip(3)
        elif isinstance(module, Factor):
            module.weight.data += 0.5
    # A picture that is its own mirror image about column 32, which is a cell of every scale.
    pictures = drawn(1, 3, 40, 65).double()
    pictures = pictures + pictures.flip(3)
    for scale, features in enumerate(stem(pictures), start=1):
        assert features.shape[2:] == (-(-40 // 2**scale), 64 // 2**scale + 1)
        torch.testing.assert_close(features, features.flip(3))
        assert not torch.allclose(features, features.flip(2))


def test_a_crop_of_places_is_the_places_of_the_crop() -> None:
    scales = []
    for k, channels in ((1, 2), (2, 2), (3, 2)):
        rows, columns = torch.meshgrid(torch.arange(128 >> k) * 2.0**k, torch.arange(160 >> k) * 2.0**k, indexing="ij")
        scales.append(torch.stack([columns, rows])[None].expand(2, channels, -1, -1))
    boxes = torch.tensor(
        [[[10.0, 20.0, 50.0, 100.0], [3.0, 4.0, 7.5, 6.0]], [[60.0, 0.0, 61.0, 1.0], [0, 0, 150, 119]]]
    )
    said = cropped(scales, boxes, (128, 160), 5)
    share = (torch.arange(5) + 0.5) / 5
    for picture in range(2):
        for number in range(2):
            x0, y0, x1, y1 = boxes[picture, number].tolist()
            columns, rows = (x0 + share * (x1 - x0)).expand(5, 5), (y0 + share * (y1 - y0))[:, None].expand(5, 5)
            expected = torch.stack([columns, rows] * 3 + [torch.ones(5, 5)])
            torch.testing.assert_close(said[picture, number], expected, rtol=0, atol=1e-3)


def test_of_a_crop_beyond_the_border_there_is_nothing() -> None:
    ones = [torch.ones(1, 1, 20, 30), torch.ones(1, 1, 10, 15)]
    boxes = torch.tensor([[[-20.5, -0.5, 19.5, 39.5], [39.5, 19.5, 79.5, 59.5], [-1e9, -1e9, 1e9, 1e9]]])
    said = cropped(ones, boxes, (40, 60), 4)
    left, top_left = torch.zeros(4, 4), torch.zeros(4, 4)
    left[:, 2:] = top_left[:2, :2] = 1
    for channel in range(3):
        torch.testing.assert_close(said[0, 0, channel], left)
        torch.testing.assert_close(said[0, 1, channel], top_left)
    assert torch.isfinite(said).all()


def test_objects_that_no_pixel_shows_have_their_learned_code() -> None:
    encoder = encoder_of(6)
    there, beside, none = [5.0, 5.0, 20.0, 25.0], [60.5, 5.0, 80.0, 9.0], [NAN] * 4
    boxes = torch.tensor([there, beside, none, [8.0, NAN, 9.0, 9.0], [9.0, 9.0, 9.0, 12.0], [9.0, 9.0, 5.0, 12.0]])
    assert shown(boxes, (40, 60)).tolist() == [True, False, False, False, False, False]
    codes = encoder(drawn(2, 3, 40, 60), boxes.expand(2, 6, 4))
    assert torch.equal(codes[:, 1:], encoder.unseen[1:].expand(2, 5, 5))
    assert not torch.allclose(codes[:, 0], encoder.unseen[0])
    codes.square().sum().backward()
    assert encoder.unseen.grad is not None
    assert (encoder.unseen.grad.abs().amax(dim=1) > 0).tolist() == [False, True, True, True, True, True]
    for name, parameter in encoder.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().max() > 0, name


def test_codes_do_not_depend_on_other_objects_or_pictures() -> None:
    encoder = encoder_of(2).requires_grad_(False)
    pictures = drawn(2, 3, 40, 60)
    boxes = torch.tensor([[5.0, 5.0, 20.0, 25.0], [30.0, 10.0, 70.0, 50.0]]).expand(2, 2, 4)
    both = encoder(pictures, boxes)
    torch.testing.assert_close(encoder(pictures[1:], boxes[1:])[0], both[1])
    swapped = encoder(pictures, boxes.flip(1))
    torch.testing.assert_close(swapped.flip(1), both)
    assert float((both[0] - both[1]).abs().min()) > 1e-4


def test_what_is_seen_elsewhere_has_the_same_code() -> None:
    encoder = encoder_of(1).requires_grad_(False)
    pictures = torch.full((2, 3, 160, 176), 0.4)
    person = drawn(3, 20, 9, seed=4)
    pictures[0, :, 60:80, 64:73] = person
    pictures[1, :, 76:96, 96:105] = person
    boxes = torch.tensor([[[63.5, 59.5, 72.5, 79.5]], [[95.5, 75.5, 104.5, 95.5]]])
    codes = encoder(pictures, boxes)
    torch.testing.assert_close(codes[0], codes[1], rtol=1e-3, atol=1e-4)
    other = encoder(pictures.roll(1, dims=0), boxes)
    assert not torch.allclose(other[0], codes[0], atol=0.05)


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (9, 33)])
@pytest.mark.parametrize("crop", [1, 5, 8])
def test_pictures_and_crops_of_any_size_have_codes(size: tuple[int, int], crop: int) -> None:
    encoder = encoder_of(1, (4, 4, 4), crop)
    whole = torch.tensor([[[-0.5, -0.5, size[1] - 0.5, size[0] - 0.5]]])
    codes = encoder(drawn(1, 3, *size), whole)
    assert codes.shape == (1, 1, 5)
    assert torch.isfinite(codes).all()


def test_it_learns_the_colours_of_small_objects() -> None:
    torch.manual_seed(0)
    encoder = StyleEncoder(StyleOptions(widths=(6, 8), crop=4), 2, 3)
    optimiser = torch.optim.Adam(encoder.parameters(), 3e-3)
    corners = torch.tensor([[6.0, 8.0], [30.0, 20.0]])
    boxes = torch.cat([corners, corners + torch.tensor([5.0, 12.0])], dim=1).expand(4, 2, 4)

    def error(seed: int) -> torch.Tensor:
        pictures, shirts = 0.5 + 0.1 * drawn(4, 3, 40, 48, seed=seed), drawn(4, 2, 3, seed=seed + 1000)
        pictures[:, :, 8:21, 6:12] = shirts[:, 0, :, None, None]
        pictures[:, :, 20:33, 30:36] = shirts[:, 1, :, None, None]
        return (encoder(pictures, boxes) - shirts).square().mean()

    for step in range(60):
        optimiser.zero_grad()
        error(step).backward()
        optimiser.step()
    # A guess without a look is off by 1/12.
    assert error(900).item() < 0.25 / 12


def test_widths_of_no_stem_are_refused() -> None:
    for widths in ((), (1, 2, 3, 4, 5)):
        with pytest.raises(ValueError, match="widths: expected one to four"):
            ResidualStem(widths)


def test_a_crop_of_the_picture_itself_is_the_mean_of_its_pixels() -> None:
    picture = drawn(1, 3, 12, 16)
    box = torch.tensor([[[3.5, 1.5, 11.5, 9.5]]])  # pixels 4 to 11 and 2 to 9, two of them a pixel of the crop
    found = cropped([picture], box, (12, 16), 4, finest=0)[0, 0]
    expected = functional.avg_pool2d(picture[:, :, 2:10, 4:12], 2)[0]
    # Each pixel is the mean of 4 x 4 places, between whose pixels' middles colours change evenly.
    torch.testing.assert_close(found[:3], expected, atol=0.1, rtol=0)
    even = picture.new_tensor([0.2, 0.5, 0.7])[None, :, None, None].expand_as(picture)
    torch.testing.assert_close(cropped([even], box, (12, 16), 4, finest=0)[0, 0, :3], even[0, :, :4, :4])


@pytest.mark.parametrize(("widths", "crop"), [((4,), 3), ((4, 6), 4), ((4, 6, 8), 5)])
def test_own_encoders_see_nothing_but_their_object_and_share_nothing(widths: tuple[int, ...], crop: int) -> None:
    torch.manual_seed(0)
    encoder = OwnStyleEncoders(StyleOptions(widths=widths, crop=crop), 3, 5)
    torch.nn.init.normal_(encoder.unseen)
    boxes = torch.tensor([[[2.0, 2.0, 12.0, 20.0], [2.0, 2.0, 12.0, 20.0], [NAN] * 4]])
    picture = drawn(1, 3, 24, 40)
    codes = encoder(picture, boxes)
    assert codes.shape == (1, 3, 5)
    assert torch.equal(codes[0, 2], encoder.unseen[2])
    assert not torch.allclose(codes[0, 0], codes[0, 1])  # of the same crop
    beside = picture.clone()
    beside[..., 20:] = 0.0
    torch.testing.assert_close(encoder(beside, boxes), codes)
    inside = picture.clone()
    inside[..., 8:12, 6:9] = 0.0
    assert not torch.allclose(encoder(inside, boxes)[0, 0], codes[0, 0])
    own = {name for name, _ in encoder.named_parameters() if name.split(".")[1:2] == ["0"]}
    codes[0, 0].sum().backward()
    reached = {n for n, p in encoder.named_parameters() if p.grad is not None and p.grad.abs().sum() > 0}
    assert reached <= own and len(reached) >= 4
