"""A clip in a 3D viewer in the browser: court, ball, players and camera, with a slider over its frames.

The viewer is viser (extra `viz`), imported by whoever makes the server: here it is an argument.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import UInt8

from pgm_data.stages.viewer_scene import (
    HITTER_COLOURS,
    RGB,
    ClipScene,
    ellipsoid,
    flight_segments,
    frustum,
    hitter_colours,
    net_segments,
)
from pgm_data.video import open_video

if TYPE_CHECKING:
    import viser  # pyright: ignore[reportMissingImports] of the extra viz

EVENT_COLOURS = {"hit": (255, 70, 70), "bounce": (40, 160, 255), "net": (230, 70, 230)}
BALL_COLOUR = (220, 240, 60)
MARK_M = 0.08
"""Radius of an event's mark: larger than a ball, to be seen."""
LEAST_BALL_M = 0.06
"""Least radius of the ball as drawn: one of true size would not be seen."""
PICTURE_WIDTH = 480
FALLBACK_SIZE = (16, 9)
STEP_S = 0.02
"""Longest wait between two looks at the clock while playing."""


class ClipViewer:
    """One clip on a server; `show` moves it to a frame, `advance` plays it."""

    def __init__(
        self, server: "viser.ViserServer", clip: ClipScene, pictures: tuple[UInt8[np.ndarray, " bytes"], ...] = ()
    ):
        self.server = server
        self.clip = clip
        self.pictures = pictures
        self.frame = 0
        self.clock = 0.0
        """Seconds since the clip's first frame, while playing."""
        self._build()
        self._controls()
        self.show(0)

    def _build(self) -> None:
        """What stands still, and what `show` moves."""
        scene, clip = self.server.scene, self.clip
        scene.reset()
        scene.set_up_direction("+z")
        court = clip.scene.court
        if court is not None:
            self._lines("/court/lines", court.lines_world, (120, 200, 110), 2.0)
            self._lines("/court/net", net_segments(court), (150, 150, 160), 1.0)
        if clip.paths is not None and clip.ball is not None:
            for hitter, colour in hitter_colours(clip.paths).items():
                name = hitter.replace(" ", "_") or "unknown"
                self._lines(f"/flights/{name}", flight_segments(clip.paths, hitter), colour, 3.0)
            self._events()
        radius = max(clip.scene.ball.radius_m if clip.scene.ball is not None else 0.0, LEAST_BALL_M)
        self.ball = scene.add_icosphere("/ball/now", radius=radius, color=BALL_COLOUR, visible=False)
        self.shadow = scene.add_icosphere("/ball/shadow", radius=0.5 * radius, color=(40, 40, 40), visible=False)
        self.doubt = scene.add_icosphere("/ball/doubt", radius=1.0, color=BALL_COLOUR, opacity=0.25, visible=False)
        self.bones = [
            scene.add_line_segments(
                f"/players/{player.name}",
                points=np.zeros((1, 2, 3), np.float32),
                colors=HITTER_COLOURS[1 + i % (len(HITTER_COLOURS) - 1)],
                thickness=4.0,
                thickness_units="screen",
                visible=False,
            )
            for i, player in enumerate(clip.scene.players[: clip.bones.shape[1]])
        ]
        width, height = clip.size or FALLBACK_SIZE
        self.frustum = scene.add_camera_frustum("/camera", fov=0.5, aspect=width / height, scale=1.5, visible=False)

    def _lines(self, name: str, points: np.ndarray, colour: RGB, width: float) -> None:
        if len(points):
            self.server.scene.add_line_segments(
                name, points=points.astype(np.float32), colors=colour, thickness=width, thickness_units="screen"
            )

    def _events(self) -> None:
        assert self.clip.ball is not None
        events = self.clip.ball.events
        for i in range(len(events.time)):
            kind = str(events.kind[i])
            if kind in EVENT_COLOURS and np.isfinite(events.position[i]).all():
                self.server.scene.add_icosphere(
                    f"/events/{i:04d}_{kind}",
                    radius=MARK_M,
                    color=EVENT_COLOURS[kind],
                    position=events.position[i],
                    opacity=0.4 + 0.6 * float(np.nan_to_num(events.probability[i])),
                )

    def _controls(self) -> None:
        gui = self.server.gui
        last = len(self.clip.capture_time) - 1
        self.slider = gui.add_slider("Frame", min=0, max=max(last, 1), step=1, initial_value=0, disabled=last < 1)
        self.play = gui.add_checkbox("Play", False)
        self.speed = gui.add_slider("Speed", min=0.1, max=2.0, step=0.1, initial_value=1.0)
        self.text = gui.add_markdown("")
        self.slider.on_update(lambda _: self.show(int(self.slider.value)))

    def show(self, frame: int) -> None:
        """Move ball, players and camera to a frame; what it does not have is hidden."""
        frame = min(max(frame, 0), len(self.clip.capture_time) - 1)
        self.frame = frame
        if self._frame_at(self.clock) != frame:  # chosen by hand
            self.clock = float(self.clip.capture_time[frame] - self.clip.capture_time[0])
        with self.server.atomic():
            self._show_ball(frame)
            for i, handle in enumerate(self.bones):
                bones = self.clip.bones[frame, i]
                bones = bones[np.isfinite(bones).all(axis=(1, 2))]
                handle.visible = len(bones) > 0
                if len(bones):
                    handle.points = bones.astype(np.float32)
            self._show_camera(frame)
        self.text.content = self.said(frame)

    def _show_ball(self, frame: int) -> None:
        ball = self.clip.ball
        placed = ball is not None and ball.status[frame] != "none"
        for handle in (self.ball, self.shadow, self.doubt):
            handle.visible = bool(placed)
        if ball is None or not placed:
            return
        place = ball.position[frame]
        wxyz, half_axes = ellipsoid(ball.position_cov[frame], least_m=1e-3)
        self.ball.position = self.doubt.position = place
        self.shadow.position = place * [1, 1, 0]
        self.doubt.wxyz = wxyz
        self.doubt.scale = tuple(half_axes.tolist())

    def _show_camera(self, frame: int) -> None:
        track = self.clip.camera
        seen = track is not None and self.clip.size is not None and bool(track.has_camera[frame])
        self.frustum.visible = seen
        if track is None or self.clip.size is None or not seen:
            return
        wxyz, position, fov = frustum(track, frame, self.clip.size)
        self.frustum.wxyz, self.frustum.position, self.frustum.fov = wxyz, position, fov
        if frame < len(self.pictures):
            bgr = cv2.imdecode(self.pictures[frame], cv2.IMREAD_COLOR)
            if bgr is not None:
                self.frustum.image = np.ascontiguousarray(bgr[:, :, ::-1])

    def said(self, frame: int) -> str:
        """A few lines about a frame."""
        rows = [f"**{self.clip.clip_id}**", f"frame {frame}, {self.clip.capture_time[frame]:.3f} s"]
        ball = self.clip.ball
        if ball is not None and ball.status[frame] != "none":
            speed = 3.6 * float(np.linalg.norm(ball.velocity[frame]))
            x, y, z = ball.position[frame]
            std = np.sqrt(np.maximum(np.linalg.eigvalsh(ball.position_cov[frame]), 0.0))[-1]
            rows.append(f"ball {ball.status[frame]}: {x:.2f}, {y:.2f}, {z:.2f} m ± {std:.2f}, {speed:.0f} km/h")
        elif ball is not None:
            rows.append("ball: none")
        return "  \n".join(rows)

    def advance(self, seconds: float) -> None:
        """Play on by so many seconds of the reader's clock, from the start again after the end."""
        times = self.clip.capture_time
        if not self.play.value or len(times) < 2 or not times[-1] > times[0]:
            return
        # The last frame lasts as long as another.
        span = float(times[-1] - times[0]) * len(times) / (len(times) - 1)
        self.clock = (self.clock + seconds * float(self.speed.value)) % span
        self.slider.value = self._frame_at(self.clock)

    def _frame_at(self, clock: float) -> int:
        times = self.clip.capture_time
        return int(np.searchsorted(times - times[0], clock, side="right")) - 1


