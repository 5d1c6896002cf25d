"""report.html of a clip and of a work folder: one self-contained page each, to look at.

File names and reasons come from outside: everything is escaped on its way into the page.
"""

import base64
import json
from html import escape
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np

from pgm_data.dataset.files import whole_file
from pgm_data.stages.ball_report import COLUMNS, ball_cells, ball_section
from pgm_data.stages.overlay import KeyFrame, saved_key_frames
from pgm_data.stages.players_report import (
    CAPTION_COLUMNS,
    PLAYER_COLUMNS,
    captions_cells,
    captions_section,
    players_cells,
    players_section,
)
from pgm_data.stages.report_figures import (
    ClipFigures,
    ReasonCount,
    VideoFigures,
    WorkFigures,
    clip_figures,
    counted,
    work_figures,
)
from pgm_data.stages.report_parts import DASH, duration, number, share, table, tiles
from pgm_data.stages.report_plots import Curve, plot, strip
from pgm_data.stages.report_style import page

CLIPS_WITH_PLOTS = 60
"""Clips whose plots and pictures stand in the work folder's page; of more, those in worst state. All have their own."""
THUMBNAIL_WIDTH = 480
THUMBNAILS = 3


def write_clip_report(work: Path, clip_id: str) -> Path:
    """Write the clip's report.html; returns its path.

    Raises:
        ValueError: If the clip's files cannot be read.
    """
    folder = work / clip_id
    figures = clip_figures(folder)
    overlay = '<p><a href="./overlay.mp4">overlay.mp4</a></p>' if (folder / "overlay.mp4").exists() else ""
    frames = len(figures.track.status)
    body = (
        f"<h1>{escape(clip_id)} {_pill(figures.state)}</h1>"
        f'<p class="quiet">{escape(figures.document["source_path"])}, scene {escape(figures.document["scene"])}'
        f", quality {escape(figures.document['quality'])}</p>{overlay}"
        + tiles(
            [
                (f"{frames}", "frames"),
                (share(figures.frames_of("measured"), frames), "measured"),
                (share(figures.frames_of("interpolated"), frames), "interpolated"),
                (share(figures.frames_of("none"), frames), "no camera"),
                (_median_px(figures), "reprojection, median px"),
                (number(figures.camera_summary.get("jitter_px"), 2), "jitter, px"),
            ]
        )
        + f'<h2>Camera</h2><div class="card">{_facts(figures)}</div>'
        + f'<h2>Over time</h2><div class="card">{_plots(figures)}</div>'
        + _reasons("Frames that were not measured", figures.reasons, frames)
        + (
            players_section(figures.players, figures.track.capture_time, str(figures.document["scene"]))
            if figures.players is not None
            else ""
        )
        + (ball_section(figures.ball, str(figures.document["scene"])) if figures.ball is not None else "")
        + (captions_section(figures.captions) if figures.captions is not None else "")
        + "<h2>Key frames</h2>"
        + (_pictures(figures, saved_key_frames(folder), small=False) or '<p class="quiet">No overlay was written.</p>')
    )
    return _write(folder / "report.html", clip_id, body)


def write_work_report(work: Path) -> Path:
    """Write the work folder's report.html; returns its path.

    Raises:
        ValueError: If its `run.json` or `shots.parquet` cannot be read.
    """
    figures = work_figures(work)
    speed = {clip: video.frames_per_second for video in figures.videos for clip in video.clips}
    body = (
        _heading(work, figures)
        + _summary(figures)
        + _videos(figures)
        + _clips(figures, speed)
        + _reasons(
            "Frames of clips that were not measured", _together(figures.clips), sum(_frames(c) for c in figures.clips)
        )
        + _reasons("Frames outside of clips", figures.outside, sum(v.frames for v in figures.videos))
        + _details(work, figures)
    )
    return _write(work / "report.html", f"{work.resolve().name}: report", body)


def _write(path: Path, title: str, body: str) -> Path:
    with whole_file(path) as temporary:
        # A file name may hold bytes that are no text.
        temporary.write_bytes(page(title, body).encode("utf-8", "backslashreplace"))
    return path


