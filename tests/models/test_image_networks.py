"""Weights from files, LPIPS, and the networks of FID and FVD, all with random weights of the right shape."""

import pickle
from types import MappingProxyType

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from safetensors.torch import save_file

from pgm_models import image_inception, image_networks
from pgm_models.image_inception import (
    FidNetwork,
    FvdNetwork,
    Mixed,
    Unit3d,
    conv,
    load_fid,
    load_fvd,
    same_padded,
    words_of,
)
from pgm_models.image_networks import (
    Lpips,
    MetricUnavailable,
    PictureFeatures,
    Trunk,
    fill,
    load_lpips,
    read_weights,
    shown,
    trunk_of,
)


def pictures(batch: int, height: int = 64, width: int = 72, seed: int = 0) -> torch.Tensor:
    """Random ones."""
    return torch.rand(batch, 3, height, width, generator=torch.Generator().manual_seed(seed))


@pytest.fixture(scope="module")
def lpips_files(tmp_path_factory):
    """AlexNet and its heads with random weights, as the public files name them."""
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("lpips")
    trunk, heads = folder / "alexnet.pth", folder / "heads.safetensors"
    look = PictureFeatures("alexnet").state_dict()
    torch.save(look | {"classifier.1.weight": torch.zeros(2, 2)}, trunk)
    widths = (64, 192, 384, 256, 256)
    save_file({f"lin{k}.model.1.weight": torch.rand(1, width, 1, 1) for k, width in enumerate(widths)}, heads)
    return trunk, heads


def test_weights_are_read_from_both_kinds_of_files(tmp_path):
    tensors = {"a": torch.arange(3.0), "b": torch.ones(2, 2)}
    save_file(tensors, tmp_path / "x.safetensors")
    torch.save(tensors, tmp_path / "x.pth")
    torch.save({"state_dict": tensors, "epoch": 3}, tmp_path / "nested.pth")
    for name in ("x.safetensors", "x.pth", "nested.pth"):
        weights = read_weights(tmp_path / name)
        assert set(weights.tensors) == {"a", "b"}
        torch.testing.assert_close(weights.tensors["a"], tensors["a"])
        assert len(weights.sha256) == 64


class Loud:
    """What would be made by code if a pickle were let run."""

    def __reduce__(self):
        return (print, ("code of a weights file ran",))


def test_files_that_hold_anything_but_tensors_are_refused(tmp_path, capsys):
    (tmp_path / "code.pth").write_bytes(pickle.dumps(Loud(), protocol=2))
    torch.save({"w": Loud()}, tmp_path / "code2.pth")
    torch.save([1, 2], tmp_path / "list.pth")
    (tmp_path / "broken.safetensors").write_bytes(b"nothing")
    for name in ("code.pth", "code2.pth", "list.pth", "broken.safetensors"):
        with pytest.raises(ValueError, match=f"weights .*{name}: expected"):
            read_weights(tmp_path / name)
    assert "ran" not in capsys.readouterr().out
    with pytest.raises(FileNotFoundError, match="no file"):
        read_weights(tmp_path / "none.pth")


def test_a_network_takes_only_weights_of_its_own_shape(tmp_path):
    network = torch.nn.Linear(2, 3)
    save_file({"weight": torch.ones(3, 2).half(), "bias": torch.zeros(3), "other": torch.ones(1)}, tmp_path / "a.st")
    (tmp_path / "a.st").rename(tmp_path / "a.safetensors")
    fill(network, read_weights(tmp_path / "a.safetensors"))
    assert network.weight.dtype == torch.float32
    assert not network.training
    assert not network.weight.requires_grad
    save_file({"weight": torch.ones(3, 3), "bias": torch.zeros(3)}, tmp_path / "b.safetensors")
    with pytest.raises(ValueError, match=r"weight: expected \(3, 2\), got \(3, 3\)"):
        fill(network, read_weights(tmp_path / "b.safetensors"))
    save_file({"weight": torch.ones(3, 2)}, tmp_path / "c.safetensors")
    with pytest.raises(ValueError, match=r"bias: expected \(3,\), got none"):
        fill(network, read_weights(tmp_path / "c.safetensors"))


def test_a_file_says_whether_it_is_a_known_one(tmp_path, monkeypatch):
    save_file({"a": torch.zeros(1)}, tmp_path / "mine.safetensors")
    weights = read_weights(tmp_path / "mine.safetensors")
    assert weights.origin.startswith("mine.safetensors, not a public file known here")
    monkeypatch.setattr(image_networks, "KNOWN_FILES", MappingProxyType({weights.sha256[:8]: "a network"}))
    assert weights.origin == "a network"


