"""Jobs of `pgm trade calibrate` on simulated clips: draw one with its truth, calibrate one and score it."""

import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.scene import load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import MatchFiles, write_match
from pgm_data.stages.calibrate import CalibrateOptions, VideoOutcome, calibrate_video
from pgm_data.stages.trade_score import Cost, score_video

Report = Callable[[dict], None]


def draw_clip(arguments: dict, report: Report) -> dict:
    """Draw one clip with its truth, as `pgm simulate` does. Every fourth repeats frames, as converted rates do."""
    import cv2

    cv2.setNumThreads(1)
    number = int(arguments["number"])
    options = ClipOptions(
        frames=arguments["frames"],
        width=arguments["width"],
        height=arguments["height"],
        duplicates=number % 4 == 3,
    )
    scene = load_scene(arguments["scene"])
    files = MatchFiles(pictures="full")
    written = write_match(Path(arguments["out"]), scene, options, files, seed=arguments["seed"], match=number)
    return {"video": written.video, "clips": list(written.clips)}


def score_clip(arguments: dict, report: Report) -> dict:
    """Calibrate one drawn video in a folder of its own and compare its cameras with the true ones."""
    video, truth = Path(arguments["video"]), [Path(folder) for folder in arguments["truth"]]
    scene = load_scene(arguments["scene"])
    assert scene.court is not None
    solved, documents, outcome, cpu_s = calibrated(video, arguments, report)
    document = read_document(truth[0] / "clip.json", "clip")
    score = score_video(
        video=video.stem,
        preset=arguments["quality"],
        size=(document["width"], document["height"]),
        solved=solved,
        truth=[read_clip_camera(folder) for folder in truth],
        court=scene.court,
        lens_model=documents[0]["lens_model"]["model"] if documents else "",
        cost=Cost(seconds=outcome.seconds, cpu_s=cpu_s, memory_mb=outcome.peak_memory_mb),
    )
    return asdict(score)


def calibrated(
    video: Path, arguments: dict, report: Report
) -> tuple[list[ClipCamera], list[dict], VideoOutcome, float]:
    """The cameras and documents of a video's clips, what became of it, and the processor seconds it took.

    The work folder is a temporary one under `arguments["scratch"]`; no overlay is drawn.
    """
    options = CalibrateOptions(
        scene=arguments["scene"], quality=arguments["quality"], network=arguments["network"], overlay=False
    )
    Path(arguments["scratch"]).mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(dir=arguments["scratch"], prefix="work-"))
    try:
        begun = time.process_time()
        # The supervisor shares the cores among its workers in this way.
        threads = int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2)
        outcome = calibrate_video(
            video, work, stem=video.stem, match_id=video.stem, options=options, threads=threads, report=report
        )
        cpu_s = time.process_time() - begun
        cameras = [read_clip_camera(work / clip) for clip in outcome.clips]
        documents = [read_document(work / clip / "clip.json", "clip") for clip in outcome.clips]
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return cameras, documents, outcome, cpu_s


def truth_of(folder: Path) -> dict[Path, list[Path]]:
    """The true clips of every video in a folder that `pgm simulate` wrote, in order.

    Raises:
        ValueError: If there is no such clip, or its video is missing.
    """
    found: dict[Path, list[tuple[int, Path]]] = {}
    work = folder / "work"
    for path in sorted(work.glob("*/clip.json")):
        clip = json.loads(path.read_text(encoding="utf-8"))
        video = (work / clip["source_path"]).resolve()
        if not video.is_file():
            raise ValueError(f"{path}: source_path: expected a video, got {clip['source_path']!r}, where there is none")
        found.setdefault(video, []).append((clip["first_video_frame"], path.parent))
    if not found:
        raise ValueError(f"{folder}: expected videos with their truth, as pgm simulate writes them, got none")
    return {video: [folder for _, folder in sorted(clips)] for video, clips in found.items()}
