"""What the page of `pgm play` is told: the scene with what can be moved in it, and rallies, as JSON values."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.scene import Scene, SceneObject
from pgm_models.animation.layout import Layout
from pgm_models.animation.play_camera import PlayCamera, usual_camera
from pgm_models.synthesis.camera_paths import orbit, play_area, usual_orbit
from pgm_models.synthesis.play_rallies import Rally

MOST_FRAMES = 1500
"""Longest rally that the page asks for."""
MOST_PIXELS = 2560 * 1440
"""Of a picture that the page asks for."""
PLACES = 4
"""Decimals of metres and of camera numbers that are sent: a tenth of a millimetre."""
USUAL_HZ = 25.0
"""Frames a second at which rallies are made where the model was trained so fast."""
BALL_HEIGHT_M = 1.0
"""Where a ball is put unless it is said: between a player's hip and shoulder."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stage:
    """What is played, where, and by which models."""

    scene: Scene
    layout: Layout
    """What the animation model knows of it."""
    rates: tuple[float, float]
    """Lowest and highest rate that it was trained with, frames a second."""
    animation: str
    """Name of its run, for the reader."""
    synthesis: str
    """Name of the run that renders; empty for none."""
    picture: tuple[int, int]
    """Width and height of the pictures that it was trained with, px."""
    most_frames: int = MOST_FRAMES


def stage_to_json(stage: Stage, *, renders: bool) -> dict[str, object]:
    """What the page draws before there is a rally, and what a prompt may say.

    Args:
        stage: What is played.
        renders: Whether pictures can be asked for.
    """
    scene = stage.scene
    lower, upper = play_area(scene)
    view = usual_view(scene, np.zeros(1))
    columns = {entry.column for entry in stage.layout.properties}
    said: dict[str, object] = {
        "scene": scene.name,
        "animation": stage.animation,
        "synthesis": stage.synthesis,
        "renders": renders,
        "picture": list(stage.picture),
        "most_frames": stage.most_frames,
        "most_pixels": MOST_PIXELS,
        "rates": {"low": stage.rates[0], "high": stage.rates[1], "usual": min(USUAL_HZ, stage.rates[1])},
        "area": [_rounded(lower), _rounded(upper)],
        "lines": [],
        "net": [],
        "players": [
            _player(stage.layout, number, each, label, columns)
            for number, (each, label) in enumerate(zip(scene.players, player_labels(scene), strict=True))
        ],
        "ball": None,
        "camera": None if view is None else camera_to_json(view),
    }
    if scene.court is not None:
        widths = zip(scene.court.lines_world, scene.court.line_width, strict=True)
        said["surface"] = list(scene.court.surface_half_size)
        said["lines"] = [{"ends": _rounded(ends), "width": float(width)} for ends, width in widths]
        said["net"] = _rounded(scene.court.net_world)
    if scene.ball is not None and "ball.position" in columns:
        start = [float((lower + upper)[0] / 2), float((lower + upper)[1] / 2), BALL_HEIGHT_M]
        said["ball"] = {"column": "ball.position", "radius": scene.ball.radius_m, "start": start}
    return said


def _player(layout: Layout, number: int, player: SceneObject, label: str, columns: set[str]) -> dict[str, object]:
    column = f"{player.name}.root_position"
    assert player.skeleton is not None  # of every player of a scene
    joints = [name.lower() for name in player.skeleton.joint_names]
    return {
        "name": player.name,
        "label": label,
        "number": number,
        "speaks": number < len(layout.players),
        "column": column if column in columns else None,
        "start": _rounded(usual_place(layout, player)),
        "parents": player.skeleton.parents.tolist(),
        "head": joints.index("head") if "head" in joints else -1,
    }


