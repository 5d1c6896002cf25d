"""A tennis match as a broadcast shows it: plays, cuts away, a camera that follows, and the truth of every frame."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pgm_data.scene import Scene
from pgm_data.simulate.broadcast import Clock, Operator, Span, cuts, draw_operator, main_pose, poses_of
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.shots import Graphics, SimulatedShot, later, no_cameras, until
from pgm_data.simulate.tennis.match import Match, draw_match, plays
from pgm_data.simulate.tennis.pictures import MatchPictures
from pgm_data.simulate.tennis.play import Play
from pgm_data.simulate.tennis.truth import play_states
from pgm_data.simulate.views import Pose, View, track_of

# One stream of random numbers for each thing, so that more of one does not change another.
CAMERA, LOOKS, MATCH, PLAYS, WORDS, CUTS, SHUTTER = 0, 1, 10, 11, 12, 13, 14


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """How one match is recorded."""

    scene: Scene
    options: ClipOptions
    seed: int
    match: Match
    base: Pose
    operator: Operator
    shutter_s: float
    """Exposure, s; 0 for none."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.options.width, self.options.height


def tennis_shots(scene: Scene, options: ClipOptions, seed: int) -> Iterator[SimulatedShot]:
    """The shots of a match in order, one in memory at a time; they depend on the arguments alone."""
    recording = recording_of(scene, options, seed)
    clock = Clock(fps=options.fps, repeats=options.duplicates)
    pictures = MatchPictures(recording)
    played = plays(recording.match, np.random.default_rng([seed, PLAYS]))
    last: Play | None = None
    rng = np.random.default_rng([seed, CUTS])
    for span, play in cuts(rng, played, clock, options.frames, closeups=options.closeups):
        if play is None:
            assert last is not None
            yield _away(recording, pictures, span, last)
        else:
            yield _clip(recording, pictures, clock, span, play)
            last = play


def recording_of(scene: Scene, options: ClipOptions, seed: int) -> Recording:
    """How the match of this seed is recorded."""
    court = scene.court
    assert court is not None
    size = (options.width, options.height)
    rng = np.random.default_rng([seed, CAMERA])
    base = main_pose(rng, court, size, cropped=options.cropped)
    share = options.shutter
    if share is None:
        # 1/1000 to 1/100 s, as sports are filmed, if the frame rate leaves so much.
        exposure = float(np.exp(np.random.default_rng([seed, SHUTTER]).uniform(np.log(1e-3), np.log(1e-2))))
        share = min(exposure * options.fps, 1.0)
    wind = None if options.wind_ms is None else np.array([*options.wind_ms, 0.0])
    match = draw_match(
        np.random.default_rng([seed, MATCH]), scene, name=f"sim{seed}", surface=options.surface, wind=wind
    )
    clock = Clock(fps=options.fps, repeats=options.duplicates)
    return Recording(
        scene=scene,
        options=options,
        seed=seed,
        match=match,
        base=base,
        operator=draw_operator(rng, options.motion, options.width),
        shutter_s=share / clock.pictures_per_s,
    )


def _clip(recording: Recording, pictures: MatchPictures, clock: Clock, span: Span, play: Play) -> SimulatedShot:
    start = float(span.capture_times[0])
    times = span.capture_times - start
    poses = poses_of(recording.operator, recording.base, play, times, start)
    views = [pose.view(recording.size) for pose in poses]
    # A play shown to its end is told to its end, which lies within a frame of the last picture.
    whole = len(times) >= clock.frames_of(play.duration_s)
    states = play_states(play, times, np.random.default_rng([recording.seed, WORDS, play.number]))
    exposure = Graphics(
        shutter_s=recording.shutter_s if recording.shutter_s > 0 else None,
        ui_boxes_px=() if recording.options.clean else pictures.overlay_of(play).boxes,
    )
    return SimulatedShot(
        kind="clip",
        first_frame=span.first,
        timestamps=span.timestamps,
        capture_times=span.capture_times,
        is_duplicate=span.is_duplicate,
        track=track_of(list[View | None](views)),
        states=later(states if whole else until(states, float(times[-1])), start),
        graphics=exposure,
        drawn=lambda first: pictures.play(play, span.after(first), times[first:], views[first:]),
        masks=lambda: pictures.masks(play, times, views),
    )


def _away(recording: Recording, pictures: MatchPictures, span: Span, play: Play) -> SimulatedShot:
    return SimulatedShot(
        kind="away",
        first_frame=span.first,
        timestamps=span.timestamps,
        capture_times=span.capture_times,
        is_duplicate=span.is_duplicate,
        track=no_cameras(len(span.timestamps)),
        states=None,
        graphics=Graphics(shutter_s=None, ui_boxes_px=()),
        drawn=lambda first: pictures.away(play, span, first),
        masks=None,
    )
