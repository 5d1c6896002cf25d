"""What a scene declares. Only what stands here is detected, solved, written or trained."""

import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Literal

import numpy as np
import yaml

from pgm_data.court import Court
from pgm_data.fields import FieldError, count, fields, names_of, number, numbers, sequence, word
from pgm_data.skeleton import Skeleton, load_skeleton


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneObject:
    """One thing of the scene that a renderer draws, and its share of the work."""

    name: str
    kind: Literal["player", "ball", "plane", "static", "skybox"]
    box_m: tuple[float, ...]
    """Size of its box along x, y, z, metres."""
    skeleton: Skeleton | None
    """Of players; None otherwise."""
    region_m: tuple[tuple[float, ...], ...]
    """Lower and upper corner of where it may be, world metres; empty where it cannot move."""
    representation: Literal["voxels", "planes", "sphere", "directions"]
    """How its radiance is stored."""
    grid: tuple[int, ...]
    """Cells of that store along each axis."""
    features: int
    """Features per cell."""
    samples_per_ray: int
    """Samples a ray takes inside its box."""
    opacity: Literal["solid", "learned"] = "solid"
    """Whether a plane hides all that is behind it, or how much it does is learned; `solid` of what is no plane."""

    @property
    def is_veil(self) -> bool:
        """Whether it is a plane that one may see through."""
        return self.opacity == "learned"

    @property
    def is_backdrop(self) -> bool:
        """Whether it is a surface that nothing behind it shows through."""
        return self.kind in ("plane", "skybox") and not self.is_veil


@dataclass(frozen=True, eq=False, kw_only=True)
class Prior:
    """A Gaussian prior."""

    mean: float
    std: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Ball:
    """Constants of the ball's flight and bounce."""

    radius_m: float
    mass_kg: float
    drag_per_m: Prior
    """C = rho Cd A / (2 m), 1/m."""
    lift: Literal["none", "spin"]
    """Whether spin bends the flight."""
    spin_std_rad_s: float
    """Standard deviation of each component of the spin after a hit, about 0; 0 where spin does not count."""
    restitution: Prior | None
    """Vertical speed kept at a bounce; None where the ball does not bounce in play."""
    friction: Prior | None
    """Sliding friction at a bounce."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A scene file, checked."""

    name: str
    camera_position: Literal["fixed", "moving"]
    """Whether a clip's camera turns about one fixed centre."""
    person_height_m: float
    court: Court | None
    objects: tuple[SceneObject, ...]
    ball: Ball | None

    @property
    def players(self) -> tuple[SceneObject, ...]:
        """Objects of kind `player`, in the file's order."""
        return tuple(o for o in self.objects if o.kind == "player")


def scene_names() -> tuple[str, ...]:
    """Scenes that ship with the package."""
    return tuple(sorted(p.name[:-5] for p in files("pgm_data.scenes").iterdir() if p.name.endswith(".yaml")))


def scene_text(scene: str) -> str:
    """The text of a shipped scene of that name, or of the file at that path."""
    shipped = scene_names()
    if scene in shipped:
        return files("pgm_data.scenes").joinpath(f"{scene}.yaml").read_text(encoding="utf-8")
    path = Path(scene)
    if path.suffix in {".yaml", ".yml"} and path.is_file():
        return path.read_text(encoding="utf-8")
    raise ValueError(f"scene: expected one of {', '.join(shipped)} or the path of a .yaml file, got {scene!r}")


def load_scene(scene: str) -> Scene:
    """The scene of that name, or from the file at that path.

    Raises:
        ValueError: If there is no such scene or its file does not say what a scene must; names the field.
    """
    try:
        return scene_from_fields(yaml.safe_load(scene_text(scene)))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"scene {scene}: expected YAML, got: {' '.join(str(error).split())}") from error
    except FieldError as error:
        raise ValueError(f"scene {scene}: {error}") from error


def scene_from_fields(raw: object) -> Scene:
    """The scene that the fields of its file describe.

    Raises:
        FieldError: If a field is not what it must be.
    """
    top = fields(raw, "", required=("name", "camera", "objects"), optional=("court", "ball"))
    camera = fields(top["camera"], "camera", required=("position", "person_height_m"))
    objects = fields(top["objects"], "objects")
    return Scene(
        name=_name(top["name"]),
        camera_position=word(camera["position"], "camera.position", ("fixed", "moving")),
        person_height_m=number(camera["person_height_m"], "camera.person_height_m", above=0),
        court=_court(top["court"]) if "court" in top else None,
        objects=tuple(_object(name, value) for name, value in objects.items()),
        ball=_ball(top["ball"]) if "ball" in top else None,
    )


def _name(raw: object) -> str:
    """A scene's name: files are called after it."""
    name = word(raw, "name")
    if re.fullmatch("[a-z][a-z0-9_]*", name) is None:
        raise FieldError(f"name: expected small letters, digits and underscores, a letter first, got {name!r}")
    return name