def player_labels(scene: Scene) -> tuple[str, ...]:
    """What the reader calls the players: by the end of the court that each keeps to, else by number."""
    count = len(scene.players)
    if count == 1:
        return ("Player",)
    if scene.court is not None and count == 2 and all(player.region_m for player in scene.players):
        middles = [np.mean([corner[1] for corner in player.region_m]) for player in scene.players]
        if middles[0] < 0 < middles[1]:
            return ("Near player", "Far player")
    return tuple(f"Player {number + 1}" for number in range(count))


def usual_place(layout: Layout, player: SceneObject) -> Float[np.ndarray, " 3"]:
    """Where the player's root is on average in the model's training data, world metres; else amid its region."""
    column = f"{player.name}.root_position"
    assert player.skeleton is not None
    place = np.array([0.0, 0.0, player.skeleton.rest_translations[0, 1]])
    if player.region_m:
        place[:2] = np.mean(np.array(player.region_m), axis=0)[:2]
    for entry in layout.properties:
        if entry.column == column:
            place[:] = entry.rest
            place[entry.channels] = entry.mean
    return place


def usual_view(scene: Scene, times: Float[np.ndarray, " frames"]) -> PlayCamera:
    """The scene's usual camera at the times, s; a slow orbit where it has none."""
    view = usual_camera(scene, times)
    return orbit(usual_orbit(scene), times) if view is None else view


def camera_to_json(view: PlayCamera) -> dict[str, object]:
    """The cameras of frames: what all have in common once, and centres and rotations a frame; one of still cameras."""
    camera = view.camera
    still = all((values == values[:1]).all() for values in (camera.K, camera.R_cam_from_world, camera.t_cam_from_world))
    shown = slice(0, 1) if still else slice(None)
    return {
        "width": view.size[0],
        "height": view.size[1],
        "K": np.round(camera.K[shown].reshape(-1, 9), 6).tolist(),
        "distortion": camera.distortion[0].tolist(),
        "R": np.round(camera.R_cam_from_world[shown].reshape(-1, 9), 9).tolist(),
        "t": np.round(camera.t_cam_from_world[shown], 9).tolist(),
    }


def rally_to_json(rally: Rally, scene: Scene) -> dict[str, object]:
    """The rally as the page draws it: roots, joints and ball in world metres, null where there is none."""
    columns = rally.columns
    ball = columns.get("ball.position")
    return {
        "frames": rally.frames,
        "rate": rally.rate,
        "prompt": dict(rally.prompt),
        "players": [
            {
                "name": player.name,
                "root": _rows(columns.get(f"{player.name}.root_position")),
                "joints": _rows(columns.get(f"{player.name}.joints")),
            }
            for player in scene.players
        ],
        "ball": _rows(ball),
        "camera": None if rally.view is None else camera_to_json(rally.view),
        "notes": list(rally.notes),
        "warnings": list(rally.warnings),
    }


def values_at(rally: Rally, layout: Layout, frame: int) -> dict[str, list[dict[str, object]]]:
    """One frame of a rally as values of a prompt that goes on from there: what changes, and what stays the same.

    Columns that are not there in that frame are left out.

    Raises:
        RallyError: If there is no such frame.
    """
    state = rally.state(frame)

    def told(columns: list[str]) -> list[dict[str, object]]:
        there = [name for name in columns if name in state and np.isfinite(state[name]).all()]
        return [{"column": name, "value": state[name].tolist()} for name in there]

    return {
        "changing": told([entry.column for entry in layout.properties]),
        "constant": told([entry.column for entry in layout.constants]),
    }


def _rows(values: Float[np.ndarray, "frames _"] | None) -> list | None:
    """A row a frame, null for those that are not there."""
    if values is None:
        return None
    there = np.asarray(np.isfinite(values).all(axis=1))
    rows = np.round(np.where(there[:, None], values, 0.0), PLACES).tolist()
    return [row if is_there else None for row, is_there in zip(rows, there.tolist(), strict=True)]


def _rounded(values: np.ndarray) -> list:
    return np.round(values, PLACES).tolist()
