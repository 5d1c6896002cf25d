"""How the trained part of the text encoder begins: told what play its texts go with, before it meets the diffusion.

In the loss of diffusion words count for little: most masks leave the answer in the states around, and most noise
levels leave it in the noise. An aggregator that begins at random then learns left from right after tens of thousands of
steps only. So it first learns, by plain regression, to tell from a text the states during the span that the text
describes: minutes instead of hours, on the same spans, and for any scene and language. The heads that it learns this
with are thrown away. Token features are whitened before: directions in which they hardly differ, as those of `left` and
`right` do, count as much as the others.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from pgm_models.animation.aggregator import Aggregator
from pgm_models.animation.encode import standardise
from pgm_models.animation.store import StateStore
from pgm_models.animation.text_features import TextFeatures

WHITENING_TEXTS = 4096
"""Texts whose tokens are looked at."""
DULL = 0.1
"""Of the mean variance: directions with less than that are not raised to the full variance of 1."""
SPREAD = 0.05
"""Standard deviation, standardised, that states of a moment have at the least."""


@dataclass(frozen=True, kw_only=True)
class TextStartOptions:
    """How the aggregator learns what texts go with."""

    steps: int
    """Of the optimiser; 0 for none."""
    batch: int = 256
    """Spans a step, at most."""
    moments: int = 6
    """Of each span, evenly from its first frame to its last, at which states are told."""
    shortest: int = 4
    """Frames of a span that is used, at least."""
    learning_rate: float = 2e-3
    seed: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Whitening:
    """A linear map of token features after which they are uncorrelated, their variance about 1."""

    mean: Float[Tensor, " E"]
    map: Float[Tensor, "E E"]


@dataclass(frozen=True, eq=False, kw_only=True)
class SpanRows:
    """Spans of a store with the frames at which their states are told."""

    span: Int[np.ndarray, " spans"]
    """Rows of the store's spans."""
    player: Int[np.ndarray, " spans"]
    """Whose text it is."""
    rows: Int[np.ndarray, "spans moments"]
    """Frames of the store."""

    def __len__(self) -> int:
        """How many."""
        return len(self.span)


def whitening(features: TextFeatures, *, seed: int = 0) -> Whitening:
    """The map that whitens the tokens of a store's texts, of so many of them as tell."""
    texts = len(features.starts)
    some = np.sort(np.random.default_rng(seed).permutation(texts)[:WHITENING_TEXTS])
    tokens, mask = features.rows(some)
    found = tokens[mask].astype(np.float64)
    if len(found) < 2:
        return Whitening(mean=torch.zeros(features.width), map=torch.eye(features.width))
    variance, axes = np.linalg.eigh(np.cov(found.T).reshape(features.width, features.width))
    scale = 1.0 / np.sqrt(np.maximum(variance, 0.0) + DULL * variance.mean() + np.finfo(np.float64).tiny)
    return Whitening(
        mean=torch.as_tensor(found.mean(axis=0), dtype=torch.float32),
        map=torch.as_tensor(axes * scale, dtype=torch.float32),
    )


def span_rows(store: StateStore, segments: Int[np.ndarray, " some"], options: TextStartOptions) -> SpanRows:
    """Spans with a text within those segments, none shorter than `shortest`."""
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    along = np.linspace(0.0, 1.0, options.moments)
    for segment in segments.tolist():
        first, length = int(store.segment_start[segment]), int(store.segment_length[segment])
        spans = np.asarray(store.span[first : first + length])
        for player in range(spans.shape[1]):
            own = spans[:, player]
            starts = np.flatnonzero(np.concatenate([[True], own[1:] != own[:-1]]))
            ends = np.append(starts[1:], length)
            kept = (own[starts] >= 0) & (ends - starts >= options.shortest)
            starts, ends = starts[kept], ends[kept]
            rows = first + np.rint(starts[:, None] + (ends - 1 - starts)[:, None] * along).astype(np.int64)
            found.append((own[starts].astype(np.int64), np.full(len(starts), player), rows))
    if not found:
        return SpanRows(
            span=np.zeros(0, np.int64), player=np.zeros(0, np.int64), rows=np.zeros((0, options.moments), np.int64)
        )
    span, player, rows = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return SpanRows(span=span, player=player, rows=rows)


