"""What the page is told of a stage and of a rally."""

import json

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_models.animation.prompt import prompt_of
from pgm_models.synthesis.play_rallies import RallyError
from pgm_models.synthesis.play_stage import (
    camera_to_json,
    player_labels,
    rally_to_json,
    stage_to_json,
    usual_place,
    usual_view,
    values_at,
)
from tests.models.animation.toy_models import toy_layout, toy_property
from tests.models.synthesis.play_stages import FRAMES, PROMPT, Maker, toy_stage


@pytest.mark.parametrize("scene", ["tennis", "blocks"])
def test_a_stage_says_what_can_be_moved_and_where(scene):
    stage = toy_stage(scene)
    told = json.loads(json.dumps(stage_to_json(stage, renders=False), allow_nan=False))
    (low, high), court = told["area"], stage.scene.court
    assert np.all(np.array(low) < high) and not told["renders"] and told["picture"] == [64, 36]
    for player, declared in zip(told["players"], stage.scene.players, strict=True):
        assert player["column"] == f"{declared.name}.root_position" and len(player["start"]) == 3
        assert player["parents"] == declared.skeleton.parents.tolist()
        assert declared.skeleton.joint_names[player["head"]].lower() == "head"
    if court is None:
        assert told["lines"] == told["net"] == [] and told["ball"] is None and "surface" not in told
    else:
        ends = np.array([line["ends"] for line in told["lines"]])
        np.testing.assert_allclose(ends, court.lines_world, atol=1e-4)
        np.testing.assert_allclose(told["net"], court.net_world, atol=1e-4)
        assert told["surface"] == list(court.surface_half_size) and told["ball"]["radius"] > 0


def test_what_the_model_does_not_know_cannot_be_moved():
    stage = toy_stage()
    layout = toy_layout(players=1, ball=False)
    told = stage_to_json(type(stage)(**{**vars(stage), "layout": layout}), renders=True)
    assert [player["column"] for player in told["players"]] == ["player0.root_position", None]
    assert [player["speaks"] for player in told["players"]] == [True, False]
    assert told["ball"] is None


def test_players_begin_where_they_usually_are():
    (player, _) = load_scene("tennis").players
    known = toy_property("player0.root_position", 0, 3)
    place = usual_place(_layout_of(known, mean=[1.0, -12.0, 0.9]), player)
    np.testing.assert_allclose(place, [1, -12, 0.9])
    amid = usual_place(_layout_of(toy_property("ball.position", -1, 3)), player)
    np.testing.assert_allclose(amid[:2], [0, -10])
    assert 0.7 < amid[2] < 1.2


def _layout_of(entry, mean=(0.0, 0.0, 0.0)):
    layout = toy_layout()
    known = type(entry)(**{**vars(entry), "mean": np.array(mean)})
    return type(layout)(scene="tennis", players=("player0", "player1"), properties=(known,), constants=())


def test_players_are_called_by_their_end_of_the_court():
    assert player_labels(load_scene("tennis")) == ("Near player", "Far player")
    assert player_labels(load_scene("blocks")) == ("Player",)
    tennis = load_scene("tennis")
    many = type(tennis)(**{**vars(tennis), "objects": tennis.objects[:2] * 2})
    assert player_labels(many) == ("Player 1", "Player 2", "Player 3", "Player 4")


def test_still_cameras_are_told_once_and_moving_ones_each_frame():
    times = np.arange(5) / 5
    still = camera_to_json(usual_view(load_scene("tennis"), times))
    moving = camera_to_json(usual_view(load_scene("blocks"), times))
    assert len(still["R"]) == len(still["t"]) == len(still["K"]) == 1
    assert len(moving["R"]) == len(moving["t"]) == len(moving["K"]) == 5
    R = np.array(moving["R"]).reshape(-1, 3, 3)
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.tile(np.eye(3), (5, 1, 1)), atol=1e-7)


def test_a_scene_without_a_usual_view_gets_an_orbit():
    tennis = load_scene("tennis")
    other = type(tennis)(**{**vars(tennis), "name": "field", "court": None})
    assert usual_view(other, np.zeros(3)).reason == "orbit"


def test_rows_that_are_not_there_are_null():
    stage = toy_stage()
    rally = Maker(stage)(PROMPT, lambda share, words: None)
    columns = {**rally.columns, "player1.joints": np.full((FRAMES, 72), np.nan)}
    del columns["player0.joints"]
    told = json.loads(json.dumps(rally_to_json(type(rally)(**{**vars(rally), "columns": columns}), stage.scene)))
    assert told["players"][0]["joints"] is None and told["players"][1]["joints"] == [None] * FRAMES
    assert told["ball"][0] is None and told["ball"][1] == [1.0, -4.5, 1.0]


def test_a_moment_is_told_as_values_that_a_prompt_takes():
    layout = toy_layout()
    rally = Maker(toy_stage())(PROMPT, lambda share, words: None)
    bones = np.tile(np.arange(7.0), (FRAMES, 1))
    rally = type(rally)(**{**vars(rally), "columns": {**rally.columns, "player0.joint_translations": bones}})
    told = values_at(rally, layout, 0)
    # The ball is nowhere in the first frame, and player 1 has no bones.
    assert [entry["column"] for entry in told["changing"]] == [
        "player0.root_position",
        "player1.root_position",
        "ball.velocity",
    ]
    assert told["constant"] == [{"column": "player0.joint_translations", "value": [0, 1, 2, 3, 4, 5, 6]}]
    span = {"start_frame": 0, "end_frame": 1}
    values = [entry | span for entry in told["changing"]]
    values += [entry | span | {"end_frame": FRAMES} for entry in told["constant"]]
    prompt = prompt_of(PROMPT | {"values": values}, layout)
    np.testing.assert_array_equal(prompt.values[1].values[0], [0, 8, 0.9])
    assert "ball.position" in {entry["column"] for entry in values_at(rally, layout, 1)["changing"]}
    with pytest.raises(RallyError, match="frame: expected 0 to 19, got 20"):
        values_at(rally, layout, 20)
