"""A court with players, officials and a ball, drawn through a camera in the order of their distance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float, Float32

from pgm_data.scene import Scene
from pgm_data.simulate.body.figure import Figure
from pgm_data.simulate.body.racket import TIP_M
from pgm_data.simulate.camera import pixels_of
from pgm_data.simulate.pictures.ball_streak import ball_shadow, ball_streak
from pgm_data.simulate.pictures.body_mesh import Light, SkinnedBody, build_body, drawn_body, posed
from pgm_data.simulate.pictures.looks import draw_look
from pgm_data.simulate.pictures.negative import Props
from pgm_data.simulate.pictures.officials import Official, draw_officials
from pgm_data.simulate.pictures.people import blob_shadow
from pgm_data.simulate.pictures.picture import Brush, Canvas
from pgm_data.simulate.pictures.raster import Mesh, Sprite, blurred, darken, draw_triangles, over, shadow
from pgm_data.simulate.pictures.shapes import in_pieces, polygons, stacked
from pgm_data.simulate.pictures.turning import WideBackdrop
from pgm_data.simulate.pictures.world import Surface, World, draw_world
from pgm_data.simulate.shots import Masks
from pgm_data.simulate.views import View

PIECE_M = 2.0
BLURS_PX = 1.2
"""Bodies that move further than this over an exposure are drawn at several moments of it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Actor:
    """One player at the moments of an exposure."""

    person: int
    """Which of the stage's figures."""
    label: int
    """Which player object of the scene: 0, 1."""
    R_world: Float[np.ndarray, "moments 24 3 3"]
    t_world: Float[np.ndarray, "moments 24 3"]