def _heading(work: Path, figures: WorkFigures) -> str:
    run = figures.run
    name = escape(work.resolve().name)
    if not run:
        return f'<h1>{name}</h1><p class="quiet">There is no run.json: not finished, or made by hand.</p>'
    took = f", {duration(run['seconds'])}" if run.get("seconds") is not None else ", not finished"
    version = run["versions"].get("pgm", "")
    commit = (run.get("commit") or "")[:10]
    made = " ".join(part for part in (f"pgm {version}" if version else "", commit) if part)
    when = escape(f"{run['started']}{took} {made}")
    return f'<h1>{name}</h1><p class="quiet">{escape(run["command"])}<br>{when}</p>'


def _summary(figures: WorkFigures) -> str:
    states = [video.state for video in figures.videos if video.state != "ignored"]
    frames = sum(_frames(clip) for clip in figures.clips)
    seconds = sum(video.seconds for video in figures.videos if video.seconds == video.seconds)
    decoded = sum(video.frames for video in figures.videos)
    values = [
        (f"{len(states)}", "videos"),
        *((f"{states.count(state)}", state) for state in sorted(set(states), key=_severity)),
        (f"{len(figures.clips)}", "clips"),
        (f"{decoded or frames}", "frames decoded"),
        (share(sum(clip.frames_of("measured") for clip in figures.clips), frames), "of clip frames measured"),
        (number(decoded / seconds if seconds else None, 1), "frames/s of one process"),
    ]
    return tiles(values)


def _videos(figures: WorkFigures) -> str:
    taken = [video for video in figures.videos if video.state != "ignored"]
    rows = [
        f'<tr><td class="name">{escape(video.path)}</td><td>{_pill(video.state)}</td>'
        f'<td class="n">{video.frames or DASH}</td><td class="n">{len(video.clips)}</td>'
        f'<td class="n">{number(video.seconds, 1)}</td><td class="n">{number(video.frames_per_second, 1)}</td>'
        f'<td class="why">{escape(video.reason)}</td></tr>'
        for video in sorted(taken, key=lambda video: _severity(video.state))
    ]
    head = ("Video", "State", "Frames#", "Clips#", "Seconds#", "Frames/s#", "Reason")
    return "<h2>Videos</h2>" + table(head, rows) + _ignored([v for v in figures.videos if v.state == "ignored"])


def _ignored(videos: list[VideoFigures]) -> str:
    if not videos:
        return ""
    rows = [f'<tr><td class="name">{escape(v.path)}</td><td class="why">{escape(v.reason)}</td></tr>' for v in videos]
    return f"<h2>Ignored files</h2>{table(('File', 'Reason'), rows)}"


def _clips(figures: WorkFigures, speed: dict[str, float]) -> str:
    rows = []
    with_ball = any(clip.ball is not None for clip in figures.clips)
    with_players = any(clip.players is not None for clip in figures.clips)
    with_captions = any(clip.captions is not None for clip in figures.clips)
    for clip in figures.clips:
        frames = _frames(clip)
        link = f"./{quote(clip.clip_id, errors='replace')}/report.html"
        repeats = int(clip.track.is_duplicate.sum())
        numbers = (
            f"{frames}",
            share(clip.frames_of("measured"), frames),
            share(clip.frames_of("interpolated"), frames),
            share(clip.frames_of("none"), frames),
            _median_px(clip),
            _percentile_px(clip),
            _focal_range(clip),
        )
        cells = "".join(f'<td class="n">{value}</td>' for value in numbers)
        own = (
            *(players_cells(clip.players) if with_players else ()),
            *(ball_cells(clip.ball) if with_ball else ()),
            *(captions_cells(clip.captions) if with_captions else ()),
        )
        tail = (*own, number(clip.camera_summary.get("jitter_px"), 2), share(repeats, frames), _speed(speed, clip))
        last = "".join(f'<td class="n">{value}</td>' for value in tail)
        rows.append(
            f'<tr><td class="name"><a href="{link}">{escape(clip.clip_id)}</a></td><td>{_pill(clip.state)}</td>'
            f"<td>{strip(clip.track.timestamp, clip.track.status, axis=False)}</td>{cells}"
            f'<td class="n">{_position(clip)}</td><td>{escape(_lens(clip))}</td>{last}</tr>'
        )
    own_columns = (
        *(PLAYER_COLUMNS if with_players else ()),
        *(COLUMNS if with_ball else ()),
        *(CAPTION_COLUMNS if with_captions else ()),
    )
    head = (
        *("Clip", "State", "Over time", "Frames#", "Measured#", "Interpolated#", "None#", "Median px#", "95 % px#"),
        *("Focal px#", "Position m#", "Lens", *own_columns, "Jitter px#", "Repeats#", "Frames/s#"),
    )
    for clip_id, reason in figures.unreadable:
        rows.append(
            f'<tr><td class="name">{escape(clip_id)}</td><td>{_pill("failed")}</td>'
            f'<td class="why" colspan="{len(head) - 2}">{escape(reason)}</td></tr>'
        )
    return "<h2>Clips</h2>" + table(head, rows)


