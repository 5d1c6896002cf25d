"""A camera for play that nobody filmed, and what it would see of players and ball."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.convert.track_camera import read_track_camera
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene
from pgm_data.simulate.blocks.orbit import draw_orbit, orbit_track
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.views import court_scale, focal_for_span, framed_pose, track_of
from pgm_data.skeleton import Skeleton, world_from_joints

SIZE = (1280, 720)
"""Width and height of pictures of the usual view, px."""
CENTRE_M, AIM_M = (0.0, -40.0, 10.0), (0.0, -1.5, 0.0)
"""Where the usual camera of a tennis court stands and looks; of other courts by their length."""
COURT_SHARE = 0.7
"""Of the picture's width that the near baseline takes."""
AIM_HEIGHT = 0.54
"""Share of the picture's height, from above, at which the camera's aim is seen."""
BODY_M = 0.08
"""How far a body reaches beyond its joints and named points, metres: its box in the picture is that much larger."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayCamera:
    """The camera of every frame of a play."""

    camera: Camera
    size: tuple[int, int]
    """Width and height of its pictures, px."""
    reason: str
    """Where it is from."""


def camera_of_file(path: Path, frames: int) -> PlayCamera:
    """The fixed camera of a CAMERA.json, for so many frames.

    Raises:
        ValueError: If the file does not hold one.
    """
    if path.suffix.lower() != ".json":
        raise ValueError(f"{path}: expected a fixed camera in a .json file, got {path.suffix or 'no suffix'}")
    read = read_track_camera(path, frames)
    if read.size is None:
        raise ValueError(f"{path}: width, height: expected them, got none")
    return PlayCamera(camera=read.camera, size=read.size, reason=f"as in {path.name}")


def usual_camera(scene: Scene, times: Float[np.ndarray, " frames"]) -> PlayCamera | None:
    """The scene's usual view of play: of a court the broadcast view, of blocks a slow orbit; None of other scenes."""
    if scene.court is not None:
        scale, (width, height) = court_scale(scene.court), SIZE
        centre, aim = scale * np.array(CENTRE_M), scale * np.array(AIM_M)
        middle = ((width - 1) / 2, (height - 1) / 2)
        pose = framed_pose(
            centre_world=centre,
            aim_world=aim,
            aim_px=(middle[0], AIM_HEIGHT * height),
            roll=0.0,
            focal_px=focal_for_span(scene.court, centre, aim, COURT_SHARE, width),
            principal_px=middle,
            k=0.0,
        )
        return PlayCamera(camera=_camera(track_of([pose.view(SIZE)] * len(times))), size=SIZE, reason="broadcast view")
    if scene.name == "blocks":
        orbit = draw_orbit(np.random.default_rng(0), SIZE)
        return PlayCamera(camera=_camera(orbit_track(orbit, times, SIZE)), size=SIZE, reason="slow orbit")
    return None


def _camera(track: CameraTrack) -> Camera:
    return Camera(
        K=track.K,
        distortion=track.distortion,
        R_cam_from_world=track.R_cam_from_world,
        t_cam_from_world=track.t_cam_from_world,
    )


def body_points(
    skeleton: Skeleton,
    rotations: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames points 3"]]:
    """World positions of joints and of the skeleton's named points, metres.

    Args:
        skeleton: Of the player.
        rotations: Axis-angle of parent_from_joint, radians; entry 0 is world_from_root.
        translations: Of parent_from_joint, metres; entry 0 is the root in the world.
    """
    R, joints = world_from_joints(skeleton.parents, rotations, translations)
    rest = np.linalg.norm(skeleton.rest_translations[1:], axis=-1).sum()
    bones = np.linalg.norm(translations[:, 1:], axis=-1).sum(axis=1)
    offsets = (bones / rest)[:, None, None] * skeleton.point_offsets if rest > 0 else skeleton.point_offsets
    hung = skeleton.point_joints
    return joints, joints[:, hung] + (R[:, hung] @ offsets[..., None])[..., 0]


def inside(pixels: Float[np.ndarray, "*batch 2"], size: tuple[int, int]) -> np.ndarray:
    """1 where pixels lie inside of a picture of width and height, 0 where not; NaN of NaN."""
    within = np.all((pixels >= -0.5) & (pixels < np.array(size) - 0.5), axis=-1)
    return np.where(np.isfinite(pixels).all(axis=-1), within.astype(np.float64), np.nan)


def boxes(view: PlayCamera, points_world: Float[np.ndarray, "frames points 3"]) -> Float[np.ndarray, "frames 4"]:
    """Boxes x0, y0, x1, y1 around a body's points, px, not cut off at the picture's edge.

    NaN where a point is not in front of the camera.
    """
    pixels, _ = project(view.camera, points_world)
    towards = view.camera.R_cam_from_world[:, None, 2]
    depth = (points_world * towards).sum(axis=-1) + view.camera.t_cam_from_world[:, None, 2]
    reach = BODY_M / np.where(depth > BODY_M, depth, np.nan)[..., None] * view.camera.K[:, None, [0, 1], [0, 1]]
    return np.concatenate([(pixels - reach).min(axis=1), (pixels + reach).max(axis=1)], axis=-1)
