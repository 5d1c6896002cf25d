"""Pictures for the page of `pgm play`."""

import cv2
import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_models.animation.play_camera import PlayCamera, usual_camera
from pgm_models.synthesis.render_layers import Filmer, as_bgr
from pgm_models.synthesis.render_play import PlayRenderer, load_renderer, states_of_columns
from pgm_models.synthesis.render_source import find_clip, read_clip, refitted
from tests.models.synthesis.drawn_matches import write_drawn_clip
from tests.models.synthesis.toy_models import PICTURE, toy_model, toy_run


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder, scene = tmp_path_factory.mktemp("work") / "rally", load_scene("tennis")
    write_drawn_clip(folder, scene, match=0, frames=3)
    return read_clip(find_clip(folder), scene, PICTURE)


def columns_of(clip, frame):
    """One frame's columns as a rally has them, the ball standing still."""
    store, columns = clip.store, {}
    for name in store.rotations:
        columns[f"{name}.joint_rotations"] = store.rotations[name][frame].astype(np.float64).reshape(-1)
        columns[f"{name}.joint_translations"] = store.translations[name][frame].astype(np.float64).reshape(-1)
    return columns | {"ball.position": store.ball_position[frame]}


def view_of(size=PICTURE):
    view = usual_camera(load_scene("tennis"), np.zeros(1))
    return PlayCamera(camera=refitted(view.camera, view.size, size)[0], size=size, reason="")


def decoded(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


def test_columns_of_a_frame_are_its_states(clip):
    expected, found = clip.store.states([1]), states_of_columns(columns_of(clip, 1), clip.store.scene)
    for name, poses in expected.poses.items():
        for part, values in vars(poses).items():
            np.testing.assert_allclose(getattr(found.poses[name], part), values, atol=1e-6)
    np.testing.assert_allclose(found.balls.position, expected.balls.position)
    assert not found.balls.path.any()
    less = states_of_columns({"player1.root_position": np.zeros(3)}, clip.store.scene)
    assert not less.poses and less.balls is None


def test_a_run_renders_frames_in_what_its_first_match_wore(clip, tmp_path):
    model = toy_model()
    renderer = load_renderer(toy_run(tmp_path, model), "cpu")
    assert (renderer.scene, renderer.picture) == ("tennis", PICTURE)
    filmer = Filmer(model, model.match_styles["match0"][None], PICTURE)
    for frame in (0, 1, 1):  # the view is seen for the first time, then again
        png = renderer.render(columns_of(clip, frame), view_of())
        states = states_of_columns(columns_of(clip, frame), clip.store.scene)
        expected = as_bgr(filmer.moving(view_of().camera, states))
        assert np.abs(decoded(png).astype(int) - expected).max() <= 1
    assert decoded(renderer.render({}, view_of((40, 30)))).shape == (30, 40, 3)
    assert decoded(renderer.render(columns_of(clip, 1), view_of())).shape == (*PICTURE[::-1], 3)
    with pytest.raises(ValueError, match="expected a run of pgm-train synthesis, got nothing there"):
        load_renderer(tmp_path / "none", "cpu")
    with pytest.raises(ValueError, match="device: expected"):
        load_renderer(tmp_path, "gpu")


def test_a_model_without_styles_renders_too_and_few_sizes_are_kept(clip):
    model = toy_model()
    model.keep_styles({})
    renderer = PlayRenderer(model)
    for size in ((40, 30), (30, 20), (20, 10)):
        assert decoded(renderer.render(columns_of(clip, 0), view_of(size))).shape == (*size[::-1], 3)
    assert list(renderer._filmers) == [(30, 20), (20, 10)]
