"""Pictures that show no court of the scene: crowds, close-ups, graphics, other sports, clutter."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.scene import Scene, load_scene, scene_names
from pgm_data.simulate.pictures.bystanders import muted
from pgm_data.simulate.pictures.finish import draw_finish, draw_overlay, finished
from pgm_data.simulate.pictures.foreign import foreign_lines
from pgm_data.simulate.pictures.people import Cast, by_distance, draw_cast, placed
from pgm_data.simulate.pictures.picture import Canvas, draw_over, draw_picture
from pgm_data.simulate.pictures.shapes import polygons
from pgm_data.simulate.pictures.textures import Textures, draw_textures
from pgm_data.simulate.pictures.world import draw_world
from pgm_data.simulate.views import any_view, framed_pose, points_in_picture

CLOSE_UP_POINTS = 2
"""Most crossings of the court that a close-up may show."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Props:
    """What one stream of pictures draws from, and the buffers it draws into."""

    textures: Textures
    cast: Cast
    canvas: Canvas
    scene: Scene
    others: tuple[Scene, ...]
    """Scenes whose courts may be drawn where the scene's own must not be seen."""


def draw_props(rng: np.random.Generator, scene: Scene, width: int, height: int, *, count: int = 12) -> Props:
    """New props for pictures of this scene and size; `count` crowds, and of the rest in proportion."""
    courts = (load_scene(name) for name in scene_names() if name != scene.name)
    return Props(
        textures=draw_textures(rng, (height, width), count),
        cast=draw_cast(rng, 4 * count),
        canvas=Canvas(width, height),
        scene=scene,
        others=tuple(s for s in courts if s.court is not None),
    )


@lru_cache(maxsize=2)
def _own_props(width: int, height: int) -> Props:
    return draw_props(np.random.default_rng(0), load_scene("tennis"), width, height)


def draw_negative(
    rng: np.random.Generator, width: int, height: int, props: Props | None = None
) -> UInt8[np.ndarray, "height width 3"]:
    """A finished picture without a court of the props' scene (tennis unless given), BGR.

    Raises:
        ValueError: If the props are of another picture size.
    """
    props = _own_props(width, height) if props is None else props
    if (props.canvas.width, props.canvas.height) != (width, height):
        raise ValueError(
            f"draw_negative.props: expected buffers of {width}x{height}, got {props.canvas.width}x{props.canvas.height}"
        )
    kinds = (draw_crowd, draw_close_up, _other, _clutter, _graphics, _bare)
    picture = kinds[int(rng.choice(6, p=[0.15, 0.3, 0.2, 0.12, 0.1, 0.13]))](rng, props)
    finish = draw_finish(rng, width, height, hard=True)
    grain = props.textures.grain[finish.noise_kind]
    return finished(picture, finish, grain, (int(rng.integers(0, 64)), int(rng.integers(0, 64))))


def _courts(scenes: Sequence[Scene]) -> list:
    return [s.court for s in scenes if s.court is not None]


def _enlarged(rng, texture: np.ndarray, width: int, height: int) -> np.ndarray:
    zoom = np.exp(rng.uniform(np.log(0.35), np.log(6.0)))
    wide, tall = min(int(width / zoom), texture.shape[1] - 1), min(int(height / zoom), texture.shape[0] - 1)
    wide, tall = max(wide, 16), max(tall, 9)
    x, y = int(rng.integers(0, texture.shape[1] - wide)), int(rng.integers(0, texture.shape[0] - tall))
    part = texture[y : y + tall, x : x + wide]
    return cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)


def draw_crowd(rng: np.random.Generator, props: Props) -> Float[np.ndarray, "height width 3"]:
    """Spectators, or trees, that fill the picture."""
    pool = props.textures.crowds if rng.random() < 0.75 else props.textures.foliage
    return _enlarged(rng, pool[int(rng.integers(len(pool)))], props.canvas.width, props.canvas.height)


