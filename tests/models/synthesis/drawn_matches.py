"""Matches made by hand, their videos drawn by formula: each pixel tells its place, each frame its number."""

import hashlib
from pathlib import Path

import numpy as np

from pgm_data.dataset.columns import scene_tables, table_columns
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.pack import pack_work_folders
from pgm_data.dataset.pack_plan import PackOptions
from pgm_data.dataset.tables import write_table
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene, SceneObject, load_scene
from pgm_data.skeleton import world_joints
from pgm_data.video import write_video
from tests.dataset.work_folders import clip_document

SIZE = (192, 108)
FPS = 25.0
FRAMES = 36
LATER = 7
"""Frames by which what a match's video shows is ahead of that of the match before."""
SHUTTER_S = 0.012
UI_BOXES = ([[10.0, 5.0, 51.0, 17.0]], [[8.0, 91.0, 55.0, 103.0], [172.0, 7.0, 188.0, 11.0]])
"""Of even and odd matches."""


def colours(x: np.ndarray, y: np.ndarray, number: np.ndarray | int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Red, green, blue, 0 to 255, at pixels of the pictures: red by height, blue by width, green by frame."""
    x, y, green = np.broadcast_arrays(
        (np.asarray(x) + 0.5) / size[0], (np.asarray(y) + 0.5) / size[1], 50 + 5 * (np.asarray(number) % FRAMES)
    )
    return np.stack([60 + 120 * y, green, 60 + 120 * x], axis=-1)


def drawn(number: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Frame of a video, BGR."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.ascontiguousarray(colours(x, y, number, size).round().astype(np.uint8)[..., ::-1])


def draw_video(path: Path, frames: int, *, match: int = 0, size: tuple[int, int] = SIZE, gop: int = 12) -> Path:
    """The video of a match."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pictures = (drawn(number + LATER * match, size) for number in range(frames))
    write_video(path, pictures, fps=FPS, crf=4, preset="ultrafast", gop=gop)
    return path


def camera_of(frames: int) -> Camera:
    """Behind the near end, panning a little; its lens bends."""
    turn = np.linspace(-0.02, 0.02, frames)
    down = np.array([[1.0, 0, 0], [0, -np.sin(0.22), -np.cos(0.22)], [0, np.cos(0.22), -np.sin(0.22)]])
    pan = np.zeros((frames, 3, 3))
    pan[:, 0, 0] = pan[:, 1, 1] = np.cos(turn)
    pan[:, 0, 1], pan[:, 1, 0], pan[:, 2, 2] = np.sin(turn), -np.sin(turn), 1.0
    R = down @ pan
    return Camera(
        K=np.tile(np.array([[330.0, 0, 95.5], [0, 330, 53.5], [0, 0, 1]]), (frames, 1, 1)),
        distortion=np.tile([0.05, 0.0, 0.0, 0.0], (frames, 1)),
        R_cam_from_world=R,
        t_cam_from_world=-(R @ np.array([0.5, -34.0, 9.0])[:, None])[..., 0],
    )


def _player(player: SceneObject, place: float, frames: int, identity: str, camera: Camera) -> dict:
    """Someone who runs to the right, arms and legs moving."""
    assert player.skeleton is not None
    skeleton, name = player.skeleton, player.name
    time = np.arange(frames) / FPS
    joints = len(skeleton.parents)
    swing = np.random.default_rng(7).normal(0, 0.2, (joints, 3))
    rotations = np.sin(5 * time)[:, None, None] * swing
    rotations[:, 0] = [np.pi / 2, 0, 0]
    translations = np.tile(skeleton.rest_translations, (frames, 1, 1))
    translations[:, 0] = np.stack([3 * time - 2, np.full(frames, place), np.full(frames, 1.0)], axis=1)
    world = world_joints(skeleton.parents, rotations, translations)
    pixels = project(camera, world)[0]
    count = len(skeleton.keypoint_names)
    return {
        f"{name}.identity": [identity] * frames,
        f"{name}.box_px": np.concatenate([pixels.min(axis=1) - 1, pixels.max(axis=1) + 1], axis=1),
        f"{name}.keypoints_px": np.full((frames, 2 * count), np.nan),
        f"{name}.keypoint_score": np.full((frames, count), np.nan),
        f"{name}.root_position": translations[:, 0],
        f"{name}.root_rotation": rotations[:, 0],
        f"{name}.joints": world.reshape(frames, -1),
        f"{name}.joint_rotations": rotations.reshape(frames, -1),
        f"{name}.joint_translations": translations.reshape(frames, -1),
        f"{name}.root_cov": np.tile([0.01, 0, 0, 0.01, 0, 0.01], (frames, 1)),
        f"{name}.contact": np.full((frames, 2), 0.5),
        f"{name}.reprojection_px": np.full(frames, 0.5),
        f"{name}.status": ["measured"] * frames,
    }


def _ball(frames: int, camera: Camera) -> dict:
    """A ball that flies from the near to the far end."""
    time = (np.arange(frames) / FPS)[:, None]
    speed = np.array([2.0, 14.0, 7.0])
    velocity = speed - [0, 0, 9.81] * time
    position = np.array([-1.0, -9.0, 1.5]) + speed * time - 0.5 * np.array([0, 0, 9.81]) * time**2
    return {
        "ball.pixel": project(camera, position[:, None])[0][:, 0],
        "ball.score": np.ones(frames),
        "ball.position": position,
        "ball.velocity": velocity,
        "ball.position_cov": np.tile([0.01, 0, 0, 0.01, 0, 0.01], (frames, 1)),
        "ball.status": ["measured"] * frames,
        "ball.event": ["none"] * frames,
    }


def write_drawn_clip(folder: Path, scene: Scene, *, match: int, frames: int) -> None:
    """The tables of one clip, which is a match."""
    folder.mkdir(parents=True)
    camera = camera_of(frames)
    numbers = np.arange(frames)
    keys = {"clip_id": [folder.name] * frames, "frame_index": numbers, "video_frame": numbers}
    keys["timestamp"] = numbers / FPS
    spread = {"camera.position_cov": np.tile([1e-4, 0, 0, 1e-2, 1e-4, 4e-4], (frames, 1))}
    for name, value in (("inliers", np.full(frames, 9, np.int32)), ("reprojection_px", np.full(frames, 0.3))):
        spread[f"camera.{name}"] = value
    write_table(
        folder / "camera.parquet",
        table="camera",
        scene=scene,
        columns={
            **keys,
            "frame.is_duplicate": np.zeros(frames, bool),
            "frame.capture_time": numbers / FPS,
            **{f"camera.{name}": value.reshape(frames, -1) for name, value in vars(camera).items()},
            "camera.status": ["measured"] * frames,
            "camera.reason": [""] * frames,
            "camera.focal_std_px": np.full(frames, 2.0),
            **spread,
        },
    )
    bodies = {}
    for player, place, letter in zip(scene.players, (-11.0, 11.0), "AB", strict=False):
        place = place if scene.court is not None else 0.0
        bodies |= _player(player, place, frames, f"{match}{letter}", camera)
    write_table(folder / "players.parquet", table="players", scene=scene, columns={**keys, **bodies})
    if scene.ball is not None:
        write_table(folder / "ball.parquet", table="ball", scene=scene, columns={**keys, **_ball(frames, camera)})
    for table in ("captions", "events", "ball_shots"):
        if table in scene_tables(scene):
            kinds = {"string": object, "double": float, "float": float, "int32": np.int32, "int64": np.int64}
            empty = {
                column.name: np.zeros((0, column.size) if column.size else 0, kinds[column.type])
                for column in table_columns(table, scene)
            }
            write_table(folder / f"{table}.parquet", table=table, scene=scene, columns=empty)
    document = clip_document(folder.name, scene=scene, frames=frames) | {
        "match_id": folder.name,
        "width": SIZE[0],
        "height": SIZE[1],
        "shutter_s": SHUTTER_S,
        "ui_boxes_px": UI_BOXES[match % 2],
        "players": {},
        "solved_share": 1.0,
    }
    write_document(folder / "clip.json", "clip", document)


def claim_video(folder: Path, video: Path) -> None:
    """Let a clip's document name that video."""
    content = video.read_bytes()
    document = read_document(folder / "clip.json", "clip")
    document |= {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    document["source_path"] = f"../videos/{video.name}"
    write_document(folder / "clip.json", "clip", document)


def drawn_matches(out: Path, scene: str = "tennis", *, matches: int = 2, frames: int = FRAMES) -> Path:
    """A folder with `videos` and `work` of some matches of one clip of so many frames: `match0`, `match1`, ..."""
    loaded = load_scene(scene)
    for match in range(matches):
        folder = out / "work" / f"match{match}"
        write_drawn_clip(folder, loaded, match=match, frames=frames)
        claim_video(folder, draw_video(out / "videos" / f"match{match}.mp4", frames, match=match))
    return out


def packed(out: Path, options: PackOptions | None = None, **edges) -> Path:
    """The dataset of such a folder."""
    outcome = pack_work_folders([out / "work"], out / "dataset", options or PackOptions(videos="copy"), **edges)
    assert not outcome.problems, outcome.problems
    return out / "dataset"