def _court(raw: object) -> Court:
    court = fields(
        raw,
        "court",
        required=("stores", "points", "lines", "surface_half_size_m"),
        optional=("out_of_plane", "net", "network", "in_play", "in_serve"),
    )
    word(court["stores"], "court.stores", ("line_centres",))
    points = _points(court["points"], "court.points")
    high = _points(court.get("out_of_plane", {}), "court.out_of_plane")
    lines = {
        name: fields(value, f"court.lines.{name}", required=("ends", "width_m"))
        for name, value in fields(court["lines"], "court.lines").items()
    }
    names = tuple(points)
    net = fields(court.get("net", NO_NET), "court.net", required=("top", "tape_width_m"))
    half_size = numbers(court["surface_half_size_m"], "court.surface_half_size_m", 2)
    try:
        return Court(
            point_names=names,
            points_world=np.array(list(points.values()), dtype=float).reshape(-1, 3),
            line_names=tuple(lines),
            line_ends=np.array(
                [_indices(line["ends"], f"court.lines.{name}.ends", names, 2) for name, line in lines.items()]
            ).reshape(-1, 2),
            line_width=np.array(
                [number(line["width_m"], f"court.lines.{name}.width_m", above=0) for name, line in lines.items()],
                dtype=float,
            ),
            high_names=tuple(high),
            high_world=np.array(list(high.values()), dtype=float).reshape(-1, 3),
            net_top=tuple(names_of(net["top"], "court.net.top", (*names, *high))),
            tape_width=number(net["tape_width_m"], "court.net.tape_width_m"),
            surface_half_size=(half_size[0], half_size[1]),
            network=word(court.get("network", ""), "court.network"),
            in_play=_areas([court["in_play"]] if "in_play" in court else [], "court.in_play"),
            in_serve=_areas(court.get("in_serve", []), "court.in_serve"),
        )
    except FieldError:
        raise
    except ValueError as error:
        raise FieldError(str(error)) from error


NO_NET = {"top": [], "tape_width_m": 0.0}


def _areas(raw: object, place: str) -> np.ndarray:
    """Rectangles by their lower and upper corners."""
    areas = [sequence(area, place) for area in sequence(raw, place)]
    wrong = next((area for area in areas if len(area) != 2), None)
    if wrong is not None:
        raise FieldError(f"{place}: expected a lower and an upper corner, got {wrong}")
    return np.array([[numbers(corner, place, 2) for corner in area] for area in areas], dtype=float).reshape(-1, 2, 2)


def _points(raw: object, place: str) -> dict[str, tuple[float, ...]]:
    return {name: numbers(value, f"{place}.{name}", 3) for name, value in fields(raw, place).items()}


def _indices(raw: object, place: str, known: tuple[str, ...], length: int) -> list[int]:
    names = names_of(raw, place, known)
    if len(names) != length:
        raise FieldError(f"{place}: expected {length} points, got {names}")
    return [known.index(name) for name in names]


def _object(name: str, raw: object) -> SceneObject:
    place = f"objects.{name}"
    value = fields(
        raw, place, required=("kind", "box_m", "radiance", "samples_per_ray"), optional=("skeleton", "region_m")
    )
    kind = word(value["kind"], f"{place}.kind", ("player", "ball", "plane", "static", "skybox"))
    if (kind == "player") != ("skeleton" in value):
        expected, got = ("a skeleton", "none") if kind == "player" else ("none", value["skeleton"])
        raise FieldError(f"{place}.skeleton: expected {expected} since its kind is {kind}, got {got}")
    radiance = fields(
        value["radiance"], f"{place}.radiance", required=("representation", "grid", "features"), optional=("opacity",)
    )
    opacity = word(radiance.get("opacity", "solid"), f"{place}.radiance.opacity", ("solid", "learned"))
    if opacity != "solid" and kind != "plane":
        raise FieldError(f"{place}.radiance.opacity: expected solid since its kind is {kind}, got {opacity}")
    region = sequence(value.get("region_m", []), f"{place}.region_m")
    if len(region) not in (0, 2):
        raise FieldError(f"{place}.region_m: expected its lower and its upper corner, got {region}")
    return SceneObject(
        name=name,
        kind=kind,
        box_m=numbers(value["box_m"], f"{place}.box_m", 3),
        skeleton=_skeleton(value["skeleton"], f"{place}.skeleton") if kind == "player" else None,
        region_m=tuple(numbers(corner, f"{place}.region_m", 3) for corner in region),
        representation=word(
            radiance["representation"],
            f"{place}.radiance.representation",
            ("voxels", "planes", "sphere", "directions"),
        ),
        grid=tuple(
            count(cells, f"{place}.radiance.grid") for cells in sequence(radiance["grid"], f"{place}.radiance.grid")
        ),
        features=count(radiance["features"], f"{place}.radiance.features"),
        samples_per_ray=count(value["samples_per_ray"], f"{place}.samples_per_ray"),
        opacity=opacity,
    )


def _skeleton(raw: object, place: str) -> Skeleton:
    try:
        return load_skeleton(word(raw, place))
    except ValueError as error:
        raise FieldError(f"{place}: {error}") from error


def _ball(raw: object) -> Ball:
    ball = fields(
        raw,
        "ball",
        required=("radius_m", "mass_kg", "drag_per_m", "lift"),
        optional=("restitution", "friction", "spin_std_rad_s"),
    )
    lift = word(ball["lift"], "ball.lift", ("none", "spin"))
    if (lift == "spin") != ("spin_std_rad_s" in ball):
        expected, got = ("a number", "none") if lift == "spin" else ("none", ball["spin_std_rad_s"])
        raise FieldError(f"ball.spin_std_rad_s: expected {expected} since ball.lift is {lift}, got {got}")
    return Ball(
        radius_m=number(ball["radius_m"], "ball.radius_m", above=0),
        mass_kg=number(ball["mass_kg"], "ball.mass_kg", above=0),
        drag_per_m=_prior(ball["drag_per_m"], "ball.drag_per_m"),
        lift=lift,
        spin_std_rad_s=number(ball["spin_std_rad_s"], "ball.spin_std_rad_s", above=0) if lift == "spin" else 0.0,
        restitution=_prior(ball["restitution"], "ball.restitution") if "restitution" in ball else None,
        friction=_prior(ball["friction"], "ball.friction") if "friction" in ball else None,
    )


def _prior(raw: object, place: str) -> Prior:
    prior = fields(raw, place, required=("mean", "std"))
    return Prior(mean=number(prior["mean"], f"{place}.mean"), std=number(prior["std"], f"{place}.std", above=0))