def run_viewer(
    server: "viser.ViserServer",
    clips: dict[str, Callable[[], ClipViewer]],
    *,
    first: str,
    until: Callable[[], bool],
) -> None:
    """Show clips until told to end, the first of them to begin with; others are chosen from a list.

    Args:
        server: Where.
        clips: For each clip what makes its viewer.
        first: Clip to begin with.
        until: Whether to end; asked many times a second.
    """
    wanted = first
    while not until():
        shown = wanted
        server.gui.reset()
        viewer = clips[shown]()
        if len(clips) > 1:
            chooser = server.gui.add_dropdown("Clip", options=tuple(clips), initial_value=shown, order=-1.0)
        else:
            chooser = None
        before = time.monotonic()
        while not until() and wanted == shown:
            time.sleep(STEP_S)
            now = time.monotonic()
            viewer.advance(now - before)
            before = now
            wanted = chooser.value if chooser is not None else shown


def frame_pictures(video: Path, clip: ClipScene) -> tuple[UInt8[np.ndarray, " bytes"], ...]:
    """The clip's frames of its video, small, as JPEG.

    Raises:
        VideoError: If the file cannot be read.
        ValueError: If it does not hold the clip's frames.
    """
    assert clip.camera is not None
    wanted = clip.camera.video_frame
    found: list[np.ndarray] = []
    with open_video(video) as reader:
        for frame in reader:
            if len(found) < len(wanted) and frame.video_frame == wanted[len(found)]:
                small = frame.small_bgr(min(reader.info.width, PICTURE_WIDTH))
                found.append(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].reshape(-1))
            if len(found) == len(wanted):
                break
    if len(found) != len(wanted):
        raise ValueError(f"{video}: expected frame {wanted[len(found)]} of the video, got its end")
    return tuple(found)
