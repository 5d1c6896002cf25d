"""A clip's players drawn into its pictures through the frame's camera, for people to look at.

Bones of the registered skeleton: bright where the frame's own points support them, dim where they bridge a gap. Rings
are the points that the network saw. A sole's mark is filled while its foot is taken to stand on the ground, and an
ellipse on the ground says how well the root's place is known.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene
from pgm_data.skeleton import Skeleton
from pgm_data.stages.court_drawing import BGR
from pgm_data.stages.overlay_marks import draw_circle, draw_path, draw_pieces, draw_words

COLOURS: tuple[BGR, ...] = ((255, 170, 60), (60, 150, 255), (120, 230, 120), (230, 120, 230))
"""Of the players in the scene's order."""
SEEN, DOUBT = (255, 255, 255), (160, 160, 160)
STANDS = 0.5
"""Probability from which a foot is drawn as standing."""
LOWEST_SCORE = 0.3
LABEL_OVER_M = 0.3
"""How far above the highest joint a player's label stands, m."""
CIRCLE = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 33)), np.sin(a)], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerStrokes:
    """A clip's players, and the bones and soles of each."""

    clip: ClipPlayers
    skeletons: tuple[Skeleton, ...]


def player_strokes(clip: ClipPlayers, scene: Scene) -> PlayerStrokes:
    """The players of a clip, ready to be drawn."""
    skeletons = tuple(player.skeleton for player in scene.players if player.skeleton is not None)
    return PlayerStrokes(clip=clip, skeletons=skeletons)


def draw_players(
    picture: UInt8[np.ndarray, "h w 3"],
    strokes: PlayerStrokes,
    camera: Camera,
    index: int,
    scale_xy: Float[np.ndarray, " 2"],
) -> None:
    """Draw the players of frame `index` into the BGR picture, which is changed in place.

    Args:
        picture: The frame, perhaps made smaller.
        strokes: The clip's players.
        camera: Of the picture as it is; NaN where the frame has none: then only what was seen is drawn.
        index: Frame of the clip.
        scale_xy: Size of the picture over that of the video's.
    """
    has_camera = bool(np.isfinite(camera.K).all())
    for number, (track, skeleton) in enumerate(zip(strokes.clip.players, strokes.skeletons, strict=True)):
        colour = COLOURS[number % len(COLOURS)]
        seen = (track.keypoints_px[index] + 0.5) * scale_xy - 0.5
        strong = np.isfinite(seen).all(axis=1) & (track.keypoint_score[index] >= LOWEST_SCORE)
        for pixel in seen[strong]:
            draw_circle(picture, pixel, 2.0, SEEN, 1)
        if has_camera and track.status[index] != "none":
            _draw_body(picture, strokes, number, skeleton, camera, index)
        corners = (track.box_px[index].reshape(2, 2) + 0.5) * scale_xy - 0.5
        if np.isfinite(corners).all() and not np.isfinite(track.joints[index]).all():
            x0, y0, x1, y1 = (round(float(value)) for value in corners.ravel())
            cv2.rectangle(picture, (x0, y0), (x1, y1), colour, 1, cv2.LINE_AA)


def _draw_body(
    picture: np.ndarray, strokes: PlayerStrokes, number: int, skeleton: Skeleton, camera: Camera, index: int
) -> None:
    track = strokes.clip.players[number]
    measured = track.status[index] == "measured"
    blue, green, red = COLOURS[number % len(COLOURS)]
    colour = (blue, green, red) if measured else (blue // 2, green // 2, red // 2)
    root = track.root_position[index]
    values, axes = np.linalg.eigh(np.nan_to_num(track.root_cov[index, :2, :2]))
    around = CIRCLE * np.sqrt(np.maximum(values, 0.0)) @ axes.T
    ellipse = np.column_stack([root[:2] + around, np.zeros(len(CIRCLE))])
    draw_path(picture, project(camera, ellipse)[0], DOUBT, 1)
    joints = track.joints[index]
    over = np.array([root[0], root[1], max(float(np.nan_to_num(joints[:, 2]).max(initial=0.0)), 1.9) + LABEL_OVER_M])
    draw_words(
        picture, project(camera, over[None])[0][0] - [30, 0], _label(track, index), COLOURS[number % len(COLOURS)]
    )
    if not np.isfinite(joints).all():
        return
    pixels, _ = project(camera, joints)
    children = np.flatnonzero(skeleton.parents >= 0)
    draw_pieces(picture, np.stack([pixels[skeleton.parents[children]], pixels[children]], axis=1), colour, 2)
    for side, sole in enumerate(skeleton.soles):
        joint = skeleton.point_joints[skeleton.point_names.index(sole[-1])]
        if np.isfinite(pixels[joint]).all():
            stands = bool(track.contact[index, side] >= STANDS)
            draw_circle(picture, pixels[joint], 3.5, colour, cv2.FILLED if stands else 1)


def _label(track: PlayerTrack, index: int) -> str:
    """Who it is, and how well the place is known."""
    name = str(track.identity[index]) or track.name
    std = np.sqrt(max(float(np.linalg.eigvalsh(np.nan_to_num(track.root_cov[index]))[-1]), 0.0))
    return f"{name} {'' if track.status[index] == 'measured' else track.status[index] + ' '}+-{std:.2f} m"
