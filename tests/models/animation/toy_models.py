"""Small untrained models of small layouts, and windows for them."""

import numpy as np
import torch

from pgm_models.animation.layout import Constant, Layout, Property
from pgm_models.animation.model import AnimationModel, ModelOptions
from pgm_models.animation.presets import DESIGNS, PRESETS
from pgm_models.animation.prior import SCALES_S, TemporalPrior, derivatives
from pgm_models.animation.windows import Windows


def toy_property(column: str, player: int, width: int) -> Property:
    return Property(
        column=column,
        player=player,
        kind="vector",
        first=0,
        width=width,
        reference=np.zeros((0, 3)),
        channels=np.arange(width),
        rest=np.zeros(width),
        mean=np.zeros(width),
        std=np.ones(width),
    )


def toy_layout(players: int = 2, ball: bool = True) -> Layout:
    names = tuple(f"player{k}" for k in range(players))
    properties = [toy_property(f"{name}.root_position", k, 3) for k, name in enumerate(names)]
    if ball:
        properties += [toy_property("ball.position", -1, 3), toy_property("ball.velocity", -1, 3)]
    bones = [
        Constant(
            column=f"{name}.joint_translations",
            player=k,
            first=3,
            width=4,
            channels=np.arange(4),
            rest=np.zeros(4),
            mean=np.zeros(4),
            std=np.ones(4),
        )
        for k, name in enumerate(names)
    ]
    return Layout(scene="tennis", players=names, properties=tuple(properties), constants=tuple(bones))


def toy_prior(layout: Layout) -> TemporalPrior:
    """Of one second's memory."""
    none = np.zeros((layout.channels, len(SCALES_S)))
    smooth = none.copy()
    smooth[:, SCALES_S.index(1.0)] = 0.9
    position, velocity, ratio = derivatives(layout)
    return TemporalPrior(
        smooth=smooth,
        rough=none,
        white=np.full(layout.channels, 0.1),
        position=position,
        velocity=velocity,
        ratio=ratio,
    )


def toy_model(layout: Layout | None = None, design: str = "ours", frames: int = 8) -> AnimationModel:
    nano = PRESETS["nano"]
    layout = layout or toy_layout()
    torch.manual_seed(0)
    options = ModelOptions(
        layout=layout,
        network=nano.network,
        text=nano.text,
        design=DESIGNS[design],
        encoder="hash",
        encoder_width=64,
        frames=frames,
        prior=toy_prior(layout) if DESIGNS[design].prior else None,
        rates=(4.0, 25.0),
    )
    return AnimationModel(options).eval().requires_grad_(False)


def toy_windows(layout: Layout, count: int = 3, frames: int = 8, texts: int = 2) -> Windows:
    generator = torch.Generator().manual_seed(1)
    shape = (count, frames)
    return Windows(
        state=torch.randn(*shape, layout.channels, generator=generator),
        valid=torch.ones(*shape, len(layout.properties), dtype=torch.bool),
        rate=torch.full((count,), 5.0),
        constants=torch.randn(count, layout.constant_channels, generator=generator),
        text=torch.randint(-1, texts, (*shape, len(layout.players)), generator=generator),
        tokens=torch.randn(texts, 5, 64, generator=generator),
        token_mask=torch.ones(texts, 5, dtype=torch.bool),
        names=tuple(f"window{k}" for k in range(count)),
    )
