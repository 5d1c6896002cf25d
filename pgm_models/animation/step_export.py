"""The denoising network as one ONNX file, for onnxruntime; the sampler's loop and the texts' encoder stay outside."""

import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.attention import SDPBackend, sdpa_kernel

from pgm_data.dataset.files import whole_file
from pgm_models.animation.network import Denoiser, NetworkShape
from pgm_models.animation.step_onnx import STEP_INPUTS, OnnxStep
from pgm_models.detectors.export import strip_sources, write_model

StepInputs = tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]
"""Arguments of `Denoiser.forward`, in its order."""


class _UsedInputs(nn.Module):
    """The network as a function of those of its inputs that it has, as a graph holds no input of no width."""

    def __init__(self, denoiser: Denoiser, used: tuple[str, ...]) -> None:
        super().__init__()
        self.denoiser, self.used = denoiser, used

    def forward(self, *given: Tensor) -> Tensor:
        values = dict(zip(self.used, given, strict=True))
        x, rate = values["x"], values["rate"]
        values.setdefault("text", x.new_zeros(x.shape[0], x.shape[1], 0, self.denoiser.shape.text_width))
        values.setdefault("text_known", x.new_zeros(x.shape[0], x.shape[1], 0, dtype=torch.bool))
        values.setdefault("constants", rate.new_zeros(x.shape[0], 0))
        return self.denoiser(**values)


def export_step(denoiser: Denoiser, path: Path, *, metadata: Mapping[str, object]) -> None:
    """Write the network as one ONNX file with `metadata`, JSON values, in it; batch and frames may be of any size.

    Inputs and output are those of `Denoiser.forward` by name, without those of width 0; the output is `prediction`.

    Raises:
        RuntimeError: If the network cannot be exported.
    """
    used = used_inputs(denoiser.shape)
    examples = dict(zip(STEP_INPUTS, example_inputs(denoiser.shape, 2, 3), strict=True))
    batch, frames = torch.export.Dim("B"), torch.export.Dim("T")
    axes = {name: {0: batch, 1: frames} if examples[name].ndim > 2 else {0: batch} for name in used}
    training = denoiser.training
    with warnings.catch_warnings(), sdpa_kernel(SDPBackend.MATH), torch.no_grad():
        warnings.simplefilter("ignore")  # the exporter warns of its own internals
        program = torch.onnx.export(
            _UsedInputs(denoiser.eval(), used),
            tuple(examples[name] for name in used),
            dynamo=True,
            dynamic_shapes=(tuple(axes[name] for name in used),),
            input_names=list(used),
            output_names=["prediction"],
            verbose=False,
        )
    denoiser.train(training)
    if program is None:
        raise RuntimeError(f"{path}: expected an ONNX program from torch.onnx.export, got none")
    model = program.model_proto
    strip_sources(model)
    write_model(model, path, metadata)


def quantise_step(path: Path, out: Path) -> None:
    """Write the network of one ONNX file with the weights of its blocks as int8; activations are quantised as it runs.

    What it costs in quality must be judged on what is generated: see `relative_error` for one step.
    """
    import onnx
    from onnxruntime.quantization import QuantType, quantize_dynamic
    from onnxruntime.quantization.shape_inference import quant_pre_process

    with tempfile.TemporaryDirectory() as folder:
        folded, quantised = Path(folder) / "folded.onnx", Path(folder) / "int8.onnx"
        quant_pre_process(path, folded, skip_symbolic_shape=True)  # transposed weights become plain ones
        # Of 7 bits: processors without VNNI add pairs of products in 16 bits, which larger ones overflow.
        quantize_dynamic(
            folded,
            quantised,
            op_types_to_quantize=["MatMul"],
            per_channel=True,
            reduce_range=True,
            weight_type=QuantType.QInt8,
        )
        model = onnx.load(quantised)
    out.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(out) as temporary:
        temporary.write_bytes(model.SerializeToString())


def relative_error(step: OnnxStep, denoiser: Denoiser, inputs: StepInputs) -> float:
    """Root mean square of what the exported step says otherwise, over that of what the network says."""
    training = denoiser.training
    with torch.no_grad():
        wanted = denoiser.eval()(*inputs)
    denoiser.train(training)
    return float((step(*inputs) - wanted).norm() / wanted.norm())


def used_inputs(shape: NetworkShape) -> tuple[str, ...]:
    """Names of the inputs that a network of that shape has, in the order of `Denoiser.forward`."""
    absent = () if shape.actions else ("text", "text_known")
    absent += () if shape.constants else ("constants",)
    return tuple(name for name in STEP_INPUTS if name not in absent)


def example_inputs(shape: NetworkShape, batch: int, frames: int, *, seed: int = 0) -> StepInputs:
    """Random arguments of `Denoiser.forward`: half of all is known, rates from 1 to 25, log-SNRs around 0."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*sizes: int) -> Tensor:
        return torch.randn(*sizes, generator=generator)

    def flags(*sizes: int) -> Tensor:
        return torch.rand(*sizes, generator=generator) < 0.5

    return (
        normal(batch, frames, sum(shape.widths)),
        flags(batch, frames, len(shape.widths)),
        normal(batch, frames, shape.actions, shape.text_width),
        flags(batch, frames, shape.actions),
        1 + 24 * torch.rand(batch, generator=generator),
        5 * normal(batch),
        normal(batch, shape.constants),
    )
