"""Pictures from where no camera ever was, beside the simulator's own of the same state from there.

A judged frame's camera is turned about the point of its axis that is nearest to the middle of play: to the left, to the
right, and upwards, until it is far from every camera that the model has seen of the match. The seen view is judged
against the simulator's picture as well, not against the video's, so that only the camera differs.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_models.image_metrics import mean_in, psnr_of_error, squared_errors
from pgm_models.synthesis.camera_paths import play_area
from pgm_models.synthesis.evaluate_frames import judged_pixels
from pgm_models.synthesis.evaluate_maker import RunMaker
from pgm_models.synthesis.evaluate_truth import TruePixels
from pgm_models.synthesis.frames import FrameStore
from pgm_models.synthesis.novel_view_pictures import ClipAgain, clips_again, simulated_run
from pgm_models.synthesis.object_boxes import scaled_K

DIRECTIONS = ("left", "right", "up")
STEP_DEG = 1.0
"""By which a camera is turned on until it is far enough from all that were seen."""
SAME_M, SAME_PX = 1e-3, 1e-2
"""Cameras that differ by less in what their rows hold, metres and pixels, are the same."""


@dataclass(frozen=True, kw_only=True)
class NovelOptions:
    """Which views are judged."""

    frames: int = 4
    """Of all judged ones, evenly spread; 0 for none."""
    least_m: float = 3.0
    """Metres from the nearest camera that was seen."""
    least_deg: float = 10.0
    """Degrees between directions to the middle of what is looked at, from any camera that was seen."""
    most_deg: float = 45.0
    """Degrees by which a camera is turned at most; where that is not enough, its direction is left out."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NovelView:
    """One view."""

    place: str
    """Clip and frame."""
    direction: str
    """Where the camera was moved; `seen` where it was not."""
    moved_m: float
    """From its place."""
    turned_deg: float
    psnr: Mapping[str, float]
    """dB, by `frame` and object; NaN where the view shows nothing of it."""


def novel_views(
    maker: RunMaker,
    judged: Int[np.ndarray, " judged"],
    learned: Int[np.ndarray, " learned"],
    work: Path,
    options: NovelOptions,
    *,
    show: Callable[[str], None] = lambda line: None,
    keep: Callable[[NovelView, np.ndarray, np.ndarray], None] = lambda view, real, made: None,
) -> tuple[NovelView, ...]:
    """Seen and novel views of some judged frames.

    Args:
        maker: Makes pictures of judged frames.
        judged: Rows that views are chosen from.
        learned: Rows whose cameras were seen.
        work: The work folder that the simulator wrote the frames' clips into.
        options: Which views.
        show: Is told what is being done.
        keep: Is told each view with its real and its made picture, channels first.

    Raises:
        ValueError: If the folder is not the simulator's, or it draws another camera than the tables tell of.
    """
    store = maker.store
    chosen = judged[np.unique(np.linspace(0, len(judged) - 1, options.frames).round().astype(np.int64))]
    by_clip: dict[str, list[int]] = {}
    for row in chosen.tolist():
        by_clip.setdefault(store.clips[int(store.clip[row])].clip_id, []).append(row)
    views: list[NovelView] = []
    for clip, again in clips_again(simulated_run(work), list(by_clip)):
        for row in by_clip[clip]:
            show(f"novel views: {store.place(row)}")
            seen = _seen_cameras(store, row, learned)
            for view, real, made in _views_of(maker, row, again, seen, options):
                keep(view, real, made)
                views.append(view)
    return tuple(views)


def _seen_cameras(store: FrameStore, row: int, learned: Int[np.ndarray, " learned"]) -> Camera:
    """Of the frames of the match that the model has learned from; the frame's own where there are none."""
    matches = np.array(store.matches)
    own = learned[matches[store.clip[learned]] == matches[store.clip[row]]]
    return store.cameras[own if len(own) else np.array([row])]


def _views_of(
    maker: RunMaker, row: int, again: ClipAgain, seen: Camera, options: NovelOptions
) -> Iterator[tuple[NovelView, np.ndarray, np.ndarray]]:
    """The views of a frame, each with its real and its made picture."""
    store = maker.store
    clip = store.clips[int(store.clip[row])]
    own = store.cameras[row]
    low, high = play_area(store.scene)
    aim = aim_of(own, 0.5 * (low + high))
    factor = clip.factor(store.size)
    _refuse_other(again.camera(int(store.frame[row])), replace(own, K=scaled_K(own.K, 1 / factor)), store.place(row))
    poses = [("seen", own, 0.0)]
    for direction in DIRECTIONS:
        found = moved_camera(own, aim, direction, seen, options)
        if found is not None:
            poses.append((direction, *found))
    for direction, camera, turned in poses:
        drawn = again.draw(int(store.frame[row]), replace(camera, K=scaled_K(camera.K, 1 / factor)))
        real = _resized(drawn.rgb, store.size)
        truth = TruePixels(labels=drawn.labels, depth=np.zeros(drawn.labels.shape))
        picture = maker.studio(row).picture(camera, store.states([row], maker.model.device))
        made = picture.rgb.clamp(0.0, 1.0).cpu().numpy()
        view = NovelView(
            place=store.place(row),
            direction=direction,
            moved_m=float(np.linalg.norm(camera.position_world - own.position_world)),
            turned_deg=turned,
            psnr=view_psnr(store, row, made, real, truth),
        )
        yield view, real, made


