from pathlib import Path

import numpy as np
import pytest
import torch

from pgm_models.animation.network import Denoiser, NetworkShape
from pgm_models.animation.presets import NetworkOptions
from pgm_models.animation.step_export import (
    example_inputs,
    export_step,
    quantise_step,
    relative_error,
    used_inputs,
)
from pgm_models.animation.step_onnx import STEP_INPUTS, OnnxStep

SHAPE = NetworkShape(widths=(3, 5), actions=2, constants=4, text_width=6)
METADATA = {"layout": {"scene": "tennis", "channels": 8}, "frames": 16}


@pytest.fixture(scope="module")
def denoiser() -> Denoiser:
    torch.manual_seed(0)
    network = Denoiser(SHAPE, NetworkOptions(width=32, layers=1, heads=2, reach=3))
    generator = torch.Generator().manual_seed(0)
    for parameter in network.parameters():
        parameter.data += 0.2 * torch.randn(parameter.shape, generator=generator)
    return network


@pytest.fixture(scope="module")
def exported(denoiser: Denoiser, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("step") / "step.onnx"
    export_step(denoiser, path, metadata=METADATA)
    return path


@pytest.mark.parametrize("size", [(1, 1), (1, 16), (3, 5), (2, 40)])
def test_the_exported_step_says_what_the_network_says(
    denoiser: Denoiser, exported: Path, size: tuple[int, int]
) -> None:
    inputs = example_inputs(SHAPE, *size, seed=1)
    with torch.no_grad():
        wanted = denoiser.eval()(*inputs)
    step = OnnxStep(exported, threads=1)
    found = step(*inputs)
    assert found.shape == wanted.shape and found.dtype == torch.float32
    assert float(wanted.abs().max()) > 0.1
    assert float((found - wanted).abs().max()) < 1e-5
    arrays = step(*(value.numpy() for value in inputs))
    assert isinstance(arrays, np.ndarray) and np.array_equal(arrays, found.numpy())
    halves = step(*(value.half() if value.is_floating_point() else value for value in inputs))
    assert halves.dtype == torch.float16
    assert relative_error(step, denoiser, inputs) < 1e-5


def test_the_file_keeps_its_metadata_and_no_path(exported: Path) -> None:
    assert OnnxStep(exported, threads=1).metadata == METADATA
    assert b"site-packages" not in exported.read_bytes() and b".py" not in exported.read_bytes()


def test_int8_weights_are_smaller_and_near(denoiser: Denoiser, exported: Path) -> None:
    path = exported.with_name("int8.onnx")
    quantise_step(exported, path)
    step = OnnxStep(path, threads=1)
    assert {key: step.metadata[key] for key in METADATA} == METADATA
    assert 1e-4 < relative_error(step, denoiser, example_inputs(SHAPE, 3, 8)) < 0.05
    assert path.stat().st_size < exported.stat().st_size


def test_export_leaves_the_network_in_training_as_it_was(denoiser: Denoiser, exported: Path) -> None:
    denoiser.train()
    relative_error(OnnxStep(exported, threads=1), denoiser, example_inputs(SHAPE, 1, 2))
    assert denoiser.training


def test_inputs_of_no_width_are_left_out() -> None:
    assert used_inputs(SHAPE) == STEP_INPUTS
    bare = NetworkShape(widths=(2,), actions=0, constants=0, text_width=6)
    assert used_inputs(bare) == ("x", "known", "rate", "log_snr")


def test_another_network_is_refused(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    value = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Neg", ["picture"], ["heat"])],
        "other",
        [value("picture", onnx.TensorProto.FLOAT, [1])],
        [value("heat", onnx.TensorProto.FLOAT, [1])],
    )
    path = tmp_path / "other.onnx"
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=9)
    path.write_bytes(model.SerializeToString())
    with pytest.raises(ValueError, match="expected inputs among x, .* got picture and heat"):
        OnnxStep(path)
    path.write_bytes(b"no network")
    with pytest.raises(ValueError, match="animation step .*: expected an ONNX file"):
        OnnxStep(path)