@dataclass(frozen=True, eq=False, kw_only=True)
class BallSeen:
    """The ball over an exposure."""

    positions: Float[np.ndarray, "points 3"]
    """World places through the exposure; NaN where there is no ball."""
    shares: Float[np.ndarray, " pieces"]
    """Parts of the exposure between them; none for a ball at one place."""
    middle: Float[np.ndarray, " 3"]
    """Where it is in the middle of the exposure."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Moment:
    """What moves, in one picture."""

    actors: tuple[Actor, ...]
    ball: BallSeen | None


def draw_stage(
    rng: np.random.Generator,
    scene: Scene,
    props: Props,
    centre_world: Float[np.ndarray, " 3"],
    *,
    figures: Sequence[Figure],
    surface: Surface,
    fine: bool,
) -> "Stage":
    """A stage by lot for these players, seen from this centre; `fine` keeps thin lines exact and bodies smooth."""
    court = scene.court
    assert court is not None
    world = draw_world(
        rng, scene, [], props.textures, props.cast, centre_world, hard=False, players=False, people=False,
        surface=surface,
    )  # fmt: skip
    if fine:
        world = replace(world, lines=in_pieces(world.lines, PIECE_M), tape=in_pieces(world.tape, PIECE_M))
    white = surface == "grass" and bool(rng.random() < 0.7)
    looks = [draw_look(rng, "player", white=white) for _ in figures]
    bodies = tuple(
        build_body(figure, look, racket=True, detail="fine" if fine else "coarse")
        for figure, look in zip(figures, looks, strict=True)
    )
    # A shadow's outline needs few triangles.
    casters = bodies
    if fine:
        casters = tuple(
            build_body(figure, look, racket=True, detail="coarse") for figure, look in zip(figures, looks, strict=True)
        )
    return Stage(
        scene=scene,
        world=world,
        canvas=Canvas(props.canvas.width, props.canvas.height, fine=fine),
        noise=props.textures.noise,
        bodies=bodies,
        casters=casters,
        officials=draw_officials(rng, court.surface_half_size, world.walls, world.seat),
        samples=3 if fine else 2,
    )


class Stage:
    """One event's look and the buffers to draw it."""

    def __init__(
        self,
        *,
        scene: Scene,
        world: World,
        canvas: Canvas,
        noise: np.ndarray,
        bodies: tuple[SkinnedBody, ...],
        casters: tuple[SkinnedBody, ...],
        officials: tuple[Official, ...],
        samples: int,
    ) -> None:
        self._scene, self._canvas, self._noise = scene, canvas, noise
        self._casters = casters
        self._bodies, self._officials, self._samples = bodies, officials, samples
        self._size = (canvas.width, canvas.height)
        self._radius = 0.0 if scene.ball is None else scene.ball.radius_m
        self._light = light_of(world)
        self._shaded = replace(self._light, sun=0.25 * self._light.sun)
        # One sharp shadow shows its steps; of four faint ones nobody sees them.
        self._shadow_samples = 2 if canvas.fine and len(world.thrown) == 1 else 1
        self._front = world.front
        shadows = world.shadows
        if len(world.thrown) > 1:
            # The faint shadows of many lamps need no outline of those who stand still.
            places = [(o.place * np.array([1.0, 1.0, 0.0]), o.place[2] + 0.75) for o in officials if o.stands]
            faint = [s for place, tall in places for t, dark in world.thrown for s in blob_shadow(place, tall, t, dark)]
            shadows = stacked([shadows, polygons(faint)])
        self._world = replace(world, front=polygons([]), shadows=shadows)
        self._wide = None if canvas.fine else WideBackdrop(self._size)
        self._last = b""
        self._lit: tuple[bytes, list[Mesh]] = (b"", [])
        self._still: tuple[bytes, np.ndarray, list[tuple[np.ndarray, Sprite]]] | None = None

    def picture(self, view: View, moment: Moment, *, haze_px: float = 0.0) -> Float32[np.ndarray, "height width 3"]:
        """BGR, about 0 to 255, in a buffer that the next picture overwrites.

        `haze_px`: blur of all that stands still, as behind the focus of a long lens; standard deviation.
        """
        image = self._canvas.image
        brush = Brush(self._canvas, view)
        things = self._backdrop(brush, view)
        if haze_px > 0.0:
            cv2.GaussianBlur(image, (0, 0), haze_px, dst=image)
            things = [(place, hazy(sprite, haze_px)) for place, sprite in things]
        for actor in moment.actors:
            things += self._actor(view, actor)
        if moment.ball is not None:
            things += self._ball(view, moment.ball)
        # What is further away is drawn first, and the net after all that is beyond it.
        things.sort(key=lambda thing: -_distance(view, thing[0]))
        for place, sprite in things:
            if place[1] > 0.0:
                over(image, sprite)
        brush.net(self._world)
        brush.flat(self._front)
        for place, sprite in things:
            if place[1] <= 0.0:
                over(image, sprite)
        return image

    def masks(self, view: View, moment: Moment) -> Masks:
        """Labels and depth of one picture, at the middle of its exposure; overwrites the buffer of `picture`."""
        names = {o.name: 1 + i for i, o in enumerate(self._scene.objects)}
        self._canvas.aim(view)
        labels, depth = self._backdrop_masks(view)
        things = []
        net = self._net_mask(view)
        for actor in moment.actors:
            middle = len(actor.R_world) // 2
            sprite = draw_triangles(self._mesh(view, actor, middle), view, self._size, self._samples)
            things.append((actor.t_world[middle, 0], sprite, names[self._scene.players[actor.label].name]))
        if moment.ball is not None:
            middle = moment.ball.middle
            sprite = ball_streak(middle[None], np.zeros(0), self._radius, view, self._size, self._light)
            label = next(names[o.name] for o in self._scene.objects if o.kind == "ball")
            things.append((middle, sprite, label))
        things.sort(key=lambda thing: -_distance(view, thing[0]))
        for beyond in (True, False):
            for place, sprite, label in things:
                if sprite is not None and (place[1] > 0.0) == beyond:
                    _stamp(labels, depth, sprite, label)
            if beyond and net is not None:
                covered, label, away = net
                labels[covered], depth[covered] = label, away[covered]
        return Masks(labels=labels, depth=depth)

    def _actor(self, view: View, actor: Actor) -> list[tuple[np.ndarray, Sprite]]:
        """A player's sprite; its shadow is taken from the picture at once."""
        middle = len(actor.R_world) // 2
        still = self._mesh(view, actor, middle)
        caster = self._casters[actor.person]
        vertices, _ = posed(caster, actor.R_world[middle], actor.t_world[middle])
        self._shade(view, vertices, caster.triangles[caster.opacity > 0.5])
        meshes = [still]
        if self._blurs(view, actor):
            meshes = [self._mesh(view, actor, i) for i in range(len(actor.R_world))]
        sprite = blurred([draw_triangles(mesh, view, self._size, self._samples) for mesh in meshes])
        return [] if sprite is None else [(actor.t_world[middle, 0], sprite)]

    def _shade(self, view: View, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Takes every light's shadow of a body from the picture."""
        if self._in_shade(vertices[0]):
            return
        for thrown, strength in self._world.thrown:
            fallen = shadow(vertices, triangles, thrown, 0.0, view, self._size, self._shadow_samples)
            darken(self._canvas.image, fallen, strength)

    def _in_shade(self, place: np.ndarray) -> bool:
        """Whether the stands keep the sun off somebody there."""
        shade = self._world.shade
        return shade is not None and bool(shade[:2] @ place[:2] > shade[2])

    def _light_at(self, place: np.ndarray) -> Light:
        return self._shaded if self._in_shade(place) else self._light

    def _ball(self, view: View, ball: BallSeen) -> list[tuple[np.ndarray, Sprite]]:
        for thrown, strength in self._world.thrown:
            fallen = ball_shadow(ball.positions, self._radius, thrown, 0.0, view, self._size)
            darken(self._canvas.image, fallen, strength)
        sprite = ball_streak(ball.positions, ball.shares, self._radius, view, self._size, self._light)
        return [] if sprite is None else [(ball.middle, sprite)]

    def _mesh(self, view: View, actor: Actor, moment: int) -> Mesh:
        body, light = self._bodies[actor.person], self._light_at(actor.t_world[len(actor.t_world) // 2, 0])
        return drawn_body(body, actor.R_world[moment], actor.t_world[moment], light, view.centre_world)

    def _blurs(self, view: View, actor: Actor) -> bool:
        """Whether the body, or the racket that a hand swings, moves visibly within the exposure."""
        ends = actor.t_world[[0, -1]]
        tips = ends[:, -2:] + TIP_M * actor.R_world[[0, -1], -2:, :, 2]
        px = pixels_of(
            np.concatenate([ends, tips], axis=1), view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world
        )
        moved = np.linalg.norm(px[1] - px[0], axis=-1)
        return bool(np.nanmax(moved, initial=0.0) > BLURS_PX)

    def _backdrop(self, brush: Brush, view: View) -> list[tuple[np.ndarray, Sprite]]:
        """Paints what stands still beyond the net; the officials' sprites before it, far and near ones alike."""
        key = np.concatenate([view.K.ravel(), [view.k1], view.R_cam_from_world.ravel(), view.centre_world]).tobytes()
        image = self._canvas.image
        if self._still is not None and self._still[0] == key:
            image[:] = self._still[1]
            return list(self._still[2])
        if self._wide is None:
            brush.backdrop(self._world, self._noise)
        else:
            self._wide.read(self._canvas, view, self._world, self._noise)
        people = []
        for person, mesh in zip(self._officials, self._standing(view), strict=True):
            if len(self._world.thrown) == 1:
                self._shade(view, mesh.vertices, mesh.triangles)
            sprite = draw_triangles(mesh, view, self._size, 2)
            if sprite is not None:
                people.append((person.place, sprite))
        # Kept only if the camera stands still: the copy is wasted on one that turns.
        if self._last == key:
            self._still = (key, image.copy(), list(people))
        self._last = key
        return people

    def _standing(self, view: View) -> list[Mesh]:
        """The officials' bodies as this camera's place shows them."""
        key = view.centre_world.tobytes()
        if self._lit[0] != key:
            meshes = [
                drawn_body(p.body, p.R_world, p.t_world, self._light_at(p.place), view.centre_world)
                for p in self._officials
            ]
            self._lit = (key, meshes)
        return self._lit[1]

    def _backdrop_masks(self, view: View) -> tuple[np.ndarray, np.ndarray]:
        """Ground and walls, from each pixel's ray."""
        directions, centre = self._directions(view), view.centre_world
        with np.errstate(divide="ignore", invalid="ignore"):
            ground = np.where(directions[..., 2] < 0, -centre[2] / directions[..., 2], np.inf)
            far = np.where(directions[..., 1] > 0, (self._world.walls[1] - centre[1]) / directions[..., 1], np.inf)
        labels = np.zeros(ground.shape, np.uint8)
        for i, thing in enumerate(self._scene.objects):
            if thing.kind == "plane" and thing.is_backdrop:
                labels[(ground < far) if thing.box_m[2] == 0.0 else (far <= ground) & np.isfinite(far)] = 1 + i
        return labels, np.minimum(ground, far).astype(np.float32)

    def _net_mask(self, view: View) -> tuple[np.ndarray, int, np.ndarray] | None:
        """Pixels of which the net hides half or more, its label, and how far it is; None of a scene without such."""
        court = self._scene.court
        label = next((1 + i for i, thing in enumerate(self._scene.objects) if thing.is_veil), 0)
        if court is None or not len(court.net_world) or not label:
            return None
        # What is left of white after black is what shows through.
        image, brush = self._canvas.image, Brush(self._canvas, view)
        shown = []
        for ground in (0.0, 255.0):
            image[:] = ground
            brush.net(self._world)
            shown.append(image.mean(axis=2))
        directions = self._directions(view)
        with np.errstate(divide="ignore", invalid="ignore"):
            away = (court.net_world[0, 1] - view.centre_world[1]) / directions[..., 1]
        covered = (shown[1] - shown[0] <= 0.5 * 255.0) & (away > 0) & np.isfinite(away)
        return covered, label, away.astype(np.float32)

    def _directions(self, view: View) -> Float[np.ndarray, "height width 3"]:
        """Each pixel's ray in the world, as long as its depth is 1."""
        rays = self._canvas.straight.astype(float)
        return np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=2) @ view.R_cam_from_world


def _stamp(labels: np.ndarray, depth: np.ndarray, sprite: Sprite, label: int) -> None:
    """Marks the pixels of which a sprite covers half or more."""
    height, width = labels.shape
    x0, y0 = max(sprite.x0, 0), max(sprite.y0, 0)
    x1, y1 = min(sprite.x0 + sprite.alpha.shape[1], width), min(sprite.y0 + sprite.alpha.shape[0], height)
    if x0 >= x1 or y0 >= y1:
        return
    part = np.s_[y0 - sprite.y0 : y1 - sprite.y0, x0 - sprite.x0 : x1 - sprite.x0]
    covered = sprite.alpha[part] >= 0.5
    labels[y0:y1, x0:x1][covered] = label
    depth[y0:y1, x0:x1][covered] = sprite.depth[part][covered]


def _distance(view: View, place: np.ndarray) -> float:
    return float(np.linalg.norm(place - view.centre_world))


def hazy(sprite: Sprite, blur_px: float) -> Sprite:
    """The sprite out of focus: colour times opacity and opacity alike blurred, in a box wide enough for both."""
    edge = int(np.ceil(3.0 * blur_px))
    light = np.concatenate([sprite.bgr * sprite.alpha[..., None], sprite.alpha[..., None]], axis=2)
    wide = cv2.copyMakeBorder(light, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=(0.0, 0.0, 0.0, 0.0))
    soft = cv2.GaussianBlur(wide, (0, 0), blur_px)
    alpha = np.ascontiguousarray(soft[..., 3])
    return Sprite(
        x0=sprite.x0 - edge,
        y0=sprite.y0 - edge,
        bgr=np.ascontiguousarray(soft[..., :3] / np.maximum(alpha, 1e-6)[..., None]),
        alpha=alpha,
        depth=np.full(alpha.shape, np.inf, np.float32),
    )


def light_of(world: World) -> Light:
    """The light that throws the world's shadows: a sun where there is one sharp shadow, else lamps from above."""
    thrown, strength = world.thrown[0]
    if len(world.thrown) > 1:
        thrown = np.zeros(2)
    towards = np.array([-thrown[0], -thrown[1], 1.0])
    sun = float(np.clip(0.35 + 0.6 * strength, 0.35, 0.75)) if len(world.thrown) == 1 else 0.45
    rest = 1.22 - sun
    return Light(
        towards_sun=towards / np.linalg.norm(towards),
        sun=sun * np.array([0.94, 1.0, 1.05]),
        sky=rest * np.array([1.0, 0.95, 0.9]),
        ground=0.62 * rest * np.array([0.95, 1.0, 1.0]),
    )
