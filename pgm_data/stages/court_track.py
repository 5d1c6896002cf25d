"""One shot's cameras: found once, followed from frame to frame, and solved together when the shot ends."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.detect.lines import LineLook
from pgm_data.lift.clip_fit import ClipFitOptions
from pgm_data.lift.clip_solve import (
    ClipSolution,
    FrameCameras,
    LensOptions,
    key_frames,
    solve_frames,
    solve_moving,
    solve_shared,
)
from pgm_data.lift.court_camera import PARAMETERS, CourtCamera, project
from pgm_data.lift.line_fit import FREE_LENS, FREE_POSE, TURN, Sightings, fit_track
from pgm_data.lift.plausible import TrustOptions, camera_trust, frame_trust, line_counts
from pgm_data.shots import capture_times
from pgm_data.stages.court_search import SearchOptions, Sight, best_sight, judged, observe, settle
from pgm_data.stages.court_spool import Spool, packed, unpacked
from pgm_data.stages.shot_cameras import ShotCameras, blank_track, bridge, jitter, set_frames

BETWEEN = "between measured frames"


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """How a shot is followed."""

    stride: int = 1
    """Every how many frames one is measured; those between are interpolated."""
    detect_every: int = 12
    """Most frames between two attempts to find a court that is not in view; the pauses double up to that."""
    key_frames: int = 60
    """Frames that carry the shared solution."""
    bridge_s: float = 0.5
    """Longest gap that is interpolated, seconds."""
    least_frames: int = 5
    """Fewest measured frames of a clip, where the shot is longer than that."""
    refit_at: tuple[int, ...] = (12, 48, 192, 768)
    """Counts of measured frames at which the working centre and lens are solved again."""
    mark_sigma_px: float = 0.7
    """Standard deviation of a person's marks, pixels."""
    chunk: int = 200
    """Frames solved at once."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Marks:
    """A person's court points in one frame."""

    points_world: Float[np.ndarray, "points 3"]
    pixels: Float[np.ndarray, "points 2"]


@dataclass
class _Rows:
    """What is kept of every frame while a shot goes on."""

    video_frame: list[int] = field(default_factory=list)
    timestamp: list[float] = field(default_factory=list)
    is_duplicate: list[bool] = field(default_factory=list)
    place: list[int] = field(default_factory=list)
    """Place of the frame's sightings in the spool; -1 for none."""
    reason: list[str] = field(default_factory=list)


