"""Learning where people of one size stand in strips of a picture, from pictures with drawn people."""

from dataclasses import asdict, dataclass
from typing import cast

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn
from torch.nn import functional as F

from pgm_data.detect.players.person_network import STRIDE, PersonCalibration, read_peaks
from pgm_data.detect.players.person_strips import LEAST_DEPTH_M, PERSON_PX, ROWS, searched_ground
from pgm_data.scene import Scene
from pgm_models.detectors.augment import AugmentOptions, random_look
from pgm_models.detectors.ball_task import focal_loss
from pgm_models.detectors.person_backdrops import SIZE, Backdrops, picture_of
from pgm_models.detectors.person_crops import (
    COLUMNS,
    NEAR,
    Truth,
    camera_of,
    cut_piece,
    ground_before,
    piece_map,
    random_piece,
    seen_people,
    shown_cells,
    truth_of,
)
from pgm_models.detectors.person_figures import Cast, draw_people, place_people
from pgm_models.detectors.person_net import PersonNet
from pgm_models.train import Batch, Task

LOOKS = AugmentOptions(colour=0.75, grey=0.06, soften=0.55, shade=0.15, occlude=0.06, noise=0.2, jpeg=0.4)
"""Changes of a piece's looks."""
LEAST = -3.5
"""Logit of a person under which a peak is not judged; a network that has learned nothing says less."""
CLOSE_PX = 10.0
"""A peak with its feet this close to a person's has found it, strip pixels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PersonTaskOptions:
    """What a person network is shown and how its answers are weighed."""

    batch: int = 48
    """Pieces per batch."""
    per_picture: int = 12
    """Pieces from each picture."""
    player_weight: float = 2.0
    """Weight of who plays beside whether there is a person."""
    place_weight: float = 4.0
    """Weight of box and feet."""
    seed: int = 0
    """Of everything random."""


class PersonTask(Task):
    """People in pieces of strips: drawn anew for every batch onto empty courts."""

    def __init__(
        self,
        scene: Scene,
        backdrops: Backdrops,
        held_out: Backdrops,
        casts: tuple[Cast, Cast],
        options: PersonTaskOptions,
        looks: AugmentOptions = LOOKS,
        *,
        held_out_pieces: int,
    ) -> None:
        """`casts`: who is put onto the courts that are trained on, and onto the courts held out."""
        self.options, self.looks = options, looks
        self._scene, self._backdrops, self._cast = scene, backdrops, casts[0]
        corners = np.abs(searched_ground(scene)).max(axis=0)
        self._half = float(np.hypot(*corners))
        self._held_out: list[tuple[np.ndarray, Truth]] = []
        picture = 0
        while len(self._held_out) < held_out_pieces:
            rng = np.random.default_rng([options.seed, 1, picture])
            self._held_out += self._pieces(rng, held_out, casts[1], picture % len(held_out.each))
            picture += 1

    def describe(self) -> dict[str, object]:
        """Options and data."""
        return {
            "scene": self._scene.name,
            "options": asdict(self.options),
            "looks": asdict(self.looks),
            "pictures": len(self._backdrops.each),
            "players": len(self._cast.players),
            "postures": len(self._cast.postures),
        }

    def batch(self, index: int) -> Batch:
        """Pieces of random courts with random people; all from the seed and the batch's number."""
        pieces: list[tuple[np.ndarray, Truth]] = []
        names: list[str] = []
        while len(pieces) < self.options.batch:
            rng = np.random.default_rng([self.options.seed, 0, index, len(pieces)])
            number = int(rng.integers(len(self._backdrops.each)))
            pieces += self._pieces(rng, self._backdrops, self._cast, number)
            names += [f"court {number}"] * self.options.per_picture
        return _tensors(pieces[: self.options.batch], tuple(names[: self.options.batch]))

    def _pieces(
        self, rng: np.random.Generator, backdrops: Backdrops, cast: Cast, number: int
    ) -> list[tuple[np.ndarray, Truth]]:
        backdrop = backdrops.each[number]
        bgr = picture_of(backdrops, number, rng).copy()
        standing = draw_people(bgr, place_people(rng, cast, backdrop), backdrop, rng)
        camera = camera_of(backdrop.view)
        ground = ground_before(camera)
        people = seen_people(standing, ground)
        middle = float(ground.depth_and_side(np.zeros(2))[0])
        depths = np.array([max(middle - self._half, LEAST_DEPTH_M), middle + 1.2 * self._half])
        pieces = []
        for _ in range(self.options.per_picture):
            piece = random_piece(rng, people, ground, self._scene.person_height_m, depths)
            where = piece_map(piece, ground, camera)
            truth = truth_of(piece, people, ground, shown_cells(where, SIZE))
            pieces.append((random_look(cut_piece(bgr, where), rng, self.looks), truth))
        return pieces

    def loss(self, network: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Whether there is a person in each cell, whether it plays, and where its box and feet lie."""
        given = batch.tensors
        net = cast(PersonNet, network)
        features = net.features(given["strips"])
        with torch.autocast("cpu", enabled=False):
            answers = net.head(features.float())
            heat, counted = given["heat"], given["counted"]
            count = ((heat == 1.0).float() * counted).sum().clamp(min=1.0)
            person = focal_loss(answers[:, 0], heat, counted) / count
            weight = heat * (heat > NEAR) * counted
            total = weight.sum().clamp(min=1.0)
            said = F.binary_cross_entropy_with_logits(answers[:, 1], given["player"], reduction="none")
            # What is no person at all and is taken for one should at least not be taken for a player.
            fooled = 0.25 * torch.sigmoid(answers[:, 0]).detach() * (heat < 0.05) * counted
            player = (weight * said).sum() / total + (fooled * F.softplus(answers[:, 1])).sum() / total
            away = F.smooth_l1_loss(answers[:, 2:], given["place"], reduction="none", beta=0.05).mean(dim=1)
            place = (weight * away).sum() / total
            loss = person + self.options.player_weight * player + self.options.place_weight * place
        return loss, {"person": person.detach(), "player": player.detach(), "place": place.detach()}

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Recall, precision and errors on pieces of courts held out."""
        return score(judge(*self.held_out_answers(network)))

    @torch.no_grad()
    def held_out_answers(self, network: nn.Module) -> tuple[np.ndarray, list[Truth]]:
        """What the network says of the pieces held out, and what it should say."""
        answers = [
            network(torch.from_numpy(np.stack([s for s, _ in self._held_out[k : k + 48]]))).float().numpy()
            for k in range(0, len(self._held_out), 48)
        ]
        return np.concatenate(answers), [truth for _, truth in self._held_out]


def _tensors(pieces: list[tuple[UInt8[np.ndarray, "rows columns 3"], Truth]], names: tuple[str, ...]) -> Batch:
    strips, truths = zip(*pieces, strict=True)

    def stacked(name: str) -> Tensor:
        return torch.from_numpy(np.stack([getattr(t, name) for t in truths]).astype(np.float32))

    return Batch(
        tensors={
            "strips": torch.from_numpy(np.stack(strips)),
            **{name: stacked(name) for name in ("heat", "counted", "player", "place")},
        },
        names=names,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Judged:
    """The network's peaks on held-out pieces, each right or wrong."""

    person: Float[np.ndarray, " peaks"]
    """Logit of a person."""
    right: np.ndarray
    """Whether one stands there."""
    player: Float[np.ndarray, " peaks"]
    """Logit that it plays."""
    plays: np.ndarray
    """Whether it does; of right ones."""
    feet_px: Float[np.ndarray, " peaks"]
    """Distance of the feet from the person's, strip pixels; NaN of wrong ones."""
    people: int
    """People to be found."""


def judge(answers: Float[np.ndarray, "pieces channels high wide"], truths: list[Truth]) -> Judged:
    """Each peak against the people there; peaks where nothing is asked are left out."""
    peaks = read_peaks(answers.astype(np.float32), least=LEAST)
    right, plays = np.zeros(len(peaks.strip), bool), np.zeros(len(peaks.strip), bool)
    feet, asked = np.full(len(peaks.strip), np.nan), np.ones(len(peaks.strip), bool)
    people = 0
    for k, truth in enumerate(truths):
        rows, columns = np.nonzero((truth.heat == 1.0) & (truth.counted > 0))
        people += len(rows)
        middles = (np.stack([columns, rows], axis=1) + 0.5) * STRIDE - 0.5
        stand = middles + PERSON_PX * truth.place[4:6, rows, columns].T
        taken = np.zeros(len(rows), bool)
        for p in np.flatnonzero(peaks.strip == k):
            away = np.linalg.norm(stand - peaks.feet[p], axis=1) + 1e6 * taken
            if len(away) and away.min() < CLOSE_PX:
                best = int(away.argmin())
                taken[best], right[p], feet[p] = True, True, away[best]
                plays[p] = truth.player[rows[best], columns[best]] > 0.5
            else:
                middle = peaks.feet[p] - np.array([0.0, 0.5 * PERSON_PX])
                cell = np.floor((middle + 0.5) / STRIDE).astype(int)
                column, row = np.clip(cell, 0, [COLUMNS // STRIDE - 1, ROWS // STRIDE - 1])
                asked[p] = truth.counted[row, column] > 0
    return Judged(
        person=peaks.person[asked],
        right=right[asked],
        player=peaks.player[asked],
        plays=plays[asked],
        feet_px=feet[asked],
        people=people,
    )


def score(judged: Judged) -> dict[str, float]:
    """Recall at a precision of 0.9, share of people rightly told to play or not, and the median error of the feet."""
    order = np.argsort(-judged.person)
    right = np.cumsum(judged.right[order])
    precise = right >= 0.9 * np.arange(1, len(order) + 1)
    sure = judged.right & (judged.person > 0)
    return {
        "recall": float(right[precise].max(initial=0) / max(judged.people, 1)),
        "recall_at_half": float(sure.sum() / max(judged.people, 1)),
        "precision_at_half": float(sure.sum() / max((judged.person > 0).sum(), 1)),
        "role": float(((judged.player > 0) == judged.plays)[sure].mean()) if sure.any() else float("nan"),
        "feet_px": float(np.median(judged.feet_px[sure])) if sure.any() else float("nan"),
    }


def calibrate(judged: Judged) -> PersonCalibration:
    """Slopes and shifts of the network's logits by logistic regression on held-out pieces."""
    right = judged.right
    person = _fitted(judged.person, right)
    player = _fitted(judged.player[right], judged.plays[right])
    return PersonCalibration(
        person_slope=person[0], person_shift=person[1], player_slope=player[0], player_shift=player[1]
    )


def _fitted(logits: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Slope, between 0.2 and 4, and shift of a logistic regression; 1 and 0 where there is not enough of both."""
    if min(int(true.sum()), int((~true).sum())) < 10:
        return 1.0, 0.0
    from scipy.optimize import minimize

    def loss(at: np.ndarray) -> float:
        z = at[0] * logits + at[1]
        return float(np.mean(np.logaddexp(0.0, z) - true * z))

    found = minimize(loss, np.array([1.0, 0.0]), bounds=[(0.2, 4.0), (-4.0, 4.0)]).x
    return float(found[0]), float(found[1])
