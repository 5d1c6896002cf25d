"""`pgm demo`: a short match drawn, annotated, packed and checked, and compared with its exact truth."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from .console import UsageError, table_text
from .output import STATE

OURS = ("simulated", "work", "dataset")
"""What a demo writes, each an output folder with its state inside; whatever else there is is left alone."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Simulate a short match, find cameras, players, ball and words, pack and check them; or take a video of yours."""

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
    simulated, work, dataset = (options.out / name for name in OURS)
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
    if any(work.glob("*/camera.parquet")):
        stages = _annotated(work, scene)
        if stages not in (0, 3, 4):
            return stages
        print("6. packing a dataset")
        from .pack import main as pack

        code = pack([str(work), "--out", str(dataset)]) or code
    print("7. checking what was written")
    from .check import main as check

    checked = check([str(path) for path in (work, dataset) if path.exists()])
    if options.video is None:
        print("8. comparing with the truth, which nothing above has seen")
        print(_compared(simulated, work))
        print(_players_compared(simulated, work))
        print(_ball_compared(simulated, work))
    overlays = sorted(work.glob("*/overlay.mp4"))
    print(f"\nopen {work / 'report.html'}" + (f"\nand  {overlays[0]}" if overlays else ""))
    if dataset.exists():
        print(f"load {dataset} with pandas, DuckDB or Hugging Face datasets; its README.md says how")
    return checked or code


def _annotated(work: Path, scene: str) -> int:
    """Players, ball and words, as far as the scene has them; the first exit code that ends the demo, else 0."""
    from pgm_data.scene import load_scene

    declared = load_scene(scene)
    if declared.players:
        from .players import main as players
        from .weights import main as weights

        print("3. players: fetching the pose weights where they are missing, then skeletons on the court")
        if weights(["pose"]):
            print("   without them players are placed by their boxes alone")
        code = players([str(work)])
        if code not in (0, 3, 4):
            return code
    if declared.ball is not None and declared.court is not None:
        print("4. placing the ball in metres")
        from .ball3d import main as ball3d

        # A video of yours may have no ball in flight, and still has its cameras.
        code = ball3d([str(work)])
        if code not in (0, 3, 4):
            return code
    if declared.players:
        print("5. saying what each player does")
        from .caption import main as caption

        return caption([str(work)])
    return 0


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


def _players_compared(simulated: Path, work: Path) -> str:
    """A table of the players' errors against the truth."""
    import numpy as np

    from pgm_data.dataset.clip_players import read_clip_players
    from pgm_data.scene import load_scene

    scene = load_scene("tennis")
    truth = [read_clip_players(p.parent, scene) for p in sorted((simulated / "work").glob("*/players.parquet"))]
    solved = [read_clip_players(p.parent, scene) for p in sorted(work.glob("*/players.parquet"))]
    rows: list[tuple[str, object]] = []
    for number, player in enumerate(scene.players):
        true_root, true_joints = (
            {
                int(frame): values
                for clip in truth
                for frame, values in zip(clip.video_frame, getattr(clip.players[number], name), strict=True)
            }
            for name in ("root_position", "joints")
        )
        errors, joint_errors = [], []
        for clip in solved:
            track = clip.players[number]
            for row, frame in enumerate(clip.video_frame.tolist()):
                if frame in true_root and track.status[row] != "none":
                    errors.append(np.linalg.norm(track.root_position[row] - true_root[frame]))
                    joint_errors.append(np.linalg.norm(track.joints[row] - true_joints[frame], axis=-1).mean())
        joints = np.array([error for error in joint_errors if np.isfinite(error)])
        median = f"{100 * float(np.nanmedian(errors)):.0f} cm" if errors else "-"
        rows.append((f"{player.name}: frames placed / there", f"{len(errors)} / {len(true_root)}"))
        rows.append((f"{player.name}: error of the root, median", median))
        rows.append(
            (f"{player.name}: error of the joints, median", f"{100 * np.median(joints):.0f} cm" if len(joints) else "-")
        )
    return table_text(("players against the truth", ""), rows)


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