class ShotTracker:
    """Follows one shot; feed it frames in order, then `finish`."""

    def __init__(
        self,
        *,
        court: Court,
        fixed_centre: bool,
        size: tuple[int, int],
        search: SearchOptions,
        trust: TrustOptions,
        track: TrackOptions,
        lens: LensOptions,
        find: Callable[[int], Iterable[CourtCamera]],
        marks: Mapping[int, Marks],
        spool_folder: Path | None,
    ) -> None:
        """Start a shot.

        Args:
            court: The court.
            fixed_centre: Whether the camera turns about one centre.
            size: Picture width and height.
            search: How much is measured in a picture.
            trust: What is believed.
            track: How the shot is followed.
            lens: When lens parameters are fitted.
            find: First cameras for the frame that was just added (its video frame number is given), best first.
            marks: A person's court points, by video frame.
            spool_folder: Where measurements are kept meanwhile.
        """
        self.court, self.fixed, self.size = court, fixed_centre, size
        self.search, self.trust, self.track, self.lens = search, trust, track, lens
        self.find, self.marks = find, marks
        self.lines = len(court.line_names)
        self.rows = _Rows()
        # Room for a spread of samples and a person's marks.
        self.spool = Spool(int(search.samples * 1.1) + 2 * len(court.all_names) + 8, spool_folder)
        self.found: list[np.ndarray] = []
        self.readable: list[np.ndarray] = []
        self.camera: CourtCamera | None = None
        self.samples = None
        self.samples_at = np.zeros(0)
        self.look: LineLook | None = None
        self.last_measured = -1
        self.next_try = 0
        self.patience = 1
        self.pending: list[tuple[int, np.ndarray]] = []
        self.passed_over: tuple[int, np.ndarray] | None = None
        self.lost_reason = "no court found"

    def add(self, *, video_frame: int, timestamp: float, is_duplicate: bool, luma: np.ndarray) -> None:
        """The shot's next frame."""
        rows, index = self.rows, len(self.rows.place)
        rows.video_frame.append(video_frame)
        rows.timestamp.append(timestamp)
        rows.is_duplicate.append(is_duplicate)
        rows.place.append(-1)
        rows.reason.append("")
        if video_frame in self.marks:
            self._use_marks(index, luma, self.marks[video_frame])
            return
        if is_duplicate and index > 0:
            rows.place[index], rows.reason[index] = rows.place[index - 1], rows.reason[index - 1]
            return
        if self.camera is not None:
            if self.last_measured >= 0 and index - self.last_measured < self.track.stride:
                rows.reason[index] = BETWEEN
                self.passed_over = (index, luma.copy())
                return
            if self._follow(index, luma):
                return
            self.next_try = index
        self._look(index, luma)

    def _look(self, index: int, luma: np.ndarray, shown: int | None = None) -> None:
        """Try to find the court afresh, not too often; on success go back over the frames that had to wait.

        `shown`: row of the frame just added, where that is another one that repeats this picture.
        """
        self.rows.reason[index] = self.lost_reason
        if index < self.next_try:
            self.pending.append((index, luma.copy()))
            self.pending = self.pending[-self.track.detect_every :]
            return
        firsts = self.find(self.rows.video_frame[index if shown is None else shown])
        sight = best_sight(luma, firsts, self.court, options=self.search, trust=self.trust)
        if sight is None or sight.reason:
            self.lost_reason = "no court found" if sight is None else sight.reason
            self.rows.reason[index] = self.lost_reason
            self.next_try = index + self.patience
            self.patience = min(2 * self.patience, self.track.detect_every)
            self.pending = []
            return
        self.patience = 1
        self._record(index, sight)
        if self.fixed and len(self.found) > self.track.refit_at[0]:
            self._refit()  # One picture's centre is worse than the shot's.
        found = self.camera
        pending, self.pending = self.pending, []
        for earlier, picture in reversed(pending):
            if not self._follow(earlier, picture):
                break
        self.camera, self.last_measured, self.samples = found, index, None
        self.lost_reason = "no court found"

    def _follow(self, index: int, luma: np.ndarray) -> bool:
        """Measure the frame where the last camera expects the court; False when it is lost."""
        assert self.camera is not None
        camera, width = self.camera, self.size[0]
        view = project(camera, self.court.points_world)
        moved = self.samples is None or not np.nanmax(np.abs(view - self.samples_at), initial=0.0) < 3.0
        observation = observe(
            luma,
            camera,
            self.court,
            search_px=max(self.search.follow * width, 3.0),
            options=self.search,
            samples=None if moved else self.samples,
            look=self.look,
        )
        if moved:
            self.samples, self.samples_at = observation.samples, view
        if len(observation.sightings.line) >= 12:
            fit = fit_track(
                camera,
                observation.sightings,
                free=TURN if self.fixed else FREE_POSE,
                crooked_px=0.0 if self.fixed else self.search.crooked * width + 0.05,
                lines=self.lines,
                steps=5,
            )
            sight = judged(fit, observation, court=self.court, width=width, trust=self.trust)
            if not sight.reason:
                self._record(index, sight)
                return True
        sight = settle(luma, camera, self.court, options=self.search, trust=self.trust, keep_lens=True)
        if sight is not None and not sight.reason:
            self.samples = None
            self._record(index, sight)
            return True
        self.camera, self.samples = None, None
        return False

    def _record(self, index: int, sight: Sight) -> None:
        self.look = sight.observation.look
        self._keep(index, sight.camera, sight.observation.sightings, sight.observation.readable)

    def _keep(self, index: int, camera: CourtCamera, sightings: Sightings, readable: np.ndarray) -> None:
        self.rows.place[index] = self.spool.append(sightings)
        self.rows.reason[index] = ""
        self.found.append(packed(camera))
        self.readable.append(readable.astype(np.int16))
        self.camera, self.last_measured = camera, index
        if self.fixed and len(self.found) in self.track.refit_at:
            self._refit()

    def _refit(self) -> None:
        """Solve the working centre and lens again from frames seen so far."""
        track = unpacked(self.found, self.size)
        chosen = key_frames(track, 12)
        solution = self._shared(track[chosen], self.spool.read(chosen))
        last = len(self.found) - 1
        solved = solve_frames(track[[last]], self.spool.read([last]), solution=solution, lines=self.lines)
        if not camera_trust(solved.fit.camera[0], self.court, width=self.size[0], options=self.trust):
            self.camera, self.samples, self.look = solved.fit.camera[0], None, None

    def _shared(self, cameras: CourtCamera, sightings: Sightings) -> ClipSolution:
        options = ClipFitOptions(crooked_px=self.search.crooked * self.size[0])
        return solve_shared(cameras, sightings, court=self.court, size=self.size, fit_options=options, lens=self.lens)

    def _use_marks(self, index: int, luma: np.ndarray, marks: Marks) -> None:
        """A person's points decide this frame's camera; measured lines refine it where they agree."""
        points = _point_sightings(marks, self.track.mark_sigma_px)
        first = next(iter(self.find(self.rows.video_frame[index])), None)
        if first is None:
            self.rows.reason[index] = "the marked points fit no camera"
            return
        std = np.full(PARAMETERS, 1e6)
        std[7] = 0.03
        fit = fit_track(
            first, points, free=FREE_LENS, crooked_px=0.0, lines=self.lines, prior=(std, np.zeros(PARAMETERS))
        )
        reason = camera_trust(fit.camera, self.court, width=self.size[0], options=self.trust)
        if reason or not fit.inlier.mean() > 0.7:
            self.rows.reason[index] = f"the marked points fit no camera: {reason or 'they disagree with each other'}"
            return
        sight = settle(luma, fit.camera, self.court, options=self.search, trust=self.trust, keep_lens=True)
        if sight is not None and not sight.reason:
            off = np.linalg.norm(project(sight.camera, marks.points_world) - marks.pixels, axis=1)
            if np.sqrt(np.mean(off**2)) < 0.004 * self.size[0]:
                both = _joined(points, sight.observation.sightings)
                self._keep(index, sight.camera, both, sight.observation.readable)
                return
        self._keep(index, fit.camera, points, np.zeros(self.lines, int))

    def finish(self) -> ShotCameras:
        """Solve the shot's frames together."""
        rows = self.rows
        if self.camera is None and self.pending and all(rows.is_duplicate[self.pending[-1][0] + 1 :]):
            self.next_try = 0
            self._look(*self.pending.pop(), shown=len(rows.place) - 1)
        if self.camera is not None and self.passed_over is not None:
            last = self.passed_over[0]
            # Nothing measured comes after the shot's end to bridge to, so its last picture is measured.
            if all(rows.is_duplicate[last + 1 :]):
                self._follow(*self.passed_over)
        count = len(rows.place)
        for index in range(1, count):  # A picture found by looking back has repeats that were added before it.
            if rows.is_duplicate[index] and rows.video_frame[index] not in self.marks and rows.place[index] < 0:
                rows.place[index], rows.reason[index] = rows.place[index - 1], rows.reason[index - 1]
        place = np.array(rows.place, dtype=int)
        times = np.array(rows.timestamp)
        reason = np.array(rows.reason, dtype=object)
        pictures = count - sum(rows.is_duplicate[1:])
        least = min(self.track.least_frames, max(pictures // self.track.stride, 1))
        enough = len(self.found) >= least
        solution: ClipSolution | None = None
        blank = blank_track(count)
        inliers, rms = np.zeros(count, int), np.full(count, np.nan)
        cov, focal_std = np.full((count, 6), np.nan), np.full(count, np.nan)
        status = np.full(count, "none", dtype=object)
        if len(self.found) and not enough:
            reason[place >= 0] = f"court in view for only {len(self.found)} frames"
        if len(self.found) and enough:
            track = unpacked(self.found, self.size)
            if self.fixed:
                chosen = key_frames(track, self.track.key_frames)
                solution = self._shared(track[chosen], self.spool.read(chosen))
            # Frames looked back at were measured out of order: solve in the order of time.
            first = np.full(len(self.found), count)
            seen = np.flatnonzero(place >= 0)
            np.minimum.at(first, place[seen], seen)
            in_time = np.argsort(first, kind="stable")
            shows = np.split(seen[np.argsort(place[seen], kind="stable")], np.cumsum(np.bincount(place[seen]))[:-1])
            for start in range(0, len(in_time), self.track.chunk):
                these = in_time[start : start + self.track.chunk]
                sightings = self.spool.read(these)
                solved = self._solve(track[these], sightings, solution)
                verdicts = self._verdicts(solved, sightings, these)
                for offset, which in enumerate(these):
                    frames = shows[which]
                    if verdicts[offset]:
                        reason[frames] = verdicts[offset]
                        continue
                    status[frames], reason[frames] = "measured", ""
                    set_frames(blank, frames, solved.fit.camera[offset])
                    inliers[frames] = solved.fit.inlier[offset].sum()
                    rms[frames] = solved.fit.rms_px[offset]
                    cov[frames], focal_std[frames] = solved.position_cov[offset], solved.focal_std_px[offset]
            believed = np.unique(place[status == "measured"])
            if len(believed) < least:
                gone = status == "measured"
                status[gone], reason[gone] = "none", f"court in view for only {len(believed)} frames"
                set_frames(blank, gone, blank_track(1))
                inliers[gone], rms[gone], cov[gone], focal_std[gone] = 0, np.nan, np.nan, np.nan
            taken = capture_times(times, np.array(rows.is_duplicate, dtype=bool))
            bridge(blank, status, reason, cov, focal_std, taken, self.track.bridge_s, self.size[0])
            later = "the shot ends"
            for index in range(count - 1, -1, -1):
                if reason[index] != BETWEEN:
                    later = reason[index] or "the next measured frame is too far away"
                elif status[index] == "none":
                    reason[index] = f"not measured; after it: {later}"
        self.spool.close()
        camera = CourtCamera(**blank, half_diagonal_px=float(np.hypot(*self.size) / 2))
        reason = np.array(
            [r or ("no court found" if s == "none" else "") for r, s in zip(reason, status, strict=True)], dtype=object
        )
        duplicate = np.array(rows.is_duplicate, dtype=bool)
        return ShotCameras(
            video_frame=np.array(rows.video_frame, dtype=np.int64),
            timestamp=times,
            is_duplicate=duplicate,
            camera=camera,
            status=status,
            reason=reason,
            inliers=inliers,
            reprojection_px=rms,
            position_cov=cov,
            focal_std_px=focal_std,
            solution=solution,
            jitter_px=jitter(camera, (status == "measured") & ~duplicate, self.size[0]),
        )

    def _solve(self, cameras: CourtCamera, sightings: Sightings, solution: ClipSolution | None) -> FrameCameras:
        if solution is not None:
            return solve_frames(cameras, sightings, solution=solution, lines=self.lines)
        crooked = self.search.crooked * self.size[0] + 0.05
        return solve_moving(cameras, sightings, lines=self.lines, crooked_px=crooked)

    def _verdicts(self, solved: FrameCameras, sightings: Sightings, which: np.ndarray) -> list[str]:
        """Why each solved frame is not believed; empty where it is."""
        verdicts = []
        for offset, place in enumerate(which):
            camera = solved.fit.camera[offset]
            seen = self.readable[place]
            trouble = camera_trust(camera, self.court, width=self.size[0], options=self.trust)
            marked = (sightings.line[offset] < 0) & np.isfinite(sightings.sigma_px[offset])
            off = solved.fit.residual_px[offset][marked]
            if not trouble and marked.any() and not np.sqrt(np.mean(off**2)) < 0.004 * self.size[0]:
                trouble = "the marked points disagree with the clip's camera"
            if not trouble and seen.sum():  # Frames that rest on a person's marks alone have no samples to count.
                trouble = frame_trust(
                    support=line_counts(sightings.line[offset], self.lines, solved.fit.inlier[offset]),
                    readable=seen,
                    rms_px=float(solved.fit.rms_px[offset]),
                    width=self.size[0],
                    court=self.court,
                    options=self.trust,
                )
            verdicts.append(trouble)
        return verdicts


def _point_sightings(marks: Marks, sigma_px: float) -> Sightings:
    count = len(marks.pixels)
    return Sightings(
        points_world=np.repeat(marks.points_world, 2, axis=0),
        measured_px=np.repeat(marks.pixels, 2, axis=0),
        normals=np.tile(np.eye(2), (count, 1)),
        sigma_px=np.full(2 * count, sigma_px),
        line=np.full(2 * count, -1),
        along=np.zeros(2 * count),
        bias_px=np.zeros(2 * count),
    )


def _joined(a: Sightings, b: Sightings) -> Sightings:
    return Sightings(
        **{
            name: np.concatenate([getattr(a, name), getattr(b, name)])
            for name in ("points_world", "measured_px", "normals", "sigma_px", "line", "along", "bias_px")
        }
    )
