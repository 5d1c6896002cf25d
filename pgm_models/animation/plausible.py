"""Of several samples of a window the one whose ball flies as balls do: it turns where ground, net or a player turn it.

A model of few steps now and then turns a ball round in mid-air, metres before it is at the player, or lets it pass. Of
a few samples there is mostly one in which it does not. What is asked for is not looked at, only what a ball can do.
"""

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pgm_data.scene import Scene
from pgm_models.animation.encode import decode
from pgm_models.animation.layout import Layout
from pgm_models.animation.settle_ball import BallPath, settled_ball
from pgm_models.animation.windows import Fill, Windows

BALL = ("ball.position", "ball.velocity")
UNEXPLAINED = ("free", "unseen")
"""Kinds of contacts that real balls seldom have."""
MOSTLY_KNOWN = 0.25
"""Share of a window's frames: where the ball is known in more of them, on average, one sample does."""


def judges(layout: Layout, scene: Scene) -> bool:
    """Whether samples can be told apart: states hold a ball that flies over a court."""
    columns = {entry.column for entry in layout.properties}
    return scene.ball is not None and scene.court is not None and set(BALL) <= columns


def best_of(fill: Fill, tries: int, layout: Layout, scene: Scene) -> Fill:
    """What fills in each window so often, and keeps the most plausible.

    Windows in which most is known, such as those between keyframes, are filled in once.

    Args:
        fill: What fills in windows.
        tries: How often.
        layout: Of the states.
        scene: That they are of.

    Raises:
        ValueError: If states have no ball that flies over a court.
    """
    if not judges(layout, scene):
        raise ValueError(f"tries: expected 1 in {scene.name}, which has no ball over a court to judge by, got {tries}")
    columns = [entry.column for entry in layout.properties]
    rows = [columns.index(name) for name in BALL]

    def chosen(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
        given = known[..., rows].cpu()
        best = fill(windows, known, text_known, generator)
        if given.all(dim=-1).float().mean() > MOSTLY_KNOWN:
            return best
        least = implausibility(best, windows, given, layout, scene)
        for _ in range(tries - 1):
            made = fill(windows, known, text_known, generator)
            found = implausibility(made, windows, given, layout, scene)
            better = torch.from_numpy(found < least).to(best.device)
            best = torch.where(better[:, None, None], made, best)
            least = np.minimum(found, least)
        return best

    return chosen


def implausibility(
    state: Float[Tensor, "B T C"], windows: Windows, given: Bool[Tensor, "B T 2"], layout: Layout, scene: Scene
) -> Float[np.ndarray, " B"]:
    """How little each window's ball flies as balls do: turns in mid-air and jumps that nothing explains, and a share.

    The share, below one, says how far settling moves the ball in most frames. Frames that no flight fits count as a
    turn each.

    Args:
        state: Standardised.
        windows: Of which constants and rate are taken.
        given: Whether the ball's position and velocity were given.
        layout: Of the states.
        scene: That they are of.
    """
    columns = decode(layout, state.float().cpu().numpy(), windows.constants.cpu().numpy(), scene=scene)
    roots = [f"{player.name}.root_position" for player in scene.players]
    players = np.stack([columns[name] for name in roots if name in columns], axis=2, dtype=np.float64)
    known = given.numpy()
    found = np.zeros(len(state))
    for row, rate in enumerate(windows.rate.cpu().numpy().astype(np.float64)):
        path = BallPath(
            position=columns[BALL[0]][row].astype(np.float64),
            velocity=columns[BALL[1]][row].astype(np.float64),
            known_position=known[row, :, 0],
            known_velocity=known[row, :, 1],
            times=np.arange(state.shape[1]) / rate,
            roots=players[row],
        )
        settled = settled_ball(path, scene)
        turns = np.isin(settled.contact_kind, UNEXPLAINED).sum() + (settled.status == "left").sum()
        found[row] = turns + np.tanh(np.median(settled.moved_m))
    return found
