"""Learning contacts from tracks of simulated balls, each seen by another camera and spoiled in another way."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from pgm_data.detect.ball.track_features import HOLE_S, STEP_S, step_features
from pgm_data.detect.ball.track_network import CLASSES
from pgm_models.detectors.track_event_plays import DEAD_BOUNCE, HIT, TOSS, TruePlay, with_dribbles
from pgm_models.detectors.track_event_views import detected, draw_rate, draw_view, hide_contacts, hide_spells
from pgm_models.train import Batch, Task

HELD_OUT_EVERY = 20
HELD_OUT_WINDOWS = 64
TURNED = np.array([-1.0, -1.0, 1.0])
MIRRORED = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackEventTaskOptions:
    """What the network is shown."""

    batch: int = 16
    """Windows per batch."""
    steps: int = 512
    """Steps of a window."""
    dribbles: float = 0.4
    """Share of plays whose server bounces the ball before the toss."""
    stretch: float = 0.15
    """Largest change of the speed of time, as a share: frame rates are not always known."""
    seed: int = 0
    """Of everything random."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Window:
    """A piece of a match, its steps' features and what truly happened."""

    features: Float[np.ndarray, "features steps"]
    classes: Float[np.ndarray, "classes steps"]
    """Share of each class in each step: an event is divided between the two steps beside it."""
    counted: Float[np.ndarray, " steps"]
    """1 where something is known of the ball, else 0."""


class TrackEventTask(Task):
    """Windows drawn from plays; every twentieth play is held out."""

    def __init__(self, plays: Sequence[TruePlay], options: TrackEventTaskOptions) -> None:
        """Divide the plays."""
        held_out = [play for i, play in enumerate(plays) if i % HELD_OUT_EVERY == HELD_OUT_EVERY - 1]
        self.training = [play for i, play in enumerate(plays) if i % HELD_OUT_EVERY != HELD_OUT_EVERY - 1]
        self.options = options
        chosen = held_out or self.training
        self._shown = _stacked(
            [draw_window(np.random.default_rng((options.seed, 1, i)), chosen, options) for i in range(HELD_OUT_WINDOWS)]
        )

    def batch(self, index: int) -> Batch:
        """Windows drawn for this step alone."""
        first = index * self.options.batch
        numbers = range(first, first + self.options.batch)
        windows = [
            draw_window(np.random.default_rng((self.options.seed, 0, i)), self.training, self.options) for i in numbers
        ]
        return Batch(tensors=_stacked(windows), names=tuple(f"window {i}" for i in numbers))

    def loss(self, network: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Cross entropy, mean over the steps in which something is known of the ball."""
        logs = F.log_softmax(network(batch.tensors["features"]).float(), dim=1)
        counted = batch.tensors["counted"]
        lost = -(batch.tensors["classes"] * logs).sum(dim=1) * counted
        return lost.sum() / counted.sum().clamp(min=1.0), {}

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Held-out cross entropy (thousandths), and how many events are expected over how many there are."""
        counted, classes = self._shown["counted"], self._shown["classes"]
        with torch.no_grad():
            loss, _ = self.loss(network, Batch(tensors=self._shown, names=()))
            shares = torch.softmax(network(self._shown["features"]).float(), dim=1)
        expected, true = ((values * counted[:, None]).sum(dim=(0, 2)) for values in (shares, classes))
        ratios = {f"{name}_ratio": float(r) for name, r in zip(CLASSES, expected / true.clamp(min=1e-6), strict=True)}
        return {"loss_e3": 1e3 * float(loss), **ratios}

    def describe(self) -> dict[str, object]:
        """The options and the amount of data."""
        return {"options": asdict(self.options), "plays": len(self.training)}


def _stacked(windows: Sequence[Window]) -> dict[str, Tensor]:
    return {
        name: torch.from_numpy(np.stack([getattr(w, name) for w in windows]).astype(np.float32))
        for name in ("features", "classes", "counted")
    }


def draw_window(rng: np.random.Generator, plays: Sequence[TruePlay], options: TrackEventTaskOptions) -> Window:
    """A window of one or more plays one after the other, as some detector gives it of some camera's picture."""
    length = options.steps * STEP_S
    speed = 1.0 + options.stretch * rng.uniform(-1.0, 1.0)
    rate = draw_rate(rng)
    times = np.arange(rng.random() / rate, length, 1.0 / rate)
    view = draw_view(rng)
    shape = (TURNED if rng.random() < 0.5 else np.ones(3)) * (MIRRORED if rng.random() < 0.5 else np.ones(3))
    positions, event_times, event_classes, hidden = np.full((len(times), 3), np.nan), [], [], np.zeros(len(times), bool)
    reached: float | None = None
    while reached is None or reached < length:
        play = plays[int(rng.integers(len(plays)))]
        if rng.random() < options.dribbles:
            play = with_dribbles(play, rng)
        play = replace(play, times=play.times / speed, event_times=play.event_times / speed)
        start, end = play.times[0], play.times[-1]
        shift = -rng.uniform(start - 2.0, end - 1.0) if reached is None else reached - start + rng.uniform(0.0, 3.0)
        here = play.at(times - shift)
        seen = np.isfinite(here[:, 0])
        positions[seen] = here[seen]
        hidden |= _not_shown(rng, play, times - shift) & seen
        event_times.append(play.event_times + shift)
        event_classes.append(play.event_classes)
        reached = float(end + shift)
    happened, classes = np.concatenate(event_times), np.concatenate(event_classes)
    pixels = view.pixels(positions * shape, times)
    hidden |= hide_spells(rng, times) | hide_contacts(rng, times, happened[classes == HIT])
    pixels = detected(rng, times, np.where(hidden[:, None], np.nan, pixels), view.size)
    known = np.isfinite(pixels[:, 0])
    features = step_features(times[known], pixels[known], size=view.size, start_s=0.0, steps=options.steps)
    counted = (features[6] > 0) | (features[7:9].min(axis=0) < HOLE_S) & features[0:2].any(axis=0)
    return Window(
        features=features, classes=class_targets(happened, classes, options.steps), counted=counted.astype(float)
    )


def _not_shown(rng: np.random.Generator, play: TruePlay, times: Float[np.ndarray, " samples"]) -> np.ndarray:
    """Where the ball is not tracked because it is not in play: before the toss, through it, after the play, by lot."""
    hidden = np.zeros(len(times), dtype=bool)
    (toss,) = play.event_times[play.event_classes == TOSS]
    if rng.random() < 0.6:
        hidden |= times < toss
    if rng.random() < 0.3:
        hidden |= times < play.event_times[play.event_classes == HIT][0]
    dead = play.event_times[play.event_classes == DEAD_BOUNCE]
    if rng.random() < 0.3 and len(dead):
        hidden |= times > dead[0] + rng.uniform(-0.3, 2.0)
    return hidden


def class_targets(
    event_times: Float[np.ndarray, " events"], event_classes: np.ndarray, steps: int
) -> Float[np.ndarray, "classes steps"]:
    """Share of each class in each step, step 0 at time 0; the mean step of an event's shares is its exact time."""
    targets = np.zeros((len(CLASSES), steps))
    at = event_times / STEP_S
    low = np.floor(at).astype(int)
    for step, share in ((low, 1 - (at - low)), (low + 1, at - low)):
        inside = (step >= 0) & (step < steps)
        np.add.at(targets, (event_classes[inside], step[inside]), share[inside])
    total = targets.sum(axis=0)
    targets /= np.maximum(total, 1.0)
    targets[0] = 1.0 - np.minimum(total, 1.0)
    return targets
