"""The paper's four tasks: what of a window is given, and what is to be filled in.

Source: the paper, section "Evaluation Protocol".
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, get_args

import torch
from jaxtyping import Bool
from torch import Tensor

from pgm_models.animation.layout import Layout
from pgm_models.animation.windows import Windows

TaskName = Literal["prediction", "unconditioned", "opponent", "completion"]
TITLES: Mapping[TaskName, str] = MappingProxyType(
    {
        "prediction": "Action-conditioned prediction",
        "unconditioned": "Unconditioned prediction",
        "opponent": "Opponent modelling",
        "completion": "Sequence completion",
    }
)
"""As the paper's tables call them."""


def task_names(layout: Layout) -> tuple[TaskName, ...]:
    """The tasks that can be set in a scene: opponent modelling needs two players."""
    return tuple(name for name in get_args(TaskName) if name != "opponent" or len(layout.players) == 2)


def hidden_player(layout: Layout) -> int:
    """Index of the player to be told in opponent modelling: the last of the scene, in tennis the far one."""
    return len(layout.players) - 1


def task_masks(name: TaskName, windows: Windows, layout: Layout) -> tuple[Bool[Tensor, "B T P"], Bool[Tensor, "B T A"]]:
    """Which properties and which texts are given; never those that the data say nothing of.

    - `prediction`: the first frame, and all texts.
    - `unconditioned`: the first frame, no text.
    - `opponent`: all of one player and its texts; not the other player (`hidden_player`), and not the ball, since the
      paper gives "the state of the other player" and no more.
    - `completion`: all but half of the frames in the middle (8 of 16), and the texts of the frames that are given.

    Raises:
        ValueError: If the scene does not have the task.
    """
    if name not in task_names(layout):
        raise ValueError(f"task: expected one of {', '.join(task_names(layout))} in {layout.scene}, got {name!r}")
    frames, device = windows.state.shape[1], windows.state.device
    known = torch.zeros_like(windows.valid)
    told = torch.zeros_like(windows.text, dtype=torch.bool)
    match name:
        case "prediction" | "unconditioned":
            known[:, 0] = True
            told[:] = name == "prediction"
        case "opponent":
            players = torch.tensor([entry.player for entry in layout.properties], device=device)
            known[:] = (players >= 0) & (players != hidden_player(layout))
            told[:] = torch.arange(len(layout.players), device=device) != hidden_player(layout)
        case "completion":
            given = ~_middle(frames, device)
            known[:] = given[:, None]
            told[:] = given[:, None]
    return known & windows.valid, told & (windows.text >= 0)


def scored_players(name: TaskName, layout: Layout) -> tuple[int, ...]:
    """Indices of the players whose properties a task is scored by, -1 of the ball.

    Of opponent modelling the paper scores "the object properties of an unknown player": not the ball.
    """
    if name == "opponent":
        return (hidden_player(layout),)
    return tuple(sorted({entry.player for entry in layout.properties}))


def _middle(frames: int, device: torch.device) -> Bool[Tensor, " T"]:
    """Half of the frames, in the middle; one of one."""
    hidden = max(frames // 2, 1)
    first = (frames - hidden) // 2
    place = torch.arange(frames, device=device)
    return (place >= first) & (place < first + hidden)
