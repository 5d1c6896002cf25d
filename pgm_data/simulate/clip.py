"""Clips of one event with exact truth, drawn straight into memory."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from pgm_data.scene import Scene
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.pictures.finish import Finish, draw_finish, finished
from pgm_data.simulate.pictures.negative import Props, draw_close_up, draw_props
from pgm_data.simulate.pictures.picture import Canvas, draw_picture
from pgm_data.simulate.pictures.shapes import in_pieces, stacked
from pgm_data.simulate.pictures.world import World, area_of, draw_world
from pgm_data.simulate.play import Motion, camera_course, draw_movers
from pgm_data.simulate.views import Pose, View, broadcast_pose, track_of

REPEAT_EVERY = 6
"""With `duplicates`, the last of so many frames repeats the one before it."""
PIECE_M = 2.0


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipOptions:
    """What a simulated clip is like. Raises ValueError for values out of range."""

    frames: int = 250
    width: int = 1280
    height: int = 720
    fps: float = 25.0
    """Frames per second as presented."""
    motion: Motion = "any"
    """Camera: `still`, `drift` (a few pixels), `follow` (pans and zooms), or one of them by lot."""
    duplicates: bool = False
    """Every sixth frame repeats the one before, as after a rate conversion."""
    closeups: bool = False
    """Cut to shots without the court now and then."""
    cropped: bool = False
    """The picture is a part of a larger one: the principal point is off its centre."""
    clean: bool = False
    """No blur, noise or graphics."""
    quality: Literal["draft", "full"] = "full"
    """`draft` paints thin lines by square pixels, which moves their centres locally by up to 0.3 px."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, low, high in (
            ("frames", 1, 10_000_000),
            ("width", 64, 7680),
            ("height", 36, 4320),
            ("fps", 1.0, 240.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"ClipOptions.{name}: expected {low} to {high}, got {value}")
        for name, allowed in (("motion", ("any", "still", "drift", "follow")), ("quality", ("draft", "full"))):
            if getattr(self, name) not in allowed:
                raise ValueError(
                    f"ClipOptions.{name}: expected one of {', '.join(allowed)}, got {getattr(self, name)!r}"
                )


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedClip:
    """One video's truth, and the way to its pictures."""

    scene: Scene
    width: int
    height: int
    track: CameraTrack
    """The true cameras; NaN in shots that do not show the court."""
    timestamps: Float[np.ndarray, " frames"]
    """Presentation times, s."""
    capture_times: Float[np.ndarray, " frames"]
    """When each picture was taken, s; a repeat has its source's."""
    is_duplicate: Bool[np.ndarray, " frames"]
    drawn: Callable[[], Iterator[UInt8[np.ndarray, "height width 3"]]]

    def frames(self) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
        """The pictures, BGR, in order; every call draws the same ones anew."""
        return self.drawn()

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.timestamps)


def simulate_clip(scene: Scene, options: ClipOptions, seed: int) -> SimulatedClip:
    """A clip that depends on its arguments alone.

    Raises:
        ValueError: If the scene has no court to draw.
    """
    half_x, half_y, floor_z = area_of(scene)
    court = scene.court
    assert court is not None
    size = (options.width, options.height)
    timestamps = np.arange(options.frames) / options.fps
    taken, is_duplicate = _taken(options)
    capture_times = taken * (REPEAT_EVERY / (REPEAT_EVERY - 1) if options.duplicates else 1.0) / options.fps
    course_rng = np.random.default_rng([seed, 0])
    base = broadcast_pose(course_rng, court, size, cropped=options.cropped)
    poses = camera_course(course_rng, base, options.motion, capture_times, options.width)
    close = _close_spans(course_rng, options)
    views: list[View | None] = [None if c else p.view(size) for c, p in zip(close, poses, strict=True)]

    def draw() -> Iterator[np.ndarray]:
        rng = np.random.default_rng([seed, 1])
        props = draw_props(rng, scene, *size, count=3)
        canvas = Canvas(*size, fine=options.quality == "full")
        others = [s.court for s in props.others if s.court is not None]
        args = (scene, others, props.textures, props.cast, base.centre_world)
        world = draw_world(rng, *args, hard=False, players=False)
        if canvas.fine:
            world = replace(world, lines=in_pieces(world.lines, PIECE_M), tape=in_pieces(world.tape, PIECE_M))
        movers = draw_movers(rng, props.cast, half_x, half_y, floor_z)
        finish = draw_finish(rng, *size, hard=False)
        camera = _Camera(props, canvas, finish, clean=options.clean)
        thrown, strength = rng.normal(0, 0.6, 2), float(rng.uniform(0.1, 0.5))
        picture: np.ndarray | None = None
        away: np.ndarray | None = None
        for frame, view in enumerate(views):
            if not is_duplicate[frame] or picture is None:
                time = float(capture_times[frame])
                if view is None:
                    if away is None:
                        away = draw_close_up(np.random.default_rng([seed, 2, frame]), props).copy()
                    picture = camera.flawed(_shaken(away, time), frame)
                else:
                    away = None
                    now = _with_movers(world, movers, time, base, thrown, strength)
                    picture = camera.flawed(draw_picture(canvas, now, view, props.textures.noise), frame)
            yield picture

    return SimulatedClip(
        scene=scene,
        width=options.width,
        height=options.height,
        track=track_of(views),
        timestamps=timestamps,
        capture_times=capture_times,
        is_duplicate=is_duplicate,
        drawn=draw,
    )


class _Camera:
    """Puts one recording's flaws on every picture."""

    def __init__(self, props: Props, canvas: Canvas, finish: Finish, *, clean: bool) -> None:
        self._grain = props.textures.grain[finish.noise_kind]
        self._finish, self._clean = finish, clean

    def flawed(self, picture: np.ndarray, frame: int) -> np.ndarray:
        if self._clean:
            return np.clip(picture + np.float32(0.5), 0, 255).astype(np.uint8)
        # The noise field moves by steps that do not repeat within a second.
        return finished(picture, self._finish, self._grain, (frame * 29 % 64, frame * 47 % 64))


def _taken(options: ClipOptions) -> tuple[np.ndarray, np.ndarray]:
    """Number of the distinct picture that each frame shows, and whether it repeats the frame before."""
    index = np.arange(options.frames)
    if not options.duplicates:
        return index, np.zeros(options.frames, bool)
    repeat = index % REPEAT_EVERY == REPEAT_EVERY - 1
    return np.cumsum(~repeat) - 1, repeat


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


def _with_movers(world: World, movers, time: float, base: Pose, thrown: np.ndarray, strength: float) -> World:
    near, far = movers
    shadows = [world.shadows, *(m.shadow(time, thrown, strength) for m in movers)]
    return replace(
        world,
        shadows=stacked(shadows),
        behind=stacked([world.behind, far.shapes(time, base.centre_world)]),
        front=stacked([world.front, near.shapes(time, base.centre_world)]),
    )


def _shaken(picture: np.ndarray, time: float) -> np.ndarray:
    """A close-up moved slowly, so that its frames differ."""
    height, width = picture.shape[:2]
    shift = 0.01 * width * np.array([np.sin(1.9 * time), np.sin(1.3 * time + 1.0)])
    zoom = 1.06 + 0.02 * np.sin(0.7 * time)
    middle = np.array([width - 1, height - 1]) / 2
    move = np.array([[zoom, 0, middle[0] * (1 - zoom) + shift[0]], [0, zoom, middle[1] * (1 - zoom) + shift[1]]])
    return cv2.warpAffine(picture, move, (width, height), borderMode=cv2.BORDER_REPLICATE)
