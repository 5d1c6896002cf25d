"""Empty courts to put people on: pictures of simulated worlds with their cameras, light and room for officials."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from pgm_data.dataset.files import whole_file
from pgm_data.scene import Scene
from pgm_data.simulate.pictures.body_mesh import Light
from pgm_data.simulate.pictures.finish import draw_overlay
from pgm_data.simulate.pictures.negative import Props, draw_props
from pgm_data.simulate.pictures.picture import draw_picture
from pgm_data.simulate.pictures.stage import light_of
from pgm_data.simulate.pictures.world import World, draw_world
from pgm_data.simulate.views import View, any_view, broadcast_pose
from pgm_models.detectors.clip_pictures import Pictures, keep_pictures

SIZE = (1280, 720)
"""Width and height of the pictures, px."""
PROPS_FOR = 12
"""Worlds that share textures."""
HARD = 0.35
"""Share of worlds that are worn, crowded and cluttered."""
BROADCAST = 0.8
"""Share of worlds seen from behind the near end; the others from anywhere."""
OVERLAID = 0.3
"""Share of pictures with graphics over them."""
MOST_LIGHTS = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class Backdrop:
    """One empty court."""

    view: View
    light: Light
    thrown: tuple[tuple[np.ndarray, float], ...]
    """Every light's shadow: ground vector per metre of height, and strength."""
    walls: tuple[float, float]
    """Half width and half length between the hoardings, metres."""
    seat: np.ndarray | None
    """Of the umpire's high chair, world metres; None without one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Backdrops:
    """Empty courts; the pictures stay on disk."""

    pictures: Pictures
    each: tuple[Backdrop, ...]
    """One a picture."""
    views: int
    """Pictures that follow each other and show the same world."""


def prepare_backdrops(
    cache: Path, scene: Scene, *, worlds: int, views: int, seed: int, show: Callable[[str], None] = lambda line: None
) -> Backdrops:
    """Empty courts by lot, drawn once and kept under `cache`; what is there is read the next time.

    Raises:
        ValueError: If the scene has no court, or `cache` holds pictures drawn with other options.
    """
    about, jpegs = cache / "backdrops.npz", cache / "backdrops.jpegs"
    wanted = np.array([worlds, views, seed])
    if not about.exists():
        rows: list[dict[str, np.ndarray]] = []
        offsets = keep_pictures(jpegs, _drawn(scene, worlds, views, seed, rows, show))
        table = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
        with whole_file(about) as temporary, temporary.open("wb") as file:
            np.savez(file, offsets=offsets, wanted=wanted, **table)  # pyright: ignore[reportArgumentType] savez takes names by keyword
    with np.load(about) as kept:
        if not np.array_equal(kept["wanted"], wanted):
            raise ValueError(
                f"{about}: expected {worlds} worlds of {views} views and seed {seed}, found {kept['wanted'].tolist()}"
            )
        table = {name: kept[name] for name in kept.files}
    each = tuple(_backdrop({name: table[name][i] for name in ROW}) for i in range(worlds * views))
    return Backdrops(pictures=Pictures(jpegs=jpegs, offsets=table["offsets"]), each=each, views=views)


ROW = ("K", "k1", "R", "centre", "light", "rim", "thrown", "walls", "seat")


def _row(view: View, world: World) -> dict[str, np.ndarray]:
    light = light_of(world)
    thrown = np.full((MOST_LIGHTS, 3), np.nan)
    for i, (vector, strength) in enumerate(world.thrown[:MOST_LIGHTS]):
        thrown[i] = [*vector, strength]
    values = (
        view.K,
        np.array(view.k1),
        view.R_cam_from_world,
        view.centre_world,
        np.stack([light.towards_sun, light.sun, light.sky, light.ground]),
        np.array(light.rim),
        thrown,
        np.array(world.walls),
        np.full(3, np.nan) if world.seat is None else world.seat,
    )
    return dict(zip(ROW, values, strict=True))


def _backdrop(row: dict[str, np.ndarray]) -> Backdrop:
    sun, bright, sky, ground = row["light"]
    seat = row["seat"]
    return Backdrop(
        view=View(K=row["K"], k1=float(row["k1"]), R_cam_from_world=row["R"], centre_world=row["centre"]),
        light=Light(towards_sun=sun, sun=bright, sky=sky, ground=ground, rim=float(row["rim"])),
        thrown=tuple((t[:2], float(t[2])) for t in row["thrown"] if np.isfinite(t).all()),
        walls=(float(row["walls"][0]), float(row["walls"][1])),
        seat=seat if np.isfinite(seat).all() else None,
    )


def _drawn(
    scene: Scene,
    worlds: int,
    views: int,
    seed: int,
    rows: list[dict[str, np.ndarray]],
    show: Callable[[str], None],
) -> Iterator[np.ndarray]:
    """The pictures; what goes with each is added to `rows`."""
    props: Props | None = None
    for number in range(worlds):
        rng = np.random.default_rng([seed, number])
        if number % PROPS_FOR == 0:
            props = draw_props(np.random.default_rng([seed, number, 1]), scene, *SIZE, count=min(6, worlds))
        assert props is not None
        seen = _views(rng, scene, views)
        world = draw_world(
            rng,
            scene,
            [],
            props.textures,
            props.cast,
            seen[0].centre_world,
            hard=bool(rng.random() < HARD),
            players=False,
            people=False,
        )
        for view in seen:
            picture = draw_picture(props.canvas, world, view, props.textures.noise)
            picture = np.clip(picture + np.float32(0.5), 0, 255).astype(np.uint8)
            if rng.random() < OVERLAID:
                paint, opacity = draw_overlay(rng, *SIZE, hard=False)
                picture = (picture * (1 - opacity) + paint * opacity).astype(np.uint8)
            rows.append(_row(view, world))
            yield picture
        show(f"world {number + 1} of {worlds}")


def _views(rng: np.random.Generator, scene: Scene, count: int) -> list[View]:
    """Cameras at one place: turned and zoomed."""
    court = scene.court
    if court is None:
        raise ValueError(f"scene {scene.name}: expected a court to draw, got none")
    if rng.random() < BROADCAST:
        base = broadcast_pose(rng, court, SIZE)
        return [
            replace(
                base,
                heading=base.heading + float(rng.normal(0, 0.05)),
                tilt=base.tilt + float(rng.normal(0, 0.02)),
                focal_px=base.focal_px * float(rng.uniform(0.8, 1.4)),
            ).view(SIZE)
            for _ in range(count)
        ]
    view = any_view(rng, court, SIZE)
    zooms = np.exp(rng.uniform(-0.2, 0.3, count))
    return [replace(view, K=view.K * np.array([[z, 1, 1], [1, z, 1], [1, 1, 1]])) for z in zooms]


def picture_of(backdrops: Backdrops, index: int, rng: np.random.Generator) -> np.ndarray:
    """That picture, at times brighter, darker or of another tint as a whole, BGR uint8."""
    picture = backdrops.pictures.read(index)
    if rng.random() < 0.5:
        return picture
    gain = np.exp(rng.normal(0, 0.12) + rng.normal(0, 0.1, 3))
    table = np.clip(np.arange(256)[:, None] * gain, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(picture, table[:, None, :]), dtype=np.uint8)