def _details(work: Path, figures: WorkFigures) -> str:
    if not figures.clips:
        return ""
    shown = sorted(figures.clips, key=lambda clip: _severity(clip.state))[:CLIPS_WITH_PLOTS]
    chosen = {clip.clip_id for clip in shown}
    parts = ["<h2>Clip by clip</h2>"]
    if len(shown) < len(figures.clips):
        parts.append(f'<p class="quiet">{len(shown)} of {len(figures.clips)}; every clip has its own report.</p>')
    for clip in figures.clips:
        if clip.clip_id not in chosen:
            continue
        key_frames = saved_key_frames(work / clip.clip_id)
        places = np.unique(np.linspace(0, len(key_frames) - 1, THUMBNAILS).round().astype(int)) if key_frames else []
        small = tuple(_thumbnail(key_frames[i]) for i in places)
        is_open = " open" if len(figures.clips) <= 8 else ""
        parts.append(
            f'<details class="card"{is_open}><summary><b>{escape(clip.clip_id)}</b> {_pill(clip.state)}</summary>'
            f"{_pictures(clip, small, small=True)}<br>{_facts(clip)}<br>{_plots(clip)}</details>"
        )
    return "".join(parts)


def _together(clips: tuple[ClipFigures, ...]) -> tuple[ReasonCount, ...]:
    return counted((r.status, r.reason, r.frames) for clip in clips for r in clip.reasons)


def _reasons(title: str, reasons: tuple[ReasonCount, ...], frames: int) -> str:
    if not reasons:
        return ""
    rows = [
        f'<tr><td class="n">{reason.frames}</td><td class="n">{share(reason.frames, frames)}</td>'
        f'<td>{escape(reason.status)}</td><td class="why">{escape(reason.reason) or "no reason given"}</td></tr>'
        for reason in reasons
    ]
    return f"<h2>{escape(title)}</h2>{table(('Frames#', 'Share#', 'Status', 'Reason (one example)'), rows)}"


def _facts(clip: ClipFigures) -> str:
    lens = clip.document.get("lens_model") or {}
    summary = clip.camera_summary
    evidence = summary.get("evidence")
    point = summary.get("principal_point")
    size = f"{clip.document['width']} x {clip.document['height']} px"
    facts = [
        ("Picture", size),
        ("Position", f"{_position(clip)} m"),
        ("Focal length", f"{_focal_range(clip)} px, std {number(_median(clip.track.focal_std_px), 1)} px"),
        ("Principal point", f"{point[0]:.1f}, {point[1]:.1f} px" if point else DASH),
        ("Lens", f"{lens['model']}: {lens['reason']}" if lens else DASH),
        ("Evidence", _plain(evidence)),
        ("Reprojection", f"median {_median_px(clip)} px, 95 % {_percentile_px(clip)} px"),
        ("Jitter", f"{number(summary.get('jitter_px'), 2)} px"),
        ("Repeated frames", f"{int(clip.track.is_duplicate.sum())} of {_frames(clip)}"),
        ("Exposure", f"{1000 * clip.document['shutter_s']:.1f} ms" if clip.document.get("shutter_s") else DASH),
    ]
    return "<dl>" + "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts) + "</dl>"


