"""Recurrent networks in the place of the transformer: the baselines that the paper compares with.

Both are called like the transformer and have about as many parameters as it has with the same options. They are told
values, not asked to take noise away: what is unknown of `x` counts as 0, and `log_snr` for nothing.
"""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pgm_models.animation.network import Denoiser, NetworkShape
from pgm_models.animation.presets import NetworkOptions

RATE_FEATURES = 8
"""Numbers that stand for the framerate."""


class SequenceLstm(nn.Module):
    """One LSTM over all objects that reads the window in both directions and tells its unknown values at once.

    Source: the paper, "Animation Model", the reconstruction variant with an LSTM; under the model's masks values may
    be known later than those asked for, which is why it reads backwards too.
    """

    def __init__(self, shape: NetworkShape, options: NetworkOptions) -> None:
        super().__init__()
        self.shape = shape
        with torch.device("meta"):
            self.hidden = matched_width(
                lambda width: parameter_count(_SequenceLayers(shape, options, width)),
                transformer_parameters(shape, options),
            )
        self.layers = _SequenceLayers(shape, options, self.hidden)
        columns = torch.repeat_interleave(torch.arange(len(shape.widths)), torch.tensor(shape.widths, dtype=torch.long))
        self.register_buffer("property_of_channel", columns, persistent=False)

    def forward(
        self,
        x: Float[Tensor, "B T C"],
        known: Bool[Tensor, "B T P"],
        text: Float[Tensor, "B T A W"],
        text_known: Bool[Tensor, "B T A"],
        rate: Float[Tensor, " B"],
        log_snr: Float[Tensor, " B"],
        constants: Float[Tensor, "B K"],
    ) -> Float[Tensor, "B T C"]:
        """Told values of all entries, standardised.

        Args:
            x: The known values; others are not looked at.
            known: Which are given.
            text: Features of each player's text.
            text_known: Which texts are given; others are not looked at.
            rate: Frames a second.
            log_snr: Not looked at.
            constants: Bones.
        """
        del log_snr
        frames = x.shape[1]
        parts = [
            torch.where(known[..., self.get_buffer("property_of_channel")], x, 0.0),
            known,
            torch.where(text_known[..., None], text, 0.0).flatten(2),
            text_known,
            rate_features(rate)[:, None].expand(-1, frames, -1),
            constants[:, None].expand(-1, frames, -1),
        ]
        kind = self.layers.leave.weight.dtype
        return self.layers(torch.cat([part.to(kind) for part in parts], dim=-1)).to(x.dtype)


