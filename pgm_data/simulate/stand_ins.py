"""Courts of sports that are not played here: cameras with exact truth before two silhouettes that run about."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from pgm_data.scene import Scene
from pgm_data.simulate.broadcast import REPEAT_EVERY, Clock, Span
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.pictures.finish import Finish, draw_finish, finished
from pgm_data.simulate.pictures.negative import Props, draw_close_up, draw_props
from pgm_data.simulate.pictures.picture import Canvas, draw_picture
from pgm_data.simulate.pictures.shapes import in_pieces, stacked
from pgm_data.simulate.pictures.world import World, area_of, draw_world
from pgm_data.simulate.play import camera_course, draw_movers
from pgm_data.simulate.shots import Graphics, SimulatedShot, no_cameras
from pgm_data.simulate.views import Pose, View, broadcast_pose, track_of

PIECE_M = 2.0
NO_GRAPHICS = Graphics(shutter_s=None, ui_boxes_px=())


def court_shots(scene: Scene, options: ClipOptions, seed: int) -> Iterator[SimulatedShot]:
    """The shots of a video of the scene's court; nobody is on it if the scene has no players.

    Raises:
        ValueError: If the scene has no court to draw.
    """
    area_of(scene)
    court = scene.court
    assert court is not None
    size = (options.width, options.height)
    clock = Clock(fps=options.fps, repeats=options.duplicates)
    whole = clock.span(0, options.frames)
    course_rng = np.random.default_rng([seed, 0])
    base = broadcast_pose(course_rng, court, size, cropped=options.cropped)
    poses = camera_course(course_rng, base, options.motion, whole.capture_times, options.width)
    stage = _Stage(scene, options, seed, base)
    close = _close_spans(course_rng, options)
    edges = [0, *(np.flatnonzero(np.diff(close.astype(int))) + 1).tolist(), options.frames]
    for first, stop in zip(edges[:-1], edges[1:], strict=True):
        away = bool(close[first])
        part = slice(first, stop)
        views = [None if away else pose.view(size) for pose in poses[part]]
        span = Span(
            first=first,
            timestamps=whole.timestamps[part],
            capture_times=whole.capture_times[part],
            is_duplicate=whole.is_duplicate[part],
        )
        yield SimulatedShot(
            kind="away" if away else "clip",
            first_frame=first,
            timestamps=span.timestamps,
            capture_times=span.capture_times,
            is_duplicate=span.is_duplicate,
            track=no_cameras(stop - first) if away else track_of(views),
            states=None,
            graphics=NO_GRAPHICS,
            drawn=lambda first, span=span, views=views: stage.pictures(span, views, first),
            masks=None,
        )


class _Stage:
    """Draws one event's pictures; built when the first is asked for."""

    def __init__(self, scene: Scene, options: ClipOptions, seed: int, base: Pose) -> None:
        self._scene, self._options, self._seed, self._base = scene, options, seed, base
        self._props: Props | None = None

    def _build(self) -> Props:
        options, scene, base = self._options, self._scene, self._base
        size = (options.width, options.height)
        rng = np.random.default_rng([self._seed, 1])
        props = draw_props(rng, scene, *size, count=3)
        self._canvas = Canvas(*size, fine=options.quality == "full")
        others = [s.court for s in props.others if s.court is not None]
        peopled = bool(scene.players)
        args = (scene, others, props.textures, props.cast, base.centre_world)
        world = draw_world(rng, *args, hard=False, players=False, people=peopled)
        if self._canvas.fine:
            world = replace(world, lines=in_pieces(world.lines, PIECE_M), tape=in_pieces(world.tape, PIECE_M))
        self._world = world
        self._movers = draw_movers(rng, props.cast, *area_of(scene)) if peopled else ()
        self._finish: Finish = draw_finish(rng, *size, hard=False)
        self._thrown, self._strength = rng.normal(0, 0.6, 2), float(rng.uniform(0.1, 0.5))
        return props

    def pictures(self, span: Span, views: list[View | None], first: int) -> Iterator[np.ndarray]:
        """The pictures of one shot from its frame `first` on."""
        if self._props is None:
            self._props = self._build()
        props = self._props
        away: np.ndarray | None = None
        picture: np.ndarray | None = None
        for i in range(first, len(views)):
            view, frame = views[i], span.first + i
            if not span.is_duplicate[i] or picture is None:
                time = float(span.capture_times[i])
                if view is None:
                    if away is None:
                        away = draw_close_up(np.random.default_rng([self._seed, 2, span.first]), props).copy()
                    picture = self._flawed(_shaken(away, time), frame)
                else:
                    now = self._with_movers(self._world, time)
                    picture = self._flawed(draw_picture(self._canvas, now, view, props.textures.noise), frame)
            yield picture

    def _flawed(self, picture: np.ndarray, frame: int) -> np.ndarray:
        assert self._props is not None
        if self._options.clean:
            return np.clip(picture + np.float32(0.5), 0, 255).astype(np.uint8)
        # The noise field moves by steps that do not repeat within a second.
        grain = self._props.textures.grain[self._finish.noise_kind]
        return finished(picture, self._finish, grain, (frame * 29 % 64, frame * 47 % 64))

    def _with_movers(self, world: World, time: float) -> World:
        if not self._movers:
            return world
        near, far = self._movers
        centre = self._base.centre_world
        shadows = [world.shadows, *(m.shadow(time, self._thrown, self._strength) for m in self._movers)]
        return replace(
            world,
            shadows=stacked(shadows),
            behind=stacked([world.behind, far.shapes(time, centre)]),
            front=stacked([world.front, near.shapes(time, centre)]),
        )


def _close_spans(rng: np.random.Generator, options: ClipOptions) -> np.ndarray:
    """Which frames belong to shots without the court: 1.5 to 5 s long, 8 to 25 s apart; first comes the court."""
    close = np.zeros(options.frames, bool)
    if not options.closeups:
        return close
    at = 0
    while at < options.frames:
        at += max(1, int(rng.uniform(8.0, 25.0) * options.fps))
        stop = at + max(1, int(rng.uniform(1.5, 5.0) * options.fps))
        # A cut falls between two distinct pictures.
        at, stop = (-(-v // REPEAT_EVERY) * REPEAT_EVERY for v in (at, stop))
        close[at:stop] = True
        at = stop
    return close


def _shaken(picture: np.ndarray, time: float) -> np.ndarray:
    """A close-up moved slowly, so that its frames differ."""
    height, width = picture.shape[:2]
    shift = 0.01 * width * np.array([np.sin(1.9 * time), np.sin(1.3 * time + 1.0)])
    zoom = 1.06 + 0.02 * np.sin(0.7 * time)
    middle = np.array([width - 1, height - 1]) / 2
    move = np.array([[zoom, 0, middle[0] * (1 - zoom) + shift[0]], [0, zoom, middle[1] * (1 - zoom) + shift[1]]])
    return cv2.warpAffine(picture, move, (width, height), borderMode=cv2.BORDER_REPLICATE)
