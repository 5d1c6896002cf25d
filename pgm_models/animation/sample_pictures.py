"""Generated sequences as one picture: paths from above, the ball's height from the side, and bodies as sticks."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.dataset.files import whole_file
from pgm_data.scene import Scene, load_scene
from pgm_data.skeleton import Skeleton
from pgm_data.stages.court_drawing import BGR
from pgm_data.stages.overlay_marks import draw_circle, draw_path, draw_pieces
from pgm_models.animation.layout import Layout

SAMPLES_NAME = "samples"
"""Folder of a run with its pictures."""
PANEL, STRIP, GAP = 300, 760, 8
"""Side of the panels of a sequence and length of its strip of bodies, px; and what lies between."""
GROUND: BGR = (252, 252, 252)
COURT: BGR = (170, 170, 170)
WORDS: BGR = (60, 60, 60)
BALL: BGR = (0, 140, 255)
PLAYERS: tuple[BGR, ...] = ((178, 114, 0), (0, 94, 213), (115, 158, 0), (167, 121, 204))
BODIES = 8
"""Bodies in a strip, at most."""
BODY_M = 2.6
"""Height and width of the box that a body is drawn in, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sheet:
    """What does not change from sequence to sequence: how world metres become pixels."""

    scene: Scene
    skeletons: Mapping[str, Skeleton]
    """Of the players that have one."""
    low: Float[np.ndarray, " 3"]
    """Lower corner of what is drawn, world metres."""
    high: Float[np.ndarray, " 3"]

    def from_above(self, points_world: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points 2"]:
        """Pixels in the first panel: x to the right, y upwards."""
        return self._in_panel(points_world[..., (0, 1)], self.low[[0, 1]], self.high[[0, 1]])

    def from_side(self, points_world: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points 2"]:
        """Pixels in the second panel, stretched upwards: y to the right, z upwards."""
        share = (points_world[..., (1, 2)] - self.low[[1, 2]]) / (self.high - self.low)[[1, 2]]
        return np.stack([share[..., 0], 1 - share[..., 1]], axis=-1) * (PANEL - 1)

    def _in_panel(self, values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        scale = (PANEL - 1) / float((high - low).max())
        centred = (values - (low + high) / 2) * scale
        return centred * np.array([1.0, -1.0]) + (PANEL - 1) / 2


def write_samples(
    run: Path,
    columns: Mapping[str, Float[np.ndarray, "N T _"]],
    times: Float[np.ndarray, "N T"],
    layout: Layout,
    step: int,
) -> Path:
    """Write the sequences as `samples/step_000123.png` of the run; the file.

    Args:
        run: Folder of the run.
        columns: Columns of the contract, N sequences of T frames, as decoded; NaN is not drawn.
        times: Of the frames, seconds.
        layout: Names scene and players.
        step: Of the training.

    Raises:
        ValueError: If there is no sequence, or no player and no ball has a position.
    """
    picture = sample_sheet(columns, times, layout)
    path = run / SAMPLES_NAME / f"step_{step:06d}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    done, encoded = cv2.imencode(".png", picture)
    if not done:
        raise ValueError(f"{path}: expected a picture that can be written, got one of shape {picture.shape}")
    with whole_file(path) as temporary:
        temporary.write_bytes(encoded.tobytes())
    return path


def sample_sheet(
    columns: Mapping[str, Float[np.ndarray, "N T _"]], times: Float[np.ndarray, "N T"], layout: Layout
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture of the sequences, one below the other, BGR.

    Raises:
        ValueError: If there is no sequence, or no player and no ball has a position.
    """
    tracks = [columns[name] for name in _positions(columns, layout)]
    if not tracks or not len(times):
        raise ValueError(f"columns: expected positions of sequences, got {', '.join(columns) or 'none'}")
    scene = load_scene(layout.scene)
    low, high = _bounds(scene, np.concatenate([track.reshape(-1, 3) for track in tracks]))
    skeletons = {player.name: player.skeleton for player in scene.players if player.skeleton is not None}
    sheet = Sheet(scene=scene, skeletons=skeletons, low=low, high=high)
    rows = [
        _sequence(sheet, {name: value[number] for name, value in columns.items()}, times[number], layout, number)
        for number in range(len(times))
    ]
    return np.concatenate(rows)


def _positions(columns: Mapping[str, np.ndarray], layout: Layout) -> list[str]:
    """Columns with a position in the world."""
    names = [f"{player}.root_position" for player in layout.players] + ["ball.position"]
    return [name for name in names if name in columns]


def _bounds(
    scene: Scene, points_world: Float[np.ndarray, "points 3"]
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Corners of what is drawn: the court and its surroundings, or where the data are."""
    if scene.court is not None:
        half = np.array(scene.court.surface_half_size)
        return np.array([*-half, -0.2]), np.array([*half, 7.0])
    finite = points_world[np.isfinite(points_world).all(axis=-1)]
    if not len(finite):
        return np.full(3, -1.0), np.full(3, 1.0)
    low, high = finite.min(axis=0) - 1.5, finite.max(axis=0) + 1.5
    return np.array([low[0], low[1], min(low[2], -0.2)]), np.array([high[0], high[1], max(high[2], 2.5)])


def _sequence(
    sheet: Sheet, columns: Mapping[str, np.ndarray], times: Float[np.ndarray, " T"], layout: Layout, number: int
) -> UInt8[np.ndarray, "h w 3"]:
    """One sequence: from above, from the side, its bodies."""
    above, side = (np.full((PANEL, PANEL, 3), GROUND, dtype=np.uint8) for _ in range(2))
    _draw_court(sheet, above, side)
    for place, player in enumerate(layout.players):
        colour = PLAYERS[place % len(PLAYERS)]
        for path in _feet(sheet, columns, player):
            draw_path(above, sheet.from_above(path), colour, 1)
        root = columns.get(f"{player}.root_position")
        if root is not None:
            draw_path(side, sheet.from_side(root), colour, 1)
            _mark_ends(above, sheet.from_above(root), colour)
    ball = columns.get("ball.position")
    if ball is not None:
        for panel, pixels in ((above, sheet.from_above(ball)), (side, sheet.from_side(ball))):
            draw_path(panel, pixels, BALL, 1)
            _mark_ends(panel, pixels, BALL)
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else float("nan")
    said = f"{number}: {len(times)} frames" + (f", {rate:.1f} a second" if np.isfinite(rate) else "")
    _say(above, said)
    _say(side, "from the side")
    strip = _bodies(sheet, columns, times, layout)
    gap = np.full((PANEL, GAP, 3), 255, dtype=np.uint8)
    row = np.concatenate([above, gap, side, gap, strip], axis=1)
    return np.concatenate([row, np.full((GAP, row.shape[1], 3), 255, dtype=np.uint8)])


def _draw_court(sheet: Sheet, above: np.ndarray, side: np.ndarray) -> None:
    """The lines on the ground, the net and the ground itself, where the scene has them."""
    court = sheet.scene.court
    if court is not None:
        draw_pieces(above, sheet.from_above(court.lines_world), COURT, 1)
        if len(court.net_world):
            draw_path(above, sheet.from_above(court.net_world), WORDS, 1)
            top = court.net_world[:1]
            draw_path(side, sheet.from_side(np.concatenate([top * [1, 1, 0], top])), WORDS, 1)
    edges = np.array([[0.0, sheet.low[1], 0.0], [0.0, sheet.high[1], 0.0]])
    draw_path(side, sheet.from_side(edges), COURT, 1)


def _feet(sheet: Sheet, columns: Mapping[str, np.ndarray], player: str) -> list[Float[np.ndarray, "T 3"]]:
    """The joints that the soles hang on, in the world; the root where there are none."""
    joints, skeleton = columns.get(f"{player}.joints"), sheet.skeletons.get(player)
    if joints is None or skeleton is None:
        root = columns.get(f"{player}.root_position")
        return [] if root is None else [root]
    feet = {int(skeleton.point_joints[skeleton.point_names.index(sole[0])]) for sole in skeleton.soles if sole}
    return [joints.reshape(len(joints), -1, 3)[:, foot] for foot in sorted(feet)]


def _mark_ends(panel: np.ndarray, pixels: Float[np.ndarray, "T 2"], colour: BGR) -> None:
    """A ring at the first place and a dot at the last."""
    found = pixels[np.isfinite(pixels).all(axis=-1)]
    if len(found):
        draw_circle(panel, found[0], 4, colour, 1)
        draw_circle(panel, found[-1], 3, colour, -1)


def _bodies(
    sheet: Sheet, columns: Mapping[str, np.ndarray], times: Float[np.ndarray, " T"], layout: Layout
) -> UInt8[np.ndarray, "h w 3"]:
    """Each player's body at a few times as seen from the side (along x), one row a player."""
    strip = np.full((PANEL, STRIP, 3), GROUND, dtype=np.uint8)
    posed = [name for name in layout.players if f"{name}.joints" in columns and name in sheet.skeletons]
    frames = np.unique(np.linspace(0, len(times) - 1, BODIES).round().astype(int))
    height = PANEL // max(len(posed), 1)
    for row, player in enumerate(posed):
        colour = PLAYERS[layout.players.index(player) % len(PLAYERS)]
        joints = columns[f"{player}.joints"].reshape(len(times), -1, 3)[frames]
        parents = sheet.skeletons[player].parents
        scale = min(height, STRIP / BODIES) / BODY_M
        across = (joints[..., 1] - joints[:, :1, 1]) * scale + (np.arange(len(frames)) + 0.5)[:, None] * STRIP / BODIES
        up = (row + 1) * height - 6 - joints[..., 2] * scale
        pixels = np.stack([across, up], axis=-1)
        bones = np.stack([pixels[:, 1:], pixels[:, parents[1:]]], axis=2)
        draw_pieces(strip, bones.reshape(-1, 2, 2), colour, 1)
        draw_path(strip, np.array([[0.0, (row + 1) * height - 6.0], [STRIP - 1.0, (row + 1) * height - 6.0]]), COURT, 1)
        if row == 0:
            for place, frame in enumerate(frames):
                _say(strip, f"{times[frame] - times[0]:.2f} s", left=round(place * STRIP / BODIES) + 4)
    return strip


def _say(panel: np.ndarray, words: str, *, left: int = 6) -> None:
    cv2.putText(panel, words, (left, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, WORDS, 1, cv2.LINE_AA)