class ObjectLstms(nn.Module):
    """An LSTM for each object, which goes from frame to frame on what it told itself.

    Each sees what is known of its own properties, its own player's text, and all objects' states of the frame before:
    known values where there are some, its own elsewhere. It tells how its state changes. Nothing that is known later
    reaches a frame.

    Source: Menapace et al., "Playable Environments", CVPR 2022, the animation module, with the text of its player in
    the place of a discrete action, as the paper compares with it.
    """

    def __init__(self, shape: NetworkShape, options: NetworkOptions, objects: Sequence[int]) -> None:
        """Make the networks.

        Args:
            shape: What they are for.
            options: Of the transformer whose number of parameters they are to have.
            objects: Of each property, the player whose it is, or another number (-1: the ball) where it is nobody's.

        Raises:
            ValueError: If there is not one object a property.
        """
        super().__init__()
        if len(objects) != len(shape.widths):
            raise ValueError(f"objects: expected one for each of {len(shape.widths)} properties, got {len(objects)}")
        self.shape = shape
        self.objects = tuple(dict.fromkeys(objects))
        with torch.device("meta"):
            self.hidden = matched_width(
                lambda width: parameter_count(_object_layers(shape, options, objects, width)),
                transformer_parameters(shape, options),
            )
        self.layers = _object_layers(shape, options, objects, self.hidden)
        self.first = nn.Parameter(torch.zeros(sum(shape.widths)))
        """The state before the first frame."""
        columns = torch.repeat_interleave(torch.arange(len(shape.widths)), torch.tensor(shape.widths, dtype=torch.long))
        self.register_buffer("property_of_channel", columns, persistent=False)
        rows = [torch.tensor([row for row, own in enumerate(objects) if own == one]) for one in self.objects]
        for place, own in enumerate(rows):
            self.register_buffer(f"rows_{place}", own, persistent=False)
            self.register_buffer(f"channels_{place}", torch.isin(columns, own).nonzero()[:, 0], persistent=False)
        order = torch.cat([self.get_buffer(f"channels_{place}") for place in range(len(rows))])
        self.register_buffer("place_of_channel", torch.argsort(order), persistent=False)

    def forward(
        self,
        x: Float[Tensor, "B T C"],
        known: Bool[Tensor, "B T P"],
        text: Float[Tensor, "B T A W"],
        text_known: Bool[Tensor, "B T A"],
        rate: Float[Tensor, " B"],
        log_snr: Float[Tensor, " B"],
        constants: Float[Tensor, "B K"],
    ) -> Float[Tensor, "B T C"]:
        """Told values of all entries, standardised; arguments as of `SequenceLstm`."""
        del log_snr
        batch, frames, _ = x.shape
        kind = self.first.dtype
        known_channels = known[..., self.get_buffer("property_of_channel")]
        given = torch.where(known_channels, x, 0.0).to(kind)
        words = torch.where(text_known[..., None], text, 0.0)
        networks = [layers for layers in self.layers if isinstance(layers, _ObjectLayers)]
        told = []
        for place, one in enumerate(self.objects):
            parts = [
                given[..., self.get_buffer(f"channels_{place}")],
                known[..., self.get_buffer(f"rows_{place}")],
                rate_features(rate)[:, None].expand(-1, frames, -1),
                constants[:, None].expand(-1, frames, -1),
            ]
            if 0 <= one < self.shape.actions:
                parts += [words[:, :, one], text_known[:, :, one, None]]
            told.append(networks[place].told(torch.cat([part.to(kind) for part in parts], dim=-1)))
        state = self.first.expand(batch, -1)
        memories = [network.nothing(given) for network in networks]
        values = []
        # Frame after frame, because each starts from what was told of the one before.
        for frame in range(frames):
            changes = []
            for place, network in enumerate(networks):
                change, memories[place] = network(told[place][:, frame], state, memories[place])
                changes.append(change)
            value = state + torch.cat(changes, dim=-1)[:, self.get_buffer("place_of_channel")]
            values.append(value)
            state = torch.where(known_channels[:, frame], given[:, frame], value)
        return torch.stack(values, dim=1).to(x.dtype)


class _SequenceLayers(nn.Module):
    """Projection, bidirectional LSTM, projection."""

    def __init__(self, shape: NetworkShape, options: NetworkOptions, hidden: int) -> None:
        super().__init__()
        channels = sum(shape.widths)
        told = channels + len(shape.widths) + shape.actions * (shape.text_width + 1) + RATE_FEATURES + shape.constants
        depth = recurrent_depth(options)
        self.enter = nn.Linear(told, hidden)
        self.lstm = nn.LSTM(
            hidden,
            hidden,
            depth,
            batch_first=True,
            bidirectional=True,
            dropout=options.dropout if depth > 1 else 0.0,
        )
        self.leave = nn.Linear(2 * hidden, channels)

    def forward(self, told: Float[Tensor, "B T I"]) -> Float[Tensor, "B T C"]:
        entered = nn.functional.silu(self.enter(told))
        # Mixed precision knows no LSTM on every device; it is computed in the precision of its weights.
        with torch.autocast(told.device.type, enabled=False):
            read, _ = self.lstm(entered.to(self.leave.weight.dtype))
        return self.leave(read)


