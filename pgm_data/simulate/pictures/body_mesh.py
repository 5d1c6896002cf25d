"""Clothed bodies as meshes that follow a skeleton, and the light that falls on them."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, Int, Int16

from pgm_data.simulate.body.figure import Figure, smpl24
from pgm_data.simulate.body.keypoints import hull_at_joints
from pgm_data.simulate.pictures.body_shape import REST, arms, hands, legs, neck
from pgm_data.simulate.pictures.clothes_shape import clothes, skin_starts
from pgm_data.simulate.pictures.head_shape import head
from pgm_data.simulate.pictures.loft import Part
from pgm_data.simulate.pictures.looks import BodyLook
from pgm_data.simulate.pictures.racket_mesh import racket as racket_parts
from pgm_data.simulate.pictures.raster import Mesh
from pgm_data.simulate.pictures.skinning import brighten, move, sunlit

INFLUENCES = 4
_FINENESS = {"fine": 0.8, "coarse": 0.42}


@dataclass(frozen=True, eq=False, kw_only=True)
class SkinnedBody:
    """A body at rest and how it follows its joints."""

    vertices: Float[np.ndarray, "vertices 3"]
    """Rest pose, root's frame at the root's rest place, metres."""
    normals: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    colours: Float[np.ndarray, "vertices 3"]
    """BGR under white light."""
    labels: Int16[np.ndarray, " triangles"]
    """`loft.BODY` or `loft.RACKET`."""
    opacity: Float[np.ndarray, " triangles"]
    """1 but for strings."""
    influences: Int[np.ndarray, "vertices 4"]
    """Joints that move each vertex, the strongest first."""
    weights: Float[np.ndarray, "vertices 4"]
    rest_joints: Float[np.ndarray, "24 3"]
    """In the frame of `vertices`."""
    balls: tuple[Int[np.ndarray, " balls"], Float[np.ndarray, "balls 3"], Float[np.ndarray, " balls"]]
    """Joints, places in their frames and radii of balls that wrap the body: they keep the sun off."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Light:
    """The light of a place; colours are BGR factors."""

    towards_sun: Float[np.ndarray, " 3"]
    """Unit vector, world."""
    sun: Float[np.ndarray, " 3"]
    sky: Float[np.ndarray, " 3"]
    """From above."""
    ground: Float[np.ndarray, " 3"]
    """From below."""
    rim: float = 0.12
    """Brighter outlines, as from the sky behind."""


SUNNY = Light(
    towards_sun=np.array([-0.45, -0.55, 0.70]) / np.linalg.norm([-0.45, -0.55, 0.70]),
    sun=np.array([0.52, 0.58, 0.62]),
    sky=np.array([0.52, 0.48, 0.45]),
    ground=np.array([0.26, 0.27, 0.28]),
)


def build_body(
    figure: Figure, look: BodyLook, *, racket: bool, detail: Literal["fine", "coarse"] = "fine"
) -> SkinnedBody:
    """The mesh of a figure in these clothes, with a racket in its hand or without."""
    fine = _FINENESS[detail]
    grip = figure.hand if racket else None
    arm, leg = skin_starts(look)
    parts = [
        *arms(look, fine, arm),
        *hands(look, fine, grip),
        neck(look, fine),
        *head(look, fine),
        *clothes(look, fine),
    ]
    if leg is not None:
        parts += legs(look, fine, leg)
    if racket:
        parts += racket_parts(look, figure.hand, fine)
    return _fitted(parts, figure)


def _fitted(parts: list[Part], figure: Figure) -> SkinnedBody:
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    vertices = np.concatenate([p.vertices for p in parts])
    dense = np.concatenate([p.weights for p in parts])
    order = np.argsort(-dense, axis=1, kind="stable")[:, :INFLUENCES]
    weights = np.take_along_axis(dense, order, axis=1)
    weights = weights / weights.sum(axis=1, keepdims=True)
    joints = np.array(figure.translations)
    for joint, parent in enumerate(smpl24().parents):
        if parent >= 0:
            joints[joint] += joints[parent]
    scales = _bone_scales(figure, joints)
    label = np.concatenate([np.full(len(p.vertices), p.label) for p in parts])
    # Every joint carries the canonical body to the figure's: longer or shorter along its bone, thicker across.
    moved = np.zeros_like(vertices)
    for k in range(INFLUENCES):
        j = order[:, k]
        moved += weights[:, k, None] * (np.einsum("vab,vb->va", scales[j], vertices - REST[j]) + joints[j])
    hand = order[:, 0]
    rigid = label == 1  # rackets come in one size
    moved[rigid] = (vertices - REST[hand])[rigid] + joints[hand][rigid]
    triangles = np.concatenate([p.triangles + s for p, s in zip(parts, starts[:-1], strict=True)])
    return SkinnedBody(
        vertices=moved,
        normals=np.concatenate([p.normals for p in parts]),
        triangles=triangles.astype(np.int64),
        colours=np.concatenate([p.colours for p in parts]),
        labels=np.concatenate([np.full(len(p.triangles), p.label) for p in parts]).astype(np.int16),
        opacity=np.concatenate([np.full(len(p.triangles), p.opacity) for p in parts]),
        influences=order.astype(np.int64),
        weights=weights,
        rest_joints=joints,
        balls=hull_at_joints(figure),
    )


