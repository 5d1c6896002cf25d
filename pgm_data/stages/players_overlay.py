"""A clip's players drawn into its pictures through the frame's camera, for people to look at.

Bones of the registered skeleton: bright where the frame's own points support them, dim where they bridge a gap. Rings
are the points that the network saw. A sole's mark is filled while its foot is taken to stand on the ground, and an
ellipse on the ground says how well the root's place is known.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.dataset.clip_players import ClipPlayers
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene
from pgm_data.skeleton import Skeleton
from pgm_data.stages.court_drawing import BGR, SUBPIXEL_BITS, clipped

COLOURS: tuple[BGR, ...] = ((255, 170, 60), (60, 150, 255), (120, 230, 120), (230, 120, 230))
"""Of the players in the scene's order."""
SEEN, DOUBT = (255, 255, 255), (160, 160, 160)
STANDS = 0.5
"""Probability from which a foot is drawn as standing."""
LOWEST_SCORE = 0.3
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
            _circle(picture, pixel, 2.0, SEEN, 1)
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
    _lines(picture, _pieces(project(camera, ellipse)[0]), DOUBT, 1)
    joints = track.joints[index]
    if not np.isfinite(joints).all():
        return
    pixels, _ = project(camera, joints)
    children = np.flatnonzero(skeleton.parents >= 0)
    _lines(picture, np.stack([pixels[skeleton.parents[children]], pixels[children]], axis=1), colour, 2)
    for side, sole in enumerate(skeleton.soles):
        joint = skeleton.point_joints[skeleton.point_names.index(sole[-1])]
        if np.isfinite(pixels[joint]).all():
            stands = bool(track.contact[index, side] >= STANDS)
            _circle(picture, pixels[joint], 3.5, colour, cv2.FILLED if stands else 1)


def player_labels(strokes: PlayerStrokes, index: int) -> tuple[str, ...]:
    """A line about each player in a frame: who it is, how it was had, and how well its place is known."""
    lines = []
    for track in strokes.clip.players:
        who = str(track.identity[index])
        name = f"{track.name} {who}" if who else track.name
        if track.status[index] == "none":
            lines.append(f"{name}: none")
            continue
        std = np.sqrt(max(float(np.linalg.eigvalsh(np.nan_to_num(track.root_cov[index]))[-1]), 0.0))
        fit = track.reprojection_px[index]
        words = f"{name}: {track.status[index]}   +-{std:.2f} m"
        lines.append(f"{words}   {fit:.1f} px" if np.isfinite(fit) else words)
    return tuple(lines)


def _pieces(points: np.ndarray) -> np.ndarray:
    return np.stack([points[:-1], points[1:]], axis=1)


def _lines(picture: np.ndarray, pieces: Float[np.ndarray, "pieces 2 2"], colour: BGR, thickness: int) -> None:
    """The pieces, as far as they lie in the picture."""
    height, width = picture.shape[:2]
    inside = clipped(pieces, np.array([-2.0, -2.0]), np.array([width + 1.0, height + 1.0]))
    fixed_point = np.round(inside * (1 << SUBPIXEL_BITS)).astype(np.int32)
    cv2.polylines(picture, list(fixed_point), False, colour, thickness, cv2.LINE_AA, SUBPIXEL_BITS)


def _circle(picture: np.ndarray, pixel: np.ndarray, radius: float, colour: BGR, thickness: int) -> None:
    height, width = picture.shape[:2]
    if (pixel > -50).all() and pixel[0] < width + 50 and pixel[1] < height + 50:
        x, y, r = (round(float(value) * (1 << SUBPIXEL_BITS)) for value in (*pixel, radius))
        cv2.circle(picture, (x, y), r, colour, thickness, cv2.LINE_AA, SUBPIXEL_BITS)
