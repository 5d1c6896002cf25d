"""`pgm demo`: a short match drawn, its cameras and its ball found, checked, and compared with its exact truth."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from .console import UsageError, table_text
from .output import STATE

OURS = ("simulated", "work")
"""What a demo writes, each an output folder with its state inside; whatever else there is is left alone."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Simulate a short match, find its cameras and its ball, check them against the truth; or take a video of yours."""

    video: Path | None = None
    """A video of yours instead of a simulated match; there is no truth to compare it with."""
    scene: str = "tennis"
    """Scene of that video, by name or path."""
    out: Path = Path("demo")
    """Folder to write into; what an earlier demo wrote there is replaced."""
    seconds: float = 10.0
    """Length of the simulated match."""
    seed: int = 24
    """What is drawn depends on it; this one cuts to a close-up near the end."""


def main(argv: list[str]) -> int:
    """Run the demo; its exit code."""
    import tyro

    options = tyro.cli(DemoOptions, args=argv, prog="pgm demo")
    if options.video is not None and not options.video.is_file():
        raise UsageError(f"--video: expected a video file, got {options.video}, which is none")
    if not 1 <= options.seconds <= 600:
        raise UsageError(f"--seconds: expected 1 to 600, got {options.seconds}")
    _clear(options.out)
    simulated, work = options.out / "simulated", options.out / "work"
    if options.video is None:
        print(f"1. drawing {options.seconds:g} s of a match with a turning, zooming camera, repeated frames and cuts")
        code = _simulate(options, simulated)
        if code:
            return code
    source = simulated / "videos" if options.video is None else options.video
    print(f"2. calibrating {source}")
    scene = "tennis" if options.video is None else options.scene
    from .calibrate import main as calibrate

    code = calibrate([str(source), "--out", str(work), "--scene", scene])
    if code not in (0, 3):
        return code
    print("3. placing the ball in metres")
    from .ball3d import main as ball3d

    # A video of yours may have no ball in flight, and still has its cameras.
    placed = ball3d([str(work)]) if code == 0 or any(work.glob("*/camera.parquet")) else 0
    if placed not in (0, 3, 4):
        return placed
    print("4. checking what was written")
    from .check import main as check

    checked = check([str(work)])
    if options.video is None:
        print("5. comparing with the truth, which nothing above has seen")
        print(_compared(simulated, work))
        print(_ball_compared(simulated, work))
    overlays = sorted(work.glob("*/overlay.mp4"))
    print(f"\nopen {work / 'report.html'}" + (f"\nand  {overlays[0]}" if overlays else ""))
    return checked or code


def _clear(out: Path) -> None:
    """Make room for a new demo where an earlier one was; anything else is left alone."""
    if not out.exists():
        return
    entries = sorted(out.iterdir()) if out.is_dir() else [out]
    strangers = [p.name for p in entries if p.name not in OURS or not (p / STATE).is_dir()]
    if strangers:
        raise UsageError(f"--out: expected a new folder or an earlier demo's, got {out} with {strangers[0]} in it")
    for name in OURS:
        if (out / name).exists():
            shutil.rmtree(out / name)


def _simulate(options: DemoOptions, out: Path) -> int:
    from .simulate import main as simulate

    minutes = f"{options.seconds / 60:.6f}"
    return simulate(
        ["--out", str(out), "--matches", "1", "--minutes", minutes, "--seed", str(options.seed), "--motion", "follow",
         "--duplicates", "--closeups"]
    )  # fmt: skip


def _compared(simulated: Path, work: Path) -> str:
    """A table of errors against the truth, one row per clip."""
    import numpy as np

    from pgm_data.dataset.clip_camera import read_clip_camera
    from pgm_data.dataset.documents import read_document
    from pgm_data.scene import load_scene
    from pgm_data.stages.trade_score import Cost, score_video

    truth = [read_clip_camera(p.parent) for p in sorted((simulated / "work").glob("*/camera.parquet"))]
    court = load_scene("tennis").court
    assert court is not None
    folders = sorted(p.parent for p in work.glob("*/camera.parquet"))
    solved = [read_clip_camera(folder) for folder in folders]
    clip = read_document(folders[0] / "clip.json", "clip")
    score = score_video(
        video=folders[0].name, preset="standard", size=(clip["width"], clip["height"]), solved=solved, truth=truth,
        court=court, lens_model=clip["lens_model"]["model"], cost=Cost(seconds=0.0, cpu_s=0.0, memory_mb=0.0),
    )  # fmt: skip
    centre = "-" if score.centre_m is None else f"{100 * float(np.linalg.norm(score.centre_m)):.1f} cm"
    sigma = "-" if score.centre_sigma_m is None else f"{100 * float(np.linalg.norm(score.centre_sigma_m)):.1f} cm"
    rows = [
        ("frames that show the court", score.frames),
        ("of them measured", score.measured),
        ("bridged", score.interpolated),
        ("cameras where no court is shown", score.false_frames),
        ("error of the camera's position", centre),
        ("its stated standard deviation", sigma),
        ("error of the focal length", "-" if score.focal is None else f"{100 * abs(score.focal):.3f} %"),
        ("rms error of the court's lines", "-" if score.court_px is None else f"{score.court_px:.3f} px"),
    ]
    return table_text(("against the truth", ""), rows)


def _ball_compared(simulated: Path, work: Path) -> str:
    """A table of the ball's errors against the truth."""
    import numpy as np
    import pandas as pd

    def tables(folder: Path, name: str) -> pd.DataFrame:
        found = [pd.read_parquet(p) for p in sorted(folder.glob(f"*/{name}.parquet"))]
        return pd.concat(found, ignore_index=True)

    truth, solved = tables(simulated / "work", "ball"), tables(work, "ball")
    both = solved.merge(truth, on="video_frame", suffixes=("", " true"))
    placed = both[(both["ball.status"] != "none") & (both["ball.status true"] != "none")]
    if not len(placed):
        return table_text(("ball against the truth", ""), [("frames with the ball in metres", 0)])
    position, true, cov = (
        np.stack([np.asarray(value) for value in placed[name]])
        for name in ("ball.position", "ball.position true", "ball.position_cov")
    )
    error = np.linalg.norm(position - true, axis=1)
    stated = np.sqrt(cov[:, [0, 3, 5]].sum(axis=1))
    shots, true_shots = tables(work, "ball_shots"), tables(simulated / "work", "ball_shots")
    rows = [
        ("frames with the ball in metres", len(placed)),
        ("error in metres, median", f"{100 * float(np.median(error)):.0f} cm"),
        ("its stated standard deviation, median", f"{100 * float(np.median(stated)):.0f} cm"),
        ("flights found / there", f"{len(shots)} / {len(true_shots)}"),
    ]
    return table_text(("ball against the truth", ""), rows)