def _graphics(rng, props: Props) -> np.ndarray:
    width, height = props.canvas.width, props.canvas.height
    picture = np.full((height, width, 3), muted(rng), np.uint8)
    for _ in range(int(rng.integers(2, 25))):
        x, y = int(rng.integers(-20, width)), int(rng.integers(-20, height))
        size = rng.integers(4, [width // 2, height // 3])
        thick = -1 if rng.random() < 0.6 else int(rng.integers(1, 4))
        cv2.rectangle(picture, (x, y), (x + int(size[0]), y + int(size[1])), muted(rng).tolist(), thick)
    for _ in range(3):
        paint, opacity = draw_overlay(rng, width, height, hard=True)
        picture = (picture * (1 - opacity) + paint * opacity).astype(np.uint8)
    return picture.astype(np.float32)


def _clutter(rng, props: Props) -> np.ndarray:
    """Straight lines of all sorts over anything."""
    width, height = props.canvas.width, props.canvas.height
    picture = draw_crowd(rng, props) if rng.random() < 0.4 else _bare(rng, props).copy()
    base = np.clip(picture, 0, 255).astype(np.uint8)
    for _ in range(int(rng.integers(3, 30))):
        ends = rng.integers(0, [width, height], (2, 2))
        if rng.random() < 0.5:
            ends[1] = ends[0] + rng.integers(-90, 90, 2)
        colour = np.full(3, rng.uniform(170, 255)) if rng.random() < 0.6 else muted(rng)
        start, end = ends.tolist()
        cv2.line(base, start, end, colour.tolist(), int(rng.integers(1, 4)), cv2.LINE_AA)
    return base.astype(np.float32)


def _bare(rng, props: Props) -> np.ndarray:
    """A ground without the court: nothing on it, or only foreign lines, with or without a net."""
    court = props.scene.court
    assert court is not None
    size = (props.canvas.width, props.canvas.height)
    view = any_view(rng, court, size)
    world = draw_world(rng, props.scene, [], props.textures, props.cast, view.centre_world, hard=True)
    shapes = foreign_lines(rng, _courts(props.others), 1.0) if rng.random() < 0.5 else []
    nothing = polygons([])
    ground = polygons([(world.ground.corners[:4], world.ground.colours[0], 1.0)])
    world = replace(world, lines=nothing, foreign=polygons(shapes), ground=ground)
    if rng.random() < 0.8:
        world = replace(world, net=nothing, tape=nothing, net_words=())
    return draw_picture(props.canvas, world, view, props.textures.noise)


def _other(rng, props: Props) -> np.ndarray:
    """The court of another sport, framed as that sport is."""
    if not props.others:
        return _bare(rng, props)
    scene = props.others[int(rng.integers(len(props.others)))]
    assert scene.court is not None
    size = (props.canvas.width, props.canvas.height)
    view = any_view(rng, scene.court, size)
    world = draw_world(rng, scene, [], props.textures, props.cast, view.centre_world, hard=True)
    return draw_picture(props.canvas, world, view, props.textures.noise)


def draw_close_up(rng: np.random.Generator, props: Props) -> Float[np.ndarray, "height width 3"]:
    """One or two people filling the picture before a blurred background."""
    court = props.scene.court
    assert court is not None
    width, height = props.canvas.width, props.canvas.height
    far = rng.uniform(7.0, 22.0)
    aim = np.array([rng.uniform(-6, 6), rng.uniform(-9, 9), rng.uniform(0.6, 1.6)])
    angle = rng.uniform(-1.3, 1.3)
    centre = aim + np.array([far * np.sin(angle), -far * np.cos(angle), rng.uniform(0.2, 2.5)])
    tall = rng.uniform(1.0, 3.0)
    view = framed_pose(
        centre_world=centre,
        aim_world=aim,
        aim_px=(width * rng.uniform(0.3, 0.7), height * rng.uniform(0.4, 0.7)),
        roll=0.0,
        focal_px=float(height * far / tall),
        principal_px=((width - 1) / 2, (height - 1) / 2),
        k=float(rng.uniform(0, 0.03)),
    ).view((width, height))
    world = draw_world(rng, props.scene, [], props.textures, props.cast, centre, hard=True)
    nothing = polygons([])
    keeps_lines, has_net = rng.random() < 0.25, rng.random() < 0.3
    # With more crossings in view the court could be placed, and no camera found there would be a false one.
    keeps_lines = keeps_lines and points_in_picture(court, view, (width, height)) <= CLOSE_UP_POINTS
    world = replace(
        world,
        behind=nothing,
        front=nothing,
        net=world.net if has_net else nothing,
        tape=world.tape if has_net else nothing,
        net_words=(),
        lines=world.lines if keeps_lines else nothing,
    )
    back = draw_picture(props.canvas, world, view, props.textures.noise).copy()
    if rng.random() < 0.7:
        back = cv2.GaussianBlur(back, (0, 0), float(rng.uniform(0.8, 8.0)))
    people = []
    for _ in range(int(rng.integers(1, 4))):
        figure = props.cast.playing[int(rng.integers(len(props.cast.playing)))]
        foot = np.array([aim[0], aim[1], 0.0]) + np.array([rng.normal(0, 0.6 * tall), rng.normal(0, 0.5), 0.0])
        clothes = np.stack([muted(rng), muted(rng), np.array([115.0, 150.0, 200.0]) * rng.uniform(0.3, 1.15)])
        flipped = bool(rng.random() < 0.5)
        people.append((float(np.linalg.norm(foot - centre)), placed(figure, foot, centre, clothes, flipped=flipped)))
    return draw_over(props.canvas, back, by_distance(people), view)
