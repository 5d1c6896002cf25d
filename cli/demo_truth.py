"""How far a demo's annotations are from the exact truth of the match that it drew."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pgm_data.stages.demo_report import Comparison


def compared_with_truth(simulated: Path, work: Path) -> "tuple[Comparison, ...]":
    """Errors of cameras, players and ball.

    Args:
        simulated: What pgm simulate wrote.
        work: What was made of its videos.
    """
    return _cameras(simulated, work), _players(simulated, work), _ball(simulated, work)


def _cameras(simulated: Path, work: Path) -> "Comparison":
    """Errors of the cameras."""
    import numpy as np

    from pgm_data.dataset.clip_camera import read_clip_camera
    from pgm_data.dataset.documents import read_document
    from pgm_data.scene import load_scene
    from pgm_data.stages.demo_report import Comparison
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
    return Comparison(title="cameras against the truth", rows=tuple(rows))


def _players(simulated: Path, work: Path) -> "Comparison":
    """Errors of the players."""
    import numpy as np

    from pgm_data.dataset.clip_players import read_clip_players
    from pgm_data.scene import load_scene
    from pgm_data.stages.demo_report import Comparison

    scene = load_scene("tennis")
    truth = [read_clip_players(p.parent, scene) for p in sorted((simulated / "work").glob("*/players.parquet"))]
    solved = [read_clip_players(p.parent, scene) for p in sorted(work.glob("*/players.parquet"))]
    rows: list[tuple[str, str | int]] = []
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
    return Comparison(title="players against the truth", rows=tuple(rows))


def _ball(simulated: Path, work: Path) -> "Comparison":
    """Errors of the ball."""
    import numpy as np
    import pandas as pd

    from pgm_data.stages.demo_report import Comparison

    def tables(folder: Path, name: str) -> pd.DataFrame:
        found = [pd.read_parquet(p) for p in sorted(folder.glob(f"*/{name}.parquet"))]
        return pd.concat(found, ignore_index=True)

    truth, solved = tables(simulated / "work", "ball"), tables(work, "ball")
    both = solved.merge(truth, on="video_frame", suffixes=("", " true"))
    placed = both[(both["ball.status"] != "none") & (both["ball.status true"] != "none")]
    if not len(placed):
        return Comparison(title="ball against the truth", rows=(("frames with the ball in metres", 0),))
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
    return Comparison(title="ball against the truth", rows=tuple(rows))
