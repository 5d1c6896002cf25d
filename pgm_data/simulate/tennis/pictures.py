"""The pictures of one match: a court with its people, drawn frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np

from pgm_data.simulate.body.figure import world_from_joints
from pgm_data.simulate.broadcast import Span
from pgm_data.simulate.closeups import draw_cut_away
from pgm_data.simulate.pictures.ball_streak import exposure
from pgm_data.simulate.pictures.finish import Finish, draw_finish, finished
from pgm_data.simulate.pictures.negative import Props, draw_crowd, draw_props
from pgm_data.simulate.pictures.scoreboard import BoardLines, BoardStyle, Overlay, draw_board_style, draw_overlay_of
from pgm_data.simulate.pictures.stage import Actor, BallSeen, Moment, Stage, draw_stage
from pgm_data.simulate.pictures.world import Surface
from pgm_data.simulate.shots import Masks
from pgm_data.simulate.tennis.play import Play
from pgm_data.simulate.tennis.truth import ball_at, body_of
from pgm_data.simulate.views import View

if TYPE_CHECKING:
    from pgm_data.simulate.tennis.film import Recording

BLOCK = 64
"""Frames whose bodies are posed together."""
EXPOSURES = 3
"""Moments of an exposure at which bodies are posed."""
SURFACES: dict[str, Surface] = {"hard": "firm", "clay": "clay", "grass": "grass"}


class MatchPictures:
    """Draws one match; what it needs is built when the first picture is asked for."""

    def __init__(self, recording: "Recording") -> None:
        self._recording = recording

    @cached_property
    def _props(self) -> Props:
        rng = np.random.default_rng([self._recording.seed, 1])
        return draw_props(rng, self._recording.scene, *self._recording.size, count=3)

    @cached_property
    def stage(self) -> Stage:
        """Court, people and light."""
        recording = self._recording
        rng = np.random.default_rng([recording.seed, 2])
        return draw_stage(
            rng,
            recording.scene,
            self._props,
            recording.base.centre_world,
            figures=tuple(athlete.figure for athlete in recording.match.athletes),
            surface=SURFACES[recording.match.world.surface.name],
            fine=recording.options.quality == "full",
        )

    @cached_property
    def _finish(self) -> Finish:
        rng = np.random.default_rng([self._recording.seed, 3])
        return replace(draw_finish(rng, *self._recording.size, hard=False), overlay=None)

    @cached_property
    def _board(self) -> BoardStyle:
        return draw_board_style(np.random.default_rng([self._recording.seed, 4]))

    def overlay_of(self, play: Play) -> Overlay:
        """The graphics over a play's pictures."""
        serving = play.identities[play.server]
        lines = BoardLines(sets=play.score.sets, points=play.score.points, serving=serving)
        return draw_overlay_of(self._board, lines, self._recording.size)

    def play(self, play: Play, span: Span, times: np.ndarray, views: Sequence[View]) -> Iterator[np.ndarray]:
        """The pictures of a play at these times of it, uint8 BGR."""
        overlay = self.overlay_of(play)
        finish = replace(self._finish, overlay=(overlay.paint, overlay.opacity))
        moments = self.moments(play, times, self._recording.shutter_s)
        yield from self._drawn(span, views, moments, finish)

    def away(self, play: Play, span: Span, first: int) -> Iterator[np.ndarray]:
        """The pictures of a cut away after a play from its frame `first` on, uint8 BGR."""
        recording = self._recording
        rng = np.random.default_rng([recording.seed, 5, span.first])
        seconds = span.capture_times - span.capture_times[0]
        court = recording.scene.court
        assert court is not None
        shown = draw_cut_away(rng, play, recording.base, court, recording.size, seconds)
        if shown is None:
            crowd = draw_crowd(rng, self._props)
            for i in range(first, len(seconds)):
                closer = _closer(crowd, 1.02 + 0.012 * float(seconds[i]))
                yield self._flawed(closer, span.first + i, self._finish)
            return
        moments = self.moments(play, shown.times[first:], recording.shutter_s)
        yield from self._drawn(
            span.after(first), shown.views[first:], moments, self._finish, haze_px=shown.haze * recording.size[0]
        )

    def masks(self, play: Play, times: np.ndarray, views: Sequence[View]) -> Iterator[Masks]:
        """Labels and depth of the same frames, at the middle of each exposure."""
        for view, moment in zip(views, self.moments(play, times, 0.0), strict=True):
            yield self.stage.masks(view, moment)

    def _drawn(
        self, span: Span, views: Sequence[View], moments: Iterator[Moment], finish: Finish, *, haze_px: float = 0.0
    ) -> Iterator[np.ndarray]:
        picture: np.ndarray | None = None
        for i, (view, moment) in enumerate(zip(views, moments, strict=True)):
            if picture is None or not span.is_duplicate[i]:
                picture = self._flawed(self.stage.picture(view, moment, haze_px=haze_px), span.first + i, finish)
            yield picture

    def _flawed(self, picture: np.ndarray, frame: int, finish: Finish) -> np.ndarray:
        if self._recording.options.clean:
            return np.clip(picture + np.float32(0.5), 0, 255).astype(np.uint8)
        # The noise field moves by steps that do not repeat within a second.
        grain = self._props.textures.grain[finish.noise_kind]
        return finished(picture, finish, grain, (frame * 29 % 64, frame * 47 % 64))

    def moments(self, play: Play, times: np.ndarray, shutter_s: float) -> Iterator[Moment]:
        """What stands where in every frame, over its exposure."""
        count = EXPOSURES if shutter_s > 0 else 1
        shares = (np.arange(count) + 0.5) / count - 0.5
        for first in range(0, len(times), BLOCK):
            block = times[first : first + BLOCK]
            at = (block[:, None] + shutter_s * shares).ravel()
            bodies = [self._posed(play, player, at) for player in (0, 1)]
            middles = ball_at(play, block)[0]
            for i, time in enumerate(block):
                part = slice(i * count, (i + 1) * count)
                yield Moment(
                    actors=tuple(
                        Actor(person=play.identities[player], label=player, R_world=R[part], t_world=t[part])
                        for player, (R, t) in enumerate(bodies)
                    ),
                    ball=_ball_seen(play, float(time), shutter_s, middles[i]),
                )

    def _posed(self, play: Play, player: int, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        track = body_of(play, player, times)
        return world_from_joints(play.athletes[player].figure, track.root_position, track.rotations)


def _closer(picture: np.ndarray, zoom: float) -> np.ndarray:
    """The picture as a lens that zooms in about its middle shows it."""
    height, width = picture.shape[:2]
    moved = np.array([[zoom, 0.0, 0.5 * (1.0 - zoom) * (width - 1)], [0.0, zoom, 0.5 * (1.0 - zoom) * (height - 1)]])
    return cv2.warpAffine(picture, moved, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _ball_seen(play: Play, time: float, shutter_s: float, middle: np.ndarray) -> BallSeen | None:
    """The ball while the shutter is open about a time; None where it is gone."""
    if not np.isfinite(middle).all():
        return None
    start = time - 0.5 * shutter_s
    if shutter_s == 0.0 or start < play.ball.contacts[0].time:
        # In the hand it moves little enough for one place.
        return BallSeen(positions=middle[None], shares=np.zeros(0), middle=middle)
    positions, shares = exposure(play.ball, start, time + 0.5 * shutter_s)
    return BallSeen(positions=positions, shares=shares, middle=middle)