def _refuse_other(drawn: Camera, told: Camera, place: str) -> None:
    """Raise ValueError where the simulator now draws another camera than it once did."""
    for name, most in (("K", SAME_PX), ("R_cam_from_world", SAME_M), ("t_cam_from_world", SAME_M)):
        one, other = getattr(drawn, name), getattr(told, name)
        if not np.abs(one - other).max() <= most:
            raise ValueError(
                f"{place}: camera.{name}: expected {other.ravel().round(4).tolist()}, as when it was drawn, got "
                f"{one.ravel().round(4).tolist()} of the simulator: another version of it drew these pictures"
            )


def view_psnr(
    store: FrameStore,
    row: int,
    made: Float[np.ndarray, "3 height width"],
    real: Float[np.ndarray, "3 height width"],
    truth: TruePixels,
) -> dict[str, float]:
    """PSNR of a view, dB: of the whole frame and of the pixels that show each object but the ball."""
    judged = judged_pixels(store, row)
    error = squared_errors(made[None], real[None])
    masks: dict[str, Bool[np.ndarray, "height width"]] = {"frame": np.ones_like(judged)}
    for number, thing in enumerate(store.scene.objects):
        if thing.kind != "ball":
            masks[thing.name] = truth.mask(-1 if thing.kind == "skybox" else number, store.size)
    return {name: float(psnr_of_error(mean_in(error, (mask & judged)[None]))[0]) for name, mask in masks.items()}


def aim_of(camera: Camera, middle: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """The point of a camera's axis that is nearest to a place, world metres."""
    forward = camera.R_cam_from_world[2]
    return camera.position_world + forward * float(forward @ (middle - camera.position_world))


def moved_camera(
    camera: Camera, aim: Float[np.ndarray, " 3"], direction: str, seen: Camera, options: NovelOptions
) -> tuple[Camera, float] | None:
    """The camera turned about a point as little as makes it a novel one, and by how many degrees; None if it cannot be.

    Args:
        camera: One.
        aim: The point, world metres.
        direction: Where it goes: `left`, `right` or `up`.
        seen: The cameras it must be far from.
        options: How far.
    """
    for degrees in np.arange(options.least_deg, options.most_deg + 1e-9, STEP_DEG):
        found = turned_about(camera, aim, direction, float(degrees))
        if found.R_cam_from_world[1, 2] > -0.1:
            return None  # it would look straight down
        towards, others = found.position_world - aim, seen.position_world - aim
        cosine = others @ towards / (np.linalg.norm(others, axis=1) * np.linalg.norm(towards))
        # A hair less, so that a camera turned by just so much counts.
        apart = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) >= options.least_deg - 1e-6
        far = np.linalg.norm(others - towards, axis=1) >= options.least_m
        if bool((apart & far).all()):
            return found, float(degrees)
    return None


def turned_about(camera: Camera, aim: Float[np.ndarray, " 3"], direction: str, degrees: float) -> Camera:
    """The camera carried round a point by an angle, with which it turns: it keeps what it looks at in its middle."""
    # Towards the right of its picture it goes round the vertical anticlockwise as seen from above.
    axis = {"left": [0.0, 0.0, -1.0], "right": [0.0, 0.0, 1.0], "up": -camera.R_cam_from_world[0]}[direction]
    Q = rotation_from_rotvec(np.radians(degrees) * np.asarray(axis, dtype=np.float64))
    R = camera.R_cam_from_world @ Q.T
    centre = aim + Q @ (camera.position_world - aim)
    return replace(camera, R_cam_from_world=R, t_cam_from_world=-R @ centre)


def _resized(rgb: np.ndarray, size: tuple[int, int]) -> Float[np.ndarray, "3 height width"]:
    import cv2

    if (rgb.shape[1], rgb.shape[0]) != size:
        rgb = cv2.resize(np.ascontiguousarray(rgb), size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(rgb.transpose(2, 0, 1)).astype(np.float32) / np.float32(255)


def novel_drops(views: Sequence[NovelView]) -> dict[str, tuple[float, float]]:
    """Mean PSNR of seen and of novel views, dB, by `frame` and object; NaN where either shows nothing of it."""
    found = {}
    for name in dict.fromkeys(name for view in views for name in view.psnr):
        pair = []
        for novel in (False, True):
            values = [view.psnr[name] for view in views if (view.direction != "seen") == novel]
            there = [value for value in values if not np.isnan(value)]
            pair.append(float(np.mean(there)) if there else float("nan"))
        found[name] = (pair[0], pair[1])
    return found