def teach_texts(
    aggregator: Aggregator,
    store: StateStore,
    features: TextFeatures,
    spans: SpanRows,
    options: TextStartOptions,
    show: Callable[[str], None] = lambda line: None,
) -> float:
    """Train the aggregator, where it lies, to tell the states during spans from their texts.

    Each property counts the same, each of its channels and moments by its own spread; what the data do not know counts
    nothing. Returns the share of the spread that is told in the last tenth of the steps, 0 where there is nothing to
    learn.
    """
    players, moments = len(store.layout.players), spans.rows.shape[1]
    if not options.steps or not len(spans):
        return 0.0
    device = next(aggregator.parameters()).device
    random = np.random.default_rng([options.seed, 11])
    few = spans.rows[random.permutation(len(spans))[:2048]]
    states, known = _states(store, few)
    count = known.sum(axis=0)
    mean = (states * known).sum(axis=0) / np.maximum(count, 1)
    spread = np.sqrt(((states - mean) ** 2 * known).sum(axis=0) / np.maximum(count, 1)) + SPREAD
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(options.seed)
        heads = nn.Linear(aggregator.width, players * moments * store.layout.channels).to(device)
    nn.init.zeros_(heads.weight)
    nn.init.zeros_(heads.bias)
    parameters = [*aggregator.parameters(), *heads.parameters()]
    optimiser = torch.optim.AdamW(parameters, lr=0.0, betas=(0.9, 0.99), weight_decay=0.01)
    properties = torch.as_tensor(store.layout.property_of_channel.copy(), device=device)
    told: list[float] = []
    aggregator.train().requires_grad_(True)
    for step in range(options.steps):
        for group in optimiser.param_groups:
            group["lr"] = options.learning_rate * _rate(step / options.steps)
        chosen = random.integers(len(spans), size=min(options.batch, len(spans)))
        texts = store.spans.text_of(spans.span[chosen], random.random(len(chosen)))
        different, same = np.unique(texts, return_inverse=True)
        tokens, mask = (torch.as_tensor(part).to(device) for part in features.rows(different))
        states, known = _states(store, spans.rows[chosen])
        wanted = torch.as_tensor((states - mean) / spread, dtype=torch.float32, device=device)
        counts = torch.as_tensor(known, device=device)
        said = heads(aggregator(tokens, mask)[torch.as_tensor(same, device=device)])
        said = said.unflatten(1, (players, moments, -1))
        said = said[torch.arange(len(chosen), device=device), torch.as_tensor(spans.player[chosen], device=device)]
        loss = _balanced((said - wanted).square(), counts, properties)
        told.append(1.0 - float(loss.detach() / _balanced(wanted.square(), counts, properties).clamp(min=1e-9)))
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimiser.step()
        if step % 500 == 499 or step == options.steps - 1:
            show(f"texts: step {step + 1} of {options.steps}, {100 * np.mean(told[-100:]):.1f} % of the spread told")
    aggregator.zero_grad(set_to_none=True)
    return float(np.mean(told[-max(1, options.steps // 10) :]))


def _rate(share: float) -> float:
    return min(1.0, share / 0.05) * 0.5 * (1.0 + float(np.cos(np.pi * share)))


def _states(
    store: StateStore, rows: Int[np.ndarray, "spans moments"]
) -> tuple[Float[np.ndarray, "spans moments channels"], np.ndarray]:
    """Standardised states of those frames, and which channels the data know."""
    tangent = np.asarray(store.tangent)[rows].astype(np.float64)
    valid = np.asarray(store.valid)[rows]
    states = standardise(store.layout, tangent)
    known = valid[..., store.layout.property_of_channel]
    return np.where(known, states, 0.0), known


def _balanced(squares: Tensor, known: Tensor, properties: Tensor) -> Tensor:
    """Mean over properties of the mean of what is known of each."""
    own = (squares * known).sum(dim=(0, 1))
    count = known.sum(dim=(0, 1)).to(own.dtype)
    kinds = int(properties.max()) + 1
    total = own.new_zeros(kinds).index_add(0, properties, own)
    counted = own.new_zeros(kinds).index_add(0, properties, count)
    return (total / counted.clamp(min=1.0)).sum() / (counted > 0).sum().clamp(min=1)