def _bone_scales(figure: Figure, joints: np.ndarray) -> Float[np.ndarray, "24 3 3"]:
    """How each joint's surroundings grow from the canonical body to the figure's."""
    names = smpl24().joint_names
    s = figure.height_m / 1.8
    thick = s * figure.girth
    scales = np.tile(np.diag([thick, s, thick]), (24, 1, 1))
    for name in ("Head", "L_Hand", "R_Hand", "L_Ankle", "R_Ankle", "L_Toe", "R_Toe"):
        scales[names.index(name)] = s * np.eye(3)
    scales[names.index("Neck")] = np.diag([s * (0.5 + 0.5 * figure.girth), s, s * (0.5 + 0.5 * figure.girth)])
    for side in ("L_", "R_"):
        for start, end in (
            ("Hip", "Knee"),
            ("Knee", "Ankle"),
            ("Shoulder", "Elbow"),
            ("Elbow", "Wrist"),
            ("Wrist", "Hand"),
        ):
            a, b = names.index(side + start), names.index(side + end)
            bone = REST[b] - REST[a]
            length = float(np.linalg.norm(bone))
            axis = bone / length
            stretch = float(np.linalg.norm(joints[b] - joints[a])) / length
            across = s if start == "Wrist" else thick
            scales[a] = across * np.eye(3) + (stretch - across) * np.outer(axis, axis)
        scales[names.index(side + "Thorax")] = np.diag([s, s, thick])
    return scales


def posed(
    body: SkinnedBody, R_world_from_joint: Float[np.ndarray, "24 3 3"], t_world: Float[np.ndarray, "24 3"]
) -> tuple[np.ndarray, np.ndarray]:
    """World vertices and unit normals of a body whose joints are turned and placed like this."""
    vertices, normals = np.empty_like(body.vertices), np.empty_like(body.normals)
    rotations, places = np.ascontiguousarray(R_world_from_joint), np.ascontiguousarray(t_world)
    move(
        body.vertices,
        body.normals,
        body.influences,
        body.weights,
        body.rest_joints,
        rotations,
        places,
        vertices,
        normals,
    )
    return vertices, normals


def lit(
    normals: Float[np.ndarray, "vertices 3"],
    colours: Float[np.ndarray, "vertices 3"],
    light: Light,
    towards_camera: Float[np.ndarray, " 3"] | None = None,
    sun_share: Float[np.ndarray, " vertices"] | None = None,
) -> Float32[np.ndarray, "vertices 3"]:
    """BGR of vertices under a light: sun with a soft edge, sky above, ground below, and a rim away from the camera.

    `sun_share` is how much of the sun reaches each vertex, all where None.
    """
    share = np.ones(len(normals)) if sun_share is None else sun_share
    lamp = np.stack([light.towards_sun, light.sun, light.sky, light.ground])
    camera, rim = (np.zeros(3), 0.0) if towards_camera is None else (towards_camera, light.rim)
    bright = np.empty((len(normals), 3), np.float32)
    brighten(np.ascontiguousarray(normals), colours, share, lamp, camera, rim, bright)
    return bright


def drawn_body(
    body: SkinnedBody,
    R_world_from_joint: Float[np.ndarray, "24 3 3"],
    t_world: Float[np.ndarray, "24 3"],
    light: Light,
    camera_world: Float[np.ndarray, " 3"],
) -> Mesh:
    """The mesh of one posture under this light, ready for the rasteriser."""
    vertices, normals = posed(body, R_world_from_joint, t_world)
    joints, places, radii = body.balls
    centres = t_world[joints] + np.einsum("kab,kb->ka", R_world_from_joint[joints], places)
    share = np.empty(len(vertices))
    sunlit(vertices, centres, radii, light.towards_sun, share)
    away = camera_world - t_world[0]
    colours = lit(normals, body.colours, light, away / np.linalg.norm(away), share)
    return Mesh(vertices=vertices, triangles=body.triangles, colours=colours, labels=body.labels, opacity=body.opacity)
