"""`pgm-calibrate` on one video: shots, court, and a camera for every frame, written as clip folders."""

import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pgm_data.convert.keypoints_csv import read_keypoints
from pgm_data.court import Court
from pgm_data.dataset.clip_camera import ClipCamera, write_clip_camera
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.files import sha256_of
from pgm_data.dataset.tables import write_table
from pgm_data.detect.court_network import CourtNetwork
from pgm_data.lift.clip_solve import LensOptions
from pgm_data.lift.plausible import TrustOptions
from pgm_data.scene import Scene, load_scene
from pgm_data.shots import MarkedFrame, capture_times, split_shots
from pgm_data.stages.court_finder import CourtFinder
from pgm_data.stages.court_search import SearchOptions
from pgm_data.stages.court_track import Marks, ShotTracker, TrackOptions
from pgm_data.stages.shot_cameras import ShotCameras
from pgm_data.stages.work_folder import SHOTS, commit, staging_folder
from pgm_data.video import VideoInfo, open_video

Quality = Literal["draft", "standard", "best"]


@dataclass(frozen=True, kw_only=True)
class Effort:
    """What a preset spends."""

    search: SearchOptions
    track: TrackOptions
    lines_every: int
    """Frames between two guesses from lines alone, where the network finds nothing."""
    fast_decode: bool
    """Whether the decoder may skip its deblocking filter."""


EFFORTS: dict[str, Effort] = {
    "draft": Effort(
        search=SearchOptions(samples=100, searches=(0.0085, 0.004, 0.0025)),
        track=TrackOptions(stride=5, detect_every=25, key_frames=32, refit_at=(12,)),
        lines_every=150,
        fast_decode=True,
    ),
    "standard": Effort(search=SearchOptions(samples=200), track=TrackOptions(), lines_every=75, fast_decode=False),
    "best": Effort(
        search=SearchOptions(samples=320, spacing_px=4.0),
        track=TrackOptions(key_frames=240, detect_every=5),
        lines_every=25,
        fast_decode=False,
    ),
}
"""The presets: browse an archive, work, publish."""


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """How videos are calibrated."""

    scene: str = "tennis"
    """Name of a scene that ships with pgm, or the path of a scene file."""
    quality: Quality = "standard"
    """draft browses an archive, standard is for work, best for publishing."""
    keypoints: str = ""
    """KEYPOINTS.csv with a person's court points, which override what is detected."""
    network: str = ""
    """ONNX file of a court network to use instead of the bundled one; `none` for lines alone."""
    overlay: bool = True
    """Whether overlay.mp4 is written."""


@dataclass(frozen=True, eq=False, kw_only=True)
class VideoOutcome:
    """What became of one video."""

    video: str
    """The file."""
    clips: tuple[str, ...]
    """Clips written."""
    frames: int
    """Frames decoded."""
    measured: int
    interpolated: int
    trouble: str
    """What was wrong with the file; empty when all of it decoded."""
    seconds: float
    reprojection_px: float | None
    """Median over measured frames."""
    peak_memory_mb: float


def run_job(arguments: dict, report: Callable[[dict], None]) -> dict:
    """`calibrate_video` for the stage supervisor: JSON in, JSON out."""
    # The supervisor shares the cores among its workers in this way; the count is no argument, since a job that is done
    # stays done when the next run has other workers.
    threads = int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2)
    outcome = calibrate_video(
        Path(arguments["video"]),
        Path(arguments["work"]),
        stem=arguments["stem"],
        match_id=arguments["match_id"],
        options=CalibrateOptions(**arguments["options"]),
        source_path=arguments["source_path"],
        threads=threads,
        report=report,
    )
    return asdict(outcome)


