"""Filling in windows with a trained model: what everything that generates or scores goes through."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pgm_data.scene import Scene, load_scene
from pgm_models.animation import samplers
from pgm_models.animation.model import AnimationModel
from pgm_models.animation.noise import sampling_grid
from pgm_models.animation.plausible import best_of
from pgm_models.animation.windows import Fill, Windows

SamplerName = Literal["ddpm", "ddim", "dpmpp_2m", "sde_2m"]


@dataclass(frozen=True, kw_only=True)
class SampleOptions:
    """How noise is turned into states."""

    sampler: SamplerName = "sde_2m"
    """DDPM's and DDIM's, DPM-Solver++ (2M), and its stochastic form."""
    steps: int = 16
    """Evaluations of the network."""
    guidance: float = 1.0
    """How far to go beyond what the text says, 1 for not; others take two evaluations a step."""
    temperature: float = 1.0
    """Scale of the noise."""
    tries: int = 1
    """Samples of a window, of which the one with the most plausible ball is kept (see `plausible`)."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("steps", "tries"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected 1 or more, got {getattr(self, name)}")
        if not self.temperature >= 0:
            raise ValueError(f"temperature: expected 0 or more, got {self.temperature}")


@torch.no_grad()
def sample(
    model: AnimationModel,
    windows: Windows,
    known: Bool[Tensor, "B T P"],
    text_known: Bool[Tensor, "B T A"],
    *,
    options: SampleOptions,
    generator: torch.Generator,
) -> Float[Tensor, "B T C"]:
    """States in which known values are exactly the windows' own, and the others are the model's.

    A model that was trained to reconstruct is asked once; sampler, steps and noise do not matter to it.
    """
    known = known & windows.valid
    given = model.over_channels(known)
    embedded = model.embedded(windows)

    last: Tensor | None = None

    def clean(x: Tensor, log_snr: Tensor, text: Tensor) -> Tensor:
        levels = log_snr.expand(len(x)).to(x.dtype)
        held = torch.where(given, windows.state, x)
        return model.clean(model(held, known, text, windows, levels, embedded, last), held, levels)

    design = model.options.design
    if design.objective == "reconstruction":
        x0 = clean(torch.zeros_like(windows.state), torch.zeros((), device=known.device), text_known)
        return torch.where(given, windows.state, x0)

    def denoise(x: Tensor, log_snr: Tensor) -> Tensor:
        nonlocal last
        said = clean(x, log_snr, text_known)
        if options.guidance != 1.0:
            # Clean states are linear in what the network says, so guiding them is guiding it.
            unsaid = clean(x, log_snr, torch.zeros_like(text_known))
            said = unsaid + options.guidance * (said - unsaid)
        last = said
        return said

    noise = samplers.normal_like(windows.state, generator)
    spacing = "time" if options.sampler in ("ddpm", "ddim") else "lambda"
    grid = sampling_grid(design.diffusion, options.steps, spacing=spacing)
    run = {
        "ddpm": samplers.ddpm,
        "ddim": samplers.ddim,
        "dpmpp_2m": samplers.dpmpp_2m,
        "sde_2m": samplers.sde_2m,
    }[options.sampler]
    x0 = run(denoise, noise(), grid, noise, temperature=options.temperature)
    return torch.where(given, windows.state, x0.to(windows.state.dtype))


def filler(model: AnimationModel, options: SampleOptions, scene: Scene | None = None) -> Fill:
    """The model as something that fills in windows.

    Args:
        model: Of any design.
        options: How.
        scene: What the model is of, where its scene does not ship with the package.

    Raises:
        ValueError: If several tries are asked for where nothing tells which is best.
    """

    def fill(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
        return sample(model, windows, known, text_known, options=options, generator=generator)

    if options.tries == 1:
        return fill
    return best_of(fill, options.tries, model.layout, load_scene(model.layout.scene) if scene is None else scene)
