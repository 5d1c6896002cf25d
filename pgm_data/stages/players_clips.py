"""`pgm players` on the clips of one video: players found, placed in metres, and written beside their cameras."""

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_players import ClipPlayers, write_clip_players
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.detect.graphics import steady_graphics
from pgm_data.scene import Scene, load_scene
from pgm_data.stages.clip_doubt import camera_doubt
from pgm_data.stages.clip_pictures import ClipPictures
from pgm_data.stages.players_detect import FoundPlayers, found_players, person_finders, pose_model
from pgm_data.stages.players_identity import keep_looks
from pgm_data.stages.players_lift import clip_players, placed_players
from pgm_data.stages.players_options import PlayersOptions, PlayersOutcome

PASSES = 5
"""About how often a clip's pictures are gone through."""


def run_job(arguments: dict, report: Callable[[dict], None]) -> dict:
    """`players_of_clips` for the stage supervisor: JSON in, JSON out."""
    outcomes = players_of_clips(
        Path(arguments["work"]),
        tuple(arguments["clips"]),
        video=Path(arguments["video"]),
        options=PlayersOptions(**arguments["options"]),
        files={clip: {option: Path(path) for option, path in own.items()} for clip, own in arguments["files"].items()},
        threads=int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2),
        report=report,
    )
    return {"clips": [asdict(outcome) for outcome in outcomes]}


def players_of_clips(
    work: Path,
    clip_ids: tuple[str, ...],
    *,
    video: Path,
    options: PlayersOptions,
    files: Mapping[str, dict[str, Path]],
    threads: int = 2,
    report: Callable[[dict], None] = lambda _: None,
) -> tuple[PlayersOutcome, ...]:
    """Find and place the players in clips of one video; writes their tables, overlay and report.

    A clip that fails does not stop the others of the video.

    Args:
        work: The work folder.
        clip_ids: Clips of the video.
        video: The file.
        options: How.
        files: By clip, another program's files about it by the option that named them.
        threads: Of decoder and networks.
        report: Told about progress now and then.

    Raises:
        VideoError: If the file cannot be read.
        ValueError: If the scene has no players, or a network is none.
    """
    scene = load_scene(options.scene)
    if not scene.players:
        raise ValueError(f"scene {scene.name}: expected player objects, got none")
    finders = person_finders(options, threads)
    model, why_no_model = pose_model(options, threads)
    outcomes, clips = [], []
    for clip_id in clip_ids:
        try:
            clips.append(read_clip_camera(work / clip_id))
        except ValueError as error:
            outcomes.append(PlayersOutcome(clip_id=clip_id, state="failed", reason=str(error)))
    total, before = PASSES * sum(len(clip.video_frame) for clip in clips), 0
    for clip in sorted(clips, key=lambda clip: int(clip.video_frame[0]) if len(clip.video_frame) else 0):

        def passed(frames: int, before: int = before) -> None:
            if frames % 50 == 0:
                report({"progress": min(before + frames, total), "total": total})

        pictures = ClipPictures(video, clip, threads=threads, fast=options.quality == "draft", report=passed)
        try:
            found = found_players(
                pictures,
                clip,
                scene=scene,
                options=options,
                files=files.get(clip.clip_id, {}),
                finders=finders,
                model=model,
                why_no_model=why_no_model,
            )
            _propose_graphics(work, clip, pictures, options)
            outcomes.append(_placed(work, clip, found, scene, options))
        except ValueError as error:
            outcomes.append(PlayersOutcome(clip_id=clip.clip_id, state="failed", reason=str(error)))
        before += PASSES * len(clip.video_frame)
        report({"progress": before, "total": total})
    good = tuple(outcome.clip_id for outcome in outcomes if outcome.state != "failed")
    if options.overlay and good:
        from pgm_data.stages.overlay import write_overlays

        write_overlays(work, good, video=video, scene=scene)
    if good:
        from pgm_data.stages.report import write_clip_report

        for clip_id in good:
            write_clip_report(work, clip_id)
    return tuple(outcomes)


def _propose_graphics(work: Path, clip: ClipCamera, pictures: ClipPictures, options: PlayersOptions) -> None:
    """Write graphics that stay while the scene moves into clip.json, where nobody has said what there is."""
    path = work / clip.clip_id / "clip.json"
    document = read_document(path, "clip")
    if document["ui_boxes_px"] or options.quality == "draft":
        return
    boxes = steady_graphics(pictures, clip, size=pictures.size)
    if len(boxes):
        write_document(path, "clip", document | {"ui_boxes_px": np.round(boxes, 2).tolist()})


def _placed(work: Path, clip: ClipCamera, found: FoundPlayers, scene: Scene, options: PlayersOptions) -> PlayersOutcome:
    """One clip's players placed and written."""
    folder, started = work / clip.clip_id, time.monotonic()
    document = read_document(folder / "clip.json", "clip")
    motions = placed_players(
        clip, found.boxes, found.poses, scene=scene, quality=options.quality, doubt=camera_doubt(clip, document)
    )
    players = clip_players(clip, found.boxes, found.poses, motions, scene=scene)
    (folder / "players.parquet").unlink(missing_ok=True)
    keep_looks(work, clip, found)
    write_clip_players(folder, players, scene=scene)
    said = "; ".join(
        [*([found.said] if found.said else []), *(f"{one.name}: {one.said}" for one in motions if one.said)]
    )
    return outcome_of(clip, players, found, said=said, lift_s=time.monotonic() - started)


def outcome_of(
    clip: ClipCamera, players: ClipPlayers, found: FoundPlayers, *, said: str, lift_s: float
) -> PlayersOutcome:
    """What became of a clip that was gone through."""
    tracks = players.players
    fit = np.concatenate([track.reprojection_px for track in tracks])
    fit = fit[np.isfinite(fit)]
    placed = any((track.status != "none").any() for track in tracks)
    return PlayersOutcome(
        clip_id=clip.clip_id,
        state="ok" if placed else "no players",
        reason=said or ("" if placed else "no player in any frame"),
        frames=len(clip.video_frame),
        with_camera=int(clip.has_camera.sum()),
        seen=tuple(int(np.isfinite(track.box_px[:, 0]).sum()) for track in tracks),
        measured=tuple(int((track.status == "measured").sum()) for track in tracks),
        filled=tuple(int((track.status == "filled").sum()) for track in tracks),
        joints=any(np.isfinite(track.joints[:, -1]).any() for track in tracks),
        reprojection_px=float(np.median(fit)) if len(fit) else None,
        find_s=found.find_s,
        pose_s=found.pose_s,
        lift_s=lift_s,
    )