def calibrate_video(
    video: Path,
    work: Path,
    *,
    stem: str,
    match_id: str,
    options: CalibrateOptions,
    source_path: str = "",
    threads: int = 2,
    report: Callable[[dict], None] = lambda _: None,
) -> VideoOutcome:
    """Calibrate one video into clip folders under the work folder.

    Every frame goes into the video's part of the shots, from which the caller puts `shots.parquet` together. Clip
    folders appear whole or not at all, and those of an earlier run on the video go.

    Args:
        video: The file.
        work: The work folder.
        stem: What its clips are called.
        match_id: The match it belongs to.
        options: How.
        source_path: The video as its clips name it; from the work folder's parent, else its name, when empty.
        threads: Of the decoder.
        report: Told about progress now and then.

    Raises:
        VideoError: If the file is not a readable video.
        ValueError: If the scene has no court or the options do not fit.
    """
    start = time.monotonic()
    source = source_path or _relative(video, work)
    scene = load_scene(options.scene)
    if scene.court is None:
        raise ValueError(f"scene {scene.name}: expected a court to calibrate by, found none declared")
    effort = EFFORTS[options.quality]
    marks = _marks_of(video, Path(options.keypoints), scene.court) if options.keypoints else {}
    network = network_of(scene.court, options.network)
    shots: list[ShotCameras] = []
    rows, unused = _ShotRows(), set(marks)
    with open_video(video, threads=threads, fast=effort.fast_decode) as reader, ExitStack() as spools:
        info = reader.info
        size = (info.width, info.height)
        finder = CourtFinder(scene.court, network=network, size=size, marks=marks, lines_every=effort.lines_every)

        def tracker() -> ShotTracker:
            made = ShotTracker(
                court=court,
                fixed_centre=scene.camera_position == "fixed",
                size=size,
                search=effort.search,
                trust=TrustOptions(),
                track=effort.track,
                lens=LensOptions(),
                find=finder,
                marks=marks,
                spool_folder=work,
            )
            spools.callback(made.spool.close)
            finder.new_shot()
            return made

        def keep(shot: ShotCameras) -> None:
            if shot.solved:
                shots.append(shot)
            else:  # Nothing of it is needed again; an archive holds hours of such shots.
                rows.judge(shot, "")

        court = scene.court
        current: ShotTracker | None = None
        number = -1
        for marked in split_shots(reader):
            frame = marked.frame
            if marked.is_transition or marked.shot != number:
                if current is not None:
                    keep(current.finish())
                    current = None
                number = marked.shot
            if not marked.is_transition:
                if current is None:
                    current = tracker()
                finder.look_at(frame)
                unused.discard(frame.video_frame)
                current.add(
                    video_frame=frame.video_frame,
                    timestamp=frame.timestamp,
                    is_duplicate=marked.is_duplicate,
                    luma=frame.luma,
                )
            rows.add(marked)
            if frame.video_frame % 50 == 49:
                report({"progress": frame.video_frame + 1, "total": info.claimed_frames})
        if current is not None:
            keep(current.finish())
        trouble = "; ".join(filter(None, [reader.trouble, _unused_marks(unused, len(rows.video_frame))]))
    clips = _clip_names(shots, stem)
    written = tuple(c for c in clips if c)
    with staging_folder(work, stem) as staging:
        for shot, clip_id in zip(shots, clips, strict=True):
            rows.judge(shot, clip_id)
            if clip_id:
                about = _clip_document(clip_id, shot, video, source, info, match_id, scene, options)
                _write_clip(staging / clip_id, shot, about, scene=scene)
        rows.write(staging / SHOTS, video=source, scene=scene)
        if options.overlay and written:
            from pgm_data.stages.overlay import write_overlays

            write_overlays(staging, written, video=video, scene=scene)
        if written:
            from pgm_data.stages.report import write_clip_report

            for clip_id in written:
                write_clip_report(staging, clip_id)
        commit(staging, work, stem, written)
    solved = [s for s, c in zip(shots, clips, strict=True) if c]
    residuals = np.concatenate([s.reprojection_px for s in solved]) if solved else np.zeros(0)
    residuals = residuals[np.isfinite(residuals)]
    return VideoOutcome(
        video=str(video),
        clips=written,
        frames=len(rows.video_frame),
        measured=sum(int((s.status == "measured").sum()) for s in solved),
        interpolated=sum(int((s.status == "interpolated").sum()) for s in solved),
        trouble=trouble,
        seconds=time.monotonic() - start,
        reprojection_px=float(np.median(residuals)) if len(residuals) else None,
        peak_memory_mb=_peak_memory_mb(),
    )


def network_of(court: Court, wanted: str) -> CourtNetwork | None:
    """The court's network; None where the scene has none or lines alone are wanted."""
    if wanted == "none" or not (wanted or court.network):
        return None
    path = Path(wanted) if wanted else None
    return CourtNetwork.load(path, network_file=court.network, names=court.all_names)


def names_video(name: str, video: Path) -> bool:
    """Whether a row of KEYPOINTS.csv is about the video: it has its file name, its stem, or its path's end."""
    return name in (video.name, video.stem) or video.as_posix().endswith("/" + name.removeprefix("./"))


def _unused_marks(frames: set[int], decoded: int) -> str:
    """What is wrong with marked frames that no shot has; empty for none."""
    if not frames:
        return ""
    listed = ", ".join(str(frame) for frame in sorted(frames)[:5]) + (" ..." if len(frames) > 5 else "")
    return f"keypoints: expected frames of its shots ({decoded} frames decoded), got {listed}"


def _marks_of(video: Path, path: Path, court: Court) -> dict[int, Marks]:
    """A person's marks for this video, by frame: rows that name its file name, its stem, or its path's end."""
    marks = read_keypoints(path, court)
    names = np.array([names_video(name, video) for name in marks.video], dtype=bool)
    found: dict[int, Marks] = {}
    for frame in np.unique(marks.frame[names]):
        rows = names & (marks.frame == frame)
        found[int(frame)] = Marks(points_world=court.all_world[marks.name_index[rows]], pixels=marks.pixels[rows])
    return found