def _plots(clip: ClipFigures) -> str:
    times = clip.track.timestamp
    pan = Curve(name="pan", values=clip.pan_deg, style="c1")
    tilt = Curve(name="tilt", values=clip.tilt_deg, style="c2")
    return (
        '<div class="plots">'
        + strip(times, clip.track.status, axis=True)
        + plot("Focal length", "px", times, (Curve(name="focal", values=clip.focal_px, style="c1"),))
        + plot("Pan", "degrees, right of the court's length", times, (pan,))
        + plot("Tilt", "degrees above the horizon", times, (tilt,))
        + plot("Reprojection", "px rms", times, (Curve(name="rms", values=clip.track.reprojection_px, style="c3"),))
        + "</div>"
    )


def _pictures(clip: ClipFigures, key_frames: tuple[KeyFrame, ...], *, small: bool) -> str:
    figures = []
    for key_frame in key_frames:
        i = key_frame.frame_index
        if i >= _frames(clip):
            continue  # left over from an earlier run of other length
        track = clip.track
        caption = f"frame {i}, {track.timestamp[i]:.2f} s: {track.status[i]}"
        if np.isfinite(track.reprojection_px[i]):
            caption += f", {track.reprojection_px[i]:.2f} px"
        if track.reason[i]:
            caption += f", {track.reason[i]}"
        data = base64.b64encode(key_frame.jpeg).decode("ascii")
        figures.append(
            f'<figure><img src="data:image/jpeg;base64,{data}" alt="frame {i} with the court drawn in">'
            f"<figcaption>{escape(caption)}</figcaption></figure>"
        )
    return f'<div class="pictures{" small" if small else ""}">{"".join(figures)}</div>' if figures else ""


def _thumbnail(key_frame: KeyFrame) -> KeyFrame:
    picture = cv2.imdecode(np.frombuffer(key_frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
    if picture is None or picture.shape[1] <= THUMBNAIL_WIDTH:
        return key_frame
    size = (THUMBNAIL_WIDTH, max(1, round(picture.shape[0] * THUMBNAIL_WIDTH / picture.shape[1])))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 78])[1]
    return KeyFrame(frame_index=key_frame.frame_index, jpeg=data.tobytes())


def _pill(state: str) -> str:
    known = state if state in ("ok", "degraded", "failed") else ""
    return f'<span class="pill {known}">{escape(state)}</span>'


def _severity(state: str) -> int:
    return {"failed": 0, "degraded": 1, "ok": 3}.get(state, 2)


def _frames(clip: ClipFigures) -> int:
    return len(clip.track.status)


def _residuals(clip: ClipFigures) -> np.ndarray:
    return clip.track.reprojection_px[np.isfinite(clip.track.reprojection_px) & clip.track.has_camera]


def _median(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def _median_px(clip: ClipFigures) -> str:
    return number(_median(_residuals(clip)), 2)


def _percentile_px(clip: ClipFigures) -> str:
    values = _residuals(clip)
    return number(float(np.percentile(values, 95)) if len(values) else None, 2)


def _focal_range(clip: ClipFigures) -> str:
    focal = clip.focal_px[np.isfinite(clip.focal_px)]
    if not len(focal):
        return DASH
    low, high = f"{focal.min():.0f}", f"{focal.max():.0f}"
    return low if low == high else f"{low} to {high}"


def _position(clip: ClipFigures) -> str:
    position, std = clip.position_world, clip.position_std
    if not np.isfinite(position).all():
        return DASH
    if not np.isfinite(std).all():
        return ", ".join(f"{p:.2f}" for p in position)
    return ", ".join(f"{p:.2f} ± {s:.2f}" for p, s in zip(position, std, strict=True))


def _lens(clip: ClipFigures) -> str:
    lens = clip.document.get("lens_model")
    return str(lens["model"]) if lens else DASH


def _speed(speed: dict[str, float], clip: ClipFigures) -> str:
    return number(speed.get(clip.clip_id), 1)


def _plain(evidence: object) -> str:
    if evidence is None:
        return DASH
    return evidence if isinstance(evidence, str) else json.dumps(evidence, ensure_ascii=False)