def test_networks_are_told_apart_by_their_layers(tmp_path, lpips_files):
    assert trunk_of(read_weights(lpips_files[0])) == "alexnet"
    both: tuple[tuple[Trunk, int], ...] = (("vgg16", 30), ("vgg19", 36))
    for name, layers in both:
        with torch.device("meta"):
            state = PictureFeatures(name, range(layers)).state_dict()
        assert trunk_of(image_networks.Weights(path=tmp_path, sha256="0" * 64, tensors=state)) == name
    with pytest.raises(ValueError, match="expected AlexNet, VGG16 or VGG19"):
        trunk_of(read_weights(lpips_files[1]))


def test_lpips_is_a_weighted_distance_of_unit_features(lpips_files):
    network = load_lpips(*lpips_files)
    made, real = pictures(2), pictures(2, seed=1)
    given = read_weights(lpips_files[0]).tensors
    heads = read_weights(lpips_files[1]).tensors

    def layers(x: torch.Tensor) -> list[np.ndarray]:
        """AlexNet's five rectifiers; colours are shifted as the public implementation shifts them from -1 to 1."""
        x = 2 * x - 1 - torch.tensor([-0.030, -0.088, -0.188])[:, None, None]
        x = x / torch.tensor([0.458, 0.448, 0.450])[:, None, None]
        found = []
        for position, stride, padding, pool in ((0, 4, 2, 0), (3, 1, 2, 1), (6, 1, 1, 1), (8, 1, 1, 0), (10, 1, 1, 0)):
            x = F.max_pool2d(x, 3, 2) if pool else x
            weight, bias = given[f"features.{position}.weight"], given[f"features.{position}.bias"]
            x = F.conv2d(x, weight, bias, stride, padding).relu()
            found.append(x.numpy())
        return found

    wanted = np.zeros(2)
    for k, (a, b) in enumerate(zip(layers(made), layers(real), strict=True)):
        head = heads[f"lin{k}.model.1.weight"].numpy().ravel()
        for frame in range(2):
            per_pixel = []
            for row in range(a.shape[2]):
                for column in range(a.shape[3]):
                    u, v = a[frame, :, row, column], b[frame, :, row, column]
                    per_pixel.append((head * (u / np.linalg.norm(u) - v / np.linalg.norm(v)) ** 2).sum())
            wanted[frame] += np.mean(per_pixel)
    np.testing.assert_allclose(network(made, real).numpy(), wanted, rtol=1e-4)


def test_lpips_of_a_picture_with_itself_is_zero_and_it_is_symmetric(lpips_files):
    network = load_lpips(*lpips_files)
    made, real = pictures(3), pictures(3, seed=1)
    torch.testing.assert_close(network(real, real), torch.zeros(3))
    torch.testing.assert_close(network(made, real), network(real, made))
    assert (network(made, real) > 0).all()
    assert "not a public file known here" in network.origin


def test_lpips_refuses_colours_of_another_range():
    network = Lpips("alexnet")
    good = pictures(1)
    for wrong in (good * 2 - 1, good * 255, torch.full_like(good, torch.nan)):
        with pytest.raises(ValueError, match="LPIPS: made: expected colours from 0 to 1"):
            network(wrong, good)
    with pytest.raises(ValueError, match="LPIPS: real"):
        network(good, good * 2 - 1)


def test_lpips_refuses_heads_below_zero(lpips_files, tmp_path):
    heads = dict(read_weights(lpips_files[1]).tensors)
    heads["lin2.model.1.weight"] = -heads["lin2.model.1.weight"]
    save_file(heads, tmp_path / "negative.safetensors")
    with pytest.raises(ValueError, match=r"lin2.model.1.weight: expected none below 0"):
        load_lpips(lpips_files[0], tmp_path / "negative.safetensors")


def test_metrics_without_weights_are_not_available(lpips_files):
    for load in (lambda: load_lpips(None, None), lambda: load_lpips(lpips_files[0], None), lambda: load_fid(None)):
        with pytest.raises(MetricUnavailable, match="weights not given"):
            load()
    with pytest.raises(MetricUnavailable) as caught:
        load_fvd(None)
    assert shown(caught.value) == "n/a (FVD: weights not given)"
    assert shown(0.15234) == "0.152"