class _ObjectLayers(nn.Module):
    """What is told of a frame and the state before it, through LSTM cells, to the change of one object's state."""

    def __init__(self, sizes: tuple[int, int, int], hidden: int, depth: int, dropout: float) -> None:
        super().__init__()
        told, state, own = sizes
        self.enter = nn.Linear(told, hidden)
        self.before = nn.Linear(state, hidden, bias=False)
        self.cells = nn.ModuleList(nn.LSTMCell(hidden, hidden) for _ in range(depth))
        self.dropout = nn.Dropout(dropout)
        self.leave = nn.Linear(hidden, own)

    def told(self, own: Float[Tensor, "B T I"]) -> Float[Tensor, "B T H"]:
        """What is given to each frame, of all frames at once."""
        return self.enter(own)

    def nothing(self, x: Float[Tensor, "B T C"]) -> list[tuple[Tensor, Tensor]]:
        """The cells' memory before the first frame."""
        zeros = x.new_zeros(len(x), self.leave.in_features)
        return [(zeros, zeros) for _ in self.cells]

    def forward(
        self,
        told: Float[Tensor, "B H"],
        state: Float[Tensor, "B C"],
        memory: list[tuple[Tensor, Tensor]],
    ) -> tuple[Float[Tensor, "B O"], list[tuple[Tensor, Tensor]]]:
        hidden = nn.functional.silu(told + self.before(state))
        kept = []
        for layer, (cell, (short, long)) in enumerate(zip(self.cells, memory, strict=True)):
            if layer:
                hidden = self.dropout(hidden)
            with torch.autocast(told.device.type, enabled=False):
                kind = self.leave.weight.dtype
                short, long = cell(hidden.to(kind), (short.to(kind), long.to(kind)))
            kept.append((short, long))
            hidden = short
        return self.leave(hidden), kept


def rate_features(rate: Float[Tensor, " B"]) -> Float[Tensor, "B F"]:
    """Sines and cosines of the framerate's logarithm: equal ratios of rates are equal steps."""
    turns = torch.tensor([0.25, 0.5, 1.0, 2.0], device=rate.device, dtype=rate.dtype) * torch.log(rate)[:, None]
    return torch.cat([torch.sin(turns), torch.cos(turns)], dim=-1)


def recurrent_depth(options: NetworkOptions) -> int:
    """LSTM layers in the place of so many layers of attention: half, as a layer of LSTM also goes along time."""
    return max(1, options.layers // 2)


def parameter_count(network: nn.Module) -> int:
    """Numbers that are trained."""
    return sum(parameter.numel() for parameter in network.parameters())


def transformer_parameters(shape: NetworkShape, options: NetworkOptions) -> int:
    """Numbers that are trained in the transformer of those options."""
    # It is made and dropped; what is drawn for it must not change what is drawn next.
    with torch.random.fork_rng(devices=[]), torch.device("cpu"):
        return parameter_count(Denoiser(shape, options))


def matched_width(count: Callable[[int], int], wanted: int, step: int = 8) -> int:
    """The width, a multiple of `step`, whose network comes nearest to that many parameters.

    Args:
        count: Parameters at a width; it must grow with it.
        wanted: Parameters to come near to.
        step: What widths are multiples of.
    """
    low, high = 1, 2
    while count(step * high) < wanted:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if count(step * middle) < wanted else (low, middle)
    nearest = min((low, high), key=lambda width: abs(count(step * width) - wanted))
    return step * nearest


def _object_layers(shape: NetworkShape, options: NetworkOptions, objects: Sequence[int], hidden: int) -> nn.ModuleList:
    """The networks of all objects, in the order in which they first own a property."""
    layers = nn.ModuleList()
    for one in dict.fromkeys(objects):
        own = [width for width, owner in zip(shape.widths, objects, strict=True) if owner == one]
        told = sum(own) + len(own) + RATE_FEATURES + shape.constants
        if 0 <= one < shape.actions:
            told += shape.text_width + 1
        sizes = (told, sum(shape.widths), sum(own))
        layers.append(_ObjectLayers(sizes, hidden, recurrent_depth(options), options.dropout))
    return layers
