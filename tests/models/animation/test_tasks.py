import numpy as np
import pytest
import torch

from pgm_models.animation.layout import Layout, Property
from pgm_models.animation.tasks import hidden_player, scored_players, task_masks, task_names
from pgm_models.animation.windows import Windows


def layout_of(players: int, ball: bool = True) -> Layout:
    """Players with a root position and rotation each, and a ball."""

    def entry(column: str, player: int) -> Property:
        return Property(
            column=column,
            player=player,
            kind="vector",
            first=0,
            width=3,
            reference=np.zeros((0, 3)),
            channels=np.arange(3),
            rest=np.zeros(3),
            mean=np.zeros(3),
            std=np.ones(3),
        )

    names = tuple(f"player{k}" for k in range(players))
    properties = [entry(f"{name}.{part}", k) for k, name in enumerate(names) for part in ("root_position", "extra")]
    if ball:
        properties.append(entry("ball.position", -1))
    return Layout(scene="tennis", players=names, properties=tuple(properties), constants=())


def windows_of(layout: Layout, frames: int, count: int = 4) -> Windows:
    """Windows in which everything is there and every text given, but in the last one the ball's first frame."""
    valid = torch.ones(count, frames, len(layout.properties), dtype=torch.bool)
    valid[-1, 0, -1] = False
    return Windows(
        state=torch.zeros(count, frames, layout.channels),
        valid=valid,
        rate=torch.full((count,), 4.0),
        constants=torch.zeros(count, 0),
        text=torch.zeros(count, frames, len(layout.players), dtype=torch.int64),
        tokens=torch.zeros(1, 2, 4),
        token_mask=torch.ones(1, 2, dtype=torch.bool),
        names=tuple(f"window {k}" for k in range(count)),
    )


def test_scenes_with_two_players_have_four_tasks_and_others_three():
    assert task_names(layout_of(2)) == ("prediction", "unconditioned", "opponent", "completion")
    for players in (1, 3):
        assert task_names(layout_of(players)) == ("prediction", "unconditioned", "completion")
        with pytest.raises(ValueError, match="expected one of prediction, unconditioned, completion"):
            task_masks("opponent", windows_of(layout_of(players), 4), layout_of(players))


@pytest.mark.parametrize("frames", [1, 2, 8, 16, 64])
@pytest.mark.parametrize("name, told", [("prediction", True), ("unconditioned", False)])
def test_prediction_is_from_the_first_frame_and_from_all_texts_or_none(name, told, frames):
    layout = layout_of(2)
    known, text = task_masks(name, windows_of(layout, frames), layout)
    assert known[:-1, 0].all() and not known[:, 1:].any()
    assert bool(text.all()) == told and bool(text.any()) == told


def test_opponent_modelling_gives_one_player_with_its_texts_and_neither_the_other_nor_the_ball():
    layout = layout_of(2)
    known, text = task_masks("opponent", windows_of(layout, 16), layout)
    assert hidden_player(layout) == 1
    assert known.all(dim=(0, 1)).tolist() == [True, True, False, False, False]
    assert not known[..., 2:].any()
    assert text[..., 0].all() and not text[..., 1].any()
    assert scored_players("opponent", layout) == (1,)
    assert scored_players("completion", layout) == (-1, 0, 1)


@pytest.mark.parametrize(
    "frames, hidden", [(16, range(4, 12)), (8, range(2, 6)), (5, range(1, 3)), (64, range(16, 48))]
)
def test_completion_hides_half_of_the_frames_in_the_middle_with_their_texts(frames, hidden):
    layout = layout_of(2)
    known, text = task_masks("completion", windows_of(layout, frames), layout)
    given = torch.tensor([frame not in hidden for frame in range(frames)])
    assert torch.equal(known[0], given[:, None].expand(frames, 5))
    assert torch.equal(text[0], given[:, None].expand(frames, 2))


@pytest.mark.parametrize("name", ["prediction", "unconditioned", "opponent", "completion"])
def test_nothing_is_given_that_the_data_do_not_say(name):
    layout = layout_of(2)
    windows = windows_of(layout, 16)
    windows.valid[1] = False
    windows.text[2] = -1
    known, text = task_masks(name, windows, layout)
    assert not (known & ~windows.valid).any()
    assert not text[2].any()


def test_the_windows_are_left_as_they_are():
    layout = layout_of(2)
    windows = windows_of(layout, 8)
    before = windows.valid.clone(), windows.text.clone()
    task_masks("completion", windows, layout)
    assert torch.equal(windows.valid, before[0]) and torch.equal(windows.text, before[1])