def test_fids_network_is_inception_v3_by_its_public_names():
    with torch.device("meta"):
        network = FidNetwork()
    # As many as the usual Inception v3 has without its classifier and its auxiliary one.
    assert sum(parameter.numel() for parameter in network.parameters()) == 21_785_568
    state = network.state_dict()
    for name, shape in {
        "Conv2d_1a_3x3.conv.weight": (32, 3, 3, 3),
        "Mixed_5b.branch5x5_2.conv.weight": (64, 48, 5, 5),
        "Mixed_6a.branch3x3dbl_3.bn.running_var": (96,),
        "Mixed_6c.branch7x7dbl_4.conv.weight": (160, 160, 7, 1),
        "Mixed_7a.branch7x7x3_4.conv.weight": (192, 192, 3, 3),
        "Mixed_7c.branch3x3_2b.conv.weight": (384, 384, 3, 1),
        "Mixed_7b.branch_pool.bn.bias": (192,),
    }.items():
        assert tuple(state[name].shape) == shape


def test_fids_words_are_those_of_the_network_in_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(image_inception, "FID_SIDE", 75)
    torch.manual_seed(1)
    network = FidNetwork().eval()
    state = {name: value for name, value in network.state_dict().items() if "num_batches" not in name}
    save_file(state | {"fc.weight": torch.zeros(1008, 4)}, tmp_path / "inception.safetensors")
    loaded = load_fid(tmp_path / "inception.safetensors")
    batches = [pictures(2, 30, 40), pictures(1, 30, 40, seed=1)]
    rows = words_of(loaded, batches)
    assert rows.shape == (3, 2048)
    with torch.inference_mode():
        np.testing.assert_allclose(rows[:2], network(batches[0]).numpy(), rtol=1e-5, atol=1e-6)
    assert np.ptp(rows, axis=0).max() > 0
    with pytest.raises(ValueError, match="FID: pictures: expected colours from 0 to 1"):
        loaded(pictures(1) * 255)
    with pytest.raises(ValueError, match="expected at least one"):
        words_of(loaded, [])


def test_fids_mean_pooling_counts_only_pixels_that_are_there():
    block = Mixed(2, [[conv("branch1x1", 3)]], "mean", 2).eval()
    with torch.no_grad():
        block.branch_pool.conv.weight.copy_(torch.eye(2)[:, :, None, None])
        flat = block(torch.full((1, 2, 5, 6), 0.7))[:, 3:]
    torch.testing.assert_close(flat, torch.full_like(flat, flat[0, 0, 2, 2].item()))


def test_fvds_network_is_i3d_by_its_public_names():
    with torch.device("meta"):
        network = FvdNetwork()
    assert sum(parameter.numel() for parameter in network.parameters()) == 12_697_264
    state = network.state_dict()
    for name, shape in {
        "Conv3d_1a_7x7.conv3d.weight": (64, 3, 7, 7, 7),
        "Mixed_4d.b2b.conv3d.weight": (64, 24, 3, 3, 3),
        "Mixed_5c.b3b.bn.running_mean": (128,),
        "logits.conv3d.bias": (400,),
    }.items():
        assert tuple(state[name].shape) == shape


def test_fvds_words_are_one_row_a_clip_and_clips_must_be_long_enough():
    torch.manual_seed(2)
    network = FvdNetwork().eval()
    clip = pictures(9, 16, 20)[None]
    assert words_of(network, [clip]).shape == (1, 400)
    with pytest.raises(ValueError, match="expected at least 9 frames, got 8"):
        network(clip[:, :8])
    with pytest.raises(ValueError, match="FVD: clips: expected colours"):
        network(clip * 2 - 1)


@pytest.mark.parametrize("size", [1, 2, 5, 8, 9])
@pytest.mark.parametrize(("side", "stride"), [(1, 1), (2, 2), (3, 1), (3, 2), (7, 2)])
def test_same_padding_gives_as_many_results_as_strides_fit(size, side, stride):
    padded = same_padded(torch.ones(1, 1, size, size, size), (side,) * 3, (stride,) * 3)
    results = (padded.shape[-1] - side) // stride + 1
    assert results == -(-size // stride)
    lacking = padded.shape[-1] - size
    # TensorFlow puts the odd zero last.
    assert padded[0, 0].nonzero().min().item() == lacking // 2
    assert padded.sum().item() == size**3


def test_a_unit_keeps_the_size_and_ends_in_a_rectifier():
    torch.manual_seed(0)
    unit = Unit3d(2, 4, 3, 2).eval()
    out = unit(torch.randn(1, 2, 5, 7, 8))
    assert out.shape == (1, 4, 3, 4, 4)
    assert (out >= 0).all()
    assert (Unit3d(2, 4, 1, normed=False)(torch.randn(1, 2, 3, 3, 3)) < 0).any()
