"""A discriminator of whole sequences, and the loss by which it and a generator learn against each other in one step."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.func import functional_call
from torch.nn.utils.parametrizations import spectral_norm

from pgm_models.animation.network import NetworkShape
from pgm_models.animation.presets import NetworkOptions

KERNEL = 3
"""Frames that a convolution sees."""
SLOPE = 0.2
"""Of the leaky rectifiers below 0."""


class SequenceDiscriminator(nn.Module):
    """Tells sequences of data from made ones: convolutions over time on states and texts.

    Its weights are kept at a spectral norm of 1, so that it cannot run away from the generator.

    Source: Menapace et al., "Playable Environments", CVPR 2022, the temporal discriminator of its animation module;
    Miyato et al., "Spectral Normalization for Generative Adversarial Networks", ICLR 2018.
    """

    def __init__(self, shape: NetworkShape, options: NetworkOptions) -> None:
        super().__init__()
        told = sum(shape.widths) + len(shape.widths) + shape.actions * shape.text_width
        self.enter = spectral_norm(nn.Conv1d(told, options.width, 1))
        self.layers = nn.ModuleList(
            spectral_norm(nn.Conv1d(options.width, options.width, KERNEL, padding=KERNEL // 2))
            for _ in range(options.layers)
        )
        self.leave = spectral_norm(nn.Conv1d(options.width, 1, 1))
        firsts = torch.tensor([sum(shape.widths[:row]) for row in range(len(shape.widths))], dtype=torch.long)
        self.register_buffer("first_channels", firsts, persistent=False)

    def forward(
        self,
        state: Float[Tensor, "B T C"],
        text: Float[Tensor, "B T A W"],
        valid: Bool[Tensor, "B T C"],
    ) -> Float[Tensor, "B T"]:
        """How much each frame with those around it looks like data; any number.

        Args:
            state: Standardised.
            text: Features of each player's text, 0 where there is none.
            valid: What the data say; the rest is not looked at, in made sequences as in the data's.
        """
        told = [
            torch.where(valid, state, 0.0),
            valid[..., self.get_buffer("first_channels")].to(state.dtype),
            text.flatten(2).to(state.dtype),
        ]
        hidden = self.enter(torch.cat(told, dim=-1).transpose(1, 2))
        for layer in self.layers:
            hidden = hidden + layer(nn.functional.leaky_relu(hidden, SLOPE))
        return self.leave(nn.functional.leaky_relu(hidden, SLOPE))[:, 0]


def adversarial_loss(
    discriminator: nn.Module,
    real: Float[Tensor, "B T C"],
    fake: Float[Tensor, "B T C"],
    text: Float[Tensor, "B T A W"],
    valid: Bool[Tensor, "B T C"],
    *,
    scale: float = 1.0,
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """The loss of both, for one step of one optimiser, and its terms for the log.

    Of its gradients the discriminator gets those of the hinge loss alone, and `fake` those that make the
    discriminator's score of it rise: each is cut off from the other's loss. What a reversed gradient of the hinge loss
    would give `fake` is the same where the hinge is open, and nothing where the discriminator is sure; this is not.

    Args:
        discriminator: Judges both; a `SequenceDiscriminator`.
        real: States of the data.
        fake: States that the generator made, known values in their places.
        text: Features of each player's text; it gets no gradient.
        valid: What the data say.
        scale: Of the gradient that `fake` gets; the discriminator's is not scaled.

    Source: Lim and Ye, "Geometric GAN", 2017 (hinge loss).
    """
    text = text.detach()
    scores = discriminator(torch.cat([real, fake.detach()]), torch.cat([text, text]), torch.cat([valid, valid]))
    score_real, score_fake = scores.float().chunk(2)
    judging = nn.functional.relu(1 - score_real).mean() + nn.functional.relu(1 + score_fake).mean()
    still = {name: value.detach() for name, value in discriminator.named_parameters()}
    fooling = -functional_call(discriminator, still, (fake, text, valid)).float().mean()
    terms = {
        "adversary_hinge": judging.detach(),
        "adversary_real": score_real.mean().detach(),
        "adversary_fake": score_fake.mean().detach(),
    }
    return judging + scale * fooling, terms