class _ShotRows:
    """The rows of `shots.parquet` of one video."""

    def __init__(self) -> None:
        self.video_frame: list[int] = []
        self.timestamp: list[float] = []
        self.verdict: list[str] = []
        self.reason: list[str] = []
        self.clip_id: list[str] = []

    def add(self, marked: MarkedFrame) -> None:
        """A decoded frame, before its shot is solved."""
        self.video_frame.append(marked.frame.video_frame)
        self.timestamp.append(marked.frame.timestamp)
        self.verdict.append("transition" if marked.is_transition else "other")
        self.reason.append("transition between shots" if marked.is_transition else "no court found")
        self.clip_id.append("")

    def judge(self, shot: ShotCameras, clip_id: str) -> None:
        """What became of a shot's frames."""
        for frame, reason in zip(shot.video_frame, shot.reason, strict=True):
            at = int(frame) - self.video_frame[0]
            self.verdict[at], self.clip_id[at] = ("clip", clip_id) if clip_id else ("other", "")
            self.reason[at] = "" if clip_id else str(reason)

    def write(self, path: Path, *, video: str, scene: Scene) -> None:
        """Write the video's part of `shots.parquet`."""
        columns = {
            "video": [video] * len(self.video_frame),
            "video_frame": np.array(self.video_frame, dtype=np.int64),
            "timestamp": np.array(self.timestamp),
            "verdict": self.verdict,
            "reason": self.reason,
            "clip_id": self.clip_id,
        }
        write_table(path, table="shots", scene=scene, columns=columns)


def _clip_names(shots: list[ShotCameras], stem: str) -> list[str]:
    """The clip of each shot; empty for shots without a camera."""
    solved = sum(s.solved for s in shots)
    names, number = [], 0
    for shot in shots:
        names.append("" if not shot.solved else stem if solved == 1 else f"{stem}.{number:02d}")
        number += shot.solved
    return names


def _write_clip(folder: Path, shot: ShotCameras, document: dict[str, Any], *, scene: Scene) -> None:
    """Write one clip's camera and document into its new folder."""
    folder.mkdir()
    track = ClipCamera(
        clip_id=folder.name,
        video_frame=shot.video_frame,
        timestamp=shot.timestamp,
        is_duplicate=shot.is_duplicate,
        capture_time=capture_times(shot.timestamp, shot.is_duplicate),
        camera=shot.camera.as_camera(),
        status=shot.status,
        reason=shot.reason,
        inliers=shot.inliers.astype(np.int32),
        reprojection_px=shot.reprojection_px,
        position_cov=shot.position_cov,
        focal_std_px=shot.focal_std_px,
    )
    write_clip_camera(folder, track, scene=scene)
    write_document(folder / "clip.json", "clip", document)


def _clip_document(
    clip_id: str,
    shot: ShotCameras,
    video: Path,
    source: str,
    info: VideoInfo,
    match_id: str,
    scene: Scene,
    options: CalibrateOptions,
) -> dict[str, Any]:
    has = shot.status != "none"
    focal = shot.camera.focal_px[has]
    solution = shot.solution
    if solution is None:
        lens, why = "radial", "a moving camera: each frame by itself, with the radial term it was found with"
    else:
        lens, why = solution.lens_model, solution.evidence
    variance = np.nanmean(shot.position_cov[has][:, [0, 3, 5]], axis=0)
    position = np.mean(shot.camera.position_world[has], axis=0)
    camera: dict[str, Any] = {
        "position_world": [float(v) for v in position],
        "position_std": [float(v) for v in np.sqrt(np.maximum(variance, 0))],
        "jitter_px": shot.jitter_px,
        "focal_px_range": [float(focal.min()), float(focal.max())],
        "principal_point": [float(v) for v in shot.camera.principal_px[has][0]],
        "evidence": why,
    }
    return {
        "clip_id": clip_id,
        "match_id": match_id,
        "source_path": source,
        "sha256": sha256_of(video),
        "bytes": video.stat().st_size,
        "width": info.width,
        "height": info.height,
        "time_base": info.time_base,
        "first_video_frame": int(shot.video_frame[0]),
        "n_frames": len(shot.video_frame),
        "scene": scene.name,
        "quality": options.quality,
        "lens_model": {"model": lens, "reason": why},
        "shutter_s": None,
        "ui_boxes_px": [],
        "players": {p.name: {"identity": None, "handedness": None} for p in scene.players},
        "camera": camera,
        "solved_share": float(has.mean()),
    }


def _relative(video: Path, work: Path) -> str:
    """The video's path as clips name it: from the work folder's parent where it lies under it, else its name."""
    try:
        return "../" + video.resolve().relative_to(work.resolve().parent).as_posix()
    except ValueError:
        return video.name


def _peak_memory_mb() -> float:
    # The kernel's own figure for a process starts at that of the process which started it.
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
