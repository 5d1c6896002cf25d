"""Evaluations of a synthesis model as tables, as CSV and as JSON.

Tables are Markdown whose columns are also aligned, so that they read as text.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from pgm_data.dataset.files import whole_file
from pgm_models.markdown_table import markdown_table
from pgm_models.metrics import FrechetScore
from pgm_models.synthesis.evaluate_efficiency import Taken
from pgm_models.synthesis.evaluate_result import (
    SynthesisEvaluation,
    findings,
    likenesses,
    silhouettes,
    steadiness_means,
    summary_to_json,
    text_of,
)
from pgm_models.synthesis.novel_view import novel_drops

JSON_NAME, FRAMES_NAME, SCORES_NAME, TABLE_NAME = "evaluation.json", "frames.csv", "scores.csv", "evaluation.md"
"""Files that `write_synthesis_evaluation` writes."""
STAGE_NAMES = {"final": "final", "raw": "before the enhancer"}
USUAL_SCALES = 5


def evaluation_text(result: SynthesisEvaluation) -> str:
    """All tables, and what they mean."""
    parts = [
        _settings(result),
        likeness_table(result),
        "Means over the frames that show something of it; graphics over the picture are left out. "
        + _mask_note(result),
        finding_table(result),
        _finding_note(result),
        _steadiness(result),
        _frechet(result),
        _novel(result),
        _efficiency(result),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def likeness_table(result: SynthesisEvaluation) -> str:
    """PSNR, SSIM, MS-SSIM and LPIPS of the frame and of each object."""
    scales = "" if result.scales == USUAL_SCALES else f" ({result.scales} scales)"
    header = ["where", "pictures", "frames", "PSNR [dB]", "lowest", "SSIM", f"MS-SSIM{scales}", "LPIPS"]
    rows = [
        [each.where, STAGE_NAMES[each.stage], each.frames]
        + [each.psnr, each.lowest_psnr, each.ssim, each.ms_ssim, each.lpips]
        for each in likenesses(result)
    ]
    return markdown_table(header, rows)


def finding_table(result: SynthesisEvaluation) -> str:
    """ADD and MDR of players and ball."""
    found = findings(result)
    near = f"{found[0].near_px:g}" if found else "-"
    header = ["object", "pictures", "figures", "ADD [px]", "ADD [of diagonal]", "MDR [%]", "matched", "of"]
    header += ["radius [px]", f"within {near} px [%]"]
    rows = []
    for each in found:
        score = each.score
        rows.append(
            [each.object, each.pictures, ", ".join(score.names), score.add_px, score.add_of_diagonal, 100 * score.mdr]
            + [score.matched, score.valid, score.radius_px, 100 * each.near]
        )
    return markdown_table(header, rows)


def _settings(result: SynthesisEvaluation) -> str:
    lines = [f"{result.frames} frames of {len(result.clips)} clips, {result.size[0]}x{result.size[1]}."]
    lines += [f"{name}: {value}." for name, value in result.about.items()]
    lines.append(f"Final pictures made in a second: {result.frames_per_second:.3g}.")
    return "  \n".join(lines)


def _mask_note(result: SynthesisEvaluation) -> str:
    where = [each.where for each in likenesses(result)]
    told = (
        "`-alpha`: pixels of which the renderer gives half or more to the object. "
        if any(name.endswith("-alpha") for name in where)
        else "An object's pixels are those that truly show it. "
    )
    return told + "Of the ball, whose pixels are few, the box about it and its path."


def _finding_note(result: SynthesisEvaluation) -> str:
    note = (
        "ADD: mean distance between the middles of boxes, of those that matched. MDR: share that did not, of those "
        "that are to be seen. Found by what differs from the picture without players and ball: `made` in made "
        "pictures, `real` in real ones, whose figures are the detector's own; `chance`: a ball looked for beside its "
        "place. `alpha`: the renderer's own masks, which no detector found."
    )
    overlaps = ", ".join(f"{name} {value:.3f}" for name, value in silhouettes(result).items())
    return note + (f" Silhouettes, intersection over union: {overlaps}." if overlaps else "")


def _steadiness(result: SynthesisEvaluation) -> str:
    means = steadiness_means(result)
    rows = [
        ["change from frame to frame, PSNR [dB]", means["change_psnr final frame"], ""],
        ["flicker where nothing moves [of 255]", 255 * means["flicker final frame"], 255 * means["flicker real frame"]],
        ["pixels where nothing moves [%]", "", 100 * means["still real frame"]],
    ]
    return markdown_table(["steadiness", "made", "real"], rows)


def _frechet(result: SynthesisEvaluation) -> str:
    rows = []
    for name, score in result.frechet.items():
        if isinstance(score, FrechetScore):
            told = "" if score.reliable else "too few: read with care"
            rows.append([name, score.distance, score.excess, score.rows, told])
        else:
            rows.append([name, "n/a", "", "", score.removeprefix("n/a ").strip("()")])
    return markdown_table(["distance", "value", "for ever more pictures", "N", "note"], rows)


def _novel(result: SynthesisEvaluation) -> str:
    views = result.novel
    if isinstance(views, str):
        return f"Novel views: n/a ({views})."
    rows = [[name, seen, novel, seen - novel] for name, (seen, novel) in novel_drops(views).items()]
    moved = [view for view in views if view.direction != "seen"]
    if not moved:
        return "Novel views: n/a (no camera could be moved far enough from those that were seen)."
    metres, degrees = ([getattr(view, name) for view in moved] for name in ("moved_m", "turned_deg"))
    note = (
        f"{len(moved)} novel views of {len(views) - len(moved)} frames, cameras moved by {min(metres):.1f} to "
        f"{max(metres):.1f} m and turned by {min(degrees):g} to {max(degrees):g} degrees, against the simulator's own "
        "pictures from there; seen views against its pictures as well."
    )
    return markdown_table(["novel views", "seen PSNR [dB]", "novel PSNR [dB]", "lost [dB]"], rows) + "\n\n" + note


def _efficiency(result: SynthesisEvaluation) -> str:
    each = result.efficiency
    if isinstance(each, str):
        return f"Efficiency: n/a ({each})."
    header = ["efficiency", *(f"{one.place}" for one in each)]
    lines: list[tuple[str, Sequence[object]]] = [
        ("picture [px]", [f"{one.size[0]}x{one.size[1]}" for one in each]),
        ("field samples of volumes", [one.looked_at for one in each]),
        ("of surfaces", [one.surface_samples for one in each]),
        ("dense field samples", [one.dense_samples for one in each]),
        ("dense / ours", [one.samples_ratio for one in each]),
        ("largest difference from the dense picture", [f"{one.largest_difference:.1e}" for one in each]),
        ("rays compared", [one.compared_rays for one in each]),
        *_times("growing the fields, once", [one.growing for one in each]),
        *_times("frame of a new camera", [one.first for one in each]),
        *_times("frame of a standing camera", [one.following for one in each]),
        *_times("enhancer's part", [one.enhancing for one in each]),
        *_times("dense layout without enhancer", [one.dense for one in each]),
        ("dense layout / ours, new camera, clock", [one.time_ratio for one in each]),
        ("the same, CPU", [one.cpu_ratio for one in each]),
    ]
    first = each[0]
    note = (
        f"On {first.device}, {first.threads} threads. The dense layout, the paper's, samples every object on every ray "
        f"and dresses each sample by the network; timed at {first.timed_rays} rays of the picture, for all of them."
    )
    return markdown_table(header, [[name, *values] for name, values in lines]) + "\n\n" + note


def _times(name: str, times: Sequence[Taken]) -> list[tuple[str, list[float]]]:
    return [(f"{name} [s]", [one.seconds for one in times]), (f"{name} [CPU s]", [one.cpu_seconds for one in times])]


def frames_csv(result: SynthesisEvaluation) -> str:
    """Every column of every frame as comma-separated values; nothing for NaN."""
    columns = result.columns()
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["clip", "frame", *columns])
    names = [(clip.clip, int(frame)) for clip in result.clips for frame in clip.frames]
    for number, (clip, frame) in enumerate(names):
        values = [float(column[number]) for column in columns.values()]
        writer.writerow([clip, frame, *("" if value != value else value for value in values)])
    return text.getvalue()


def scores_csv(result: SynthesisEvaluation) -> str:
    """Every figure of the tables as one row: what, where, of which pictures, unit, value."""
    rows: list[tuple[str, str, str, str, float]] = []
    for each in likenesses(result):
        for name, unit in (("psnr", "dB"), ("lowest_psnr", "dB"), ("ssim", ""), ("ms_ssim", ""), ("lpips", "")):
            rows.append((name, each.where, each.stage, unit, getattr(each, name)))
    for found in findings(result):
        add, mdr = found.score.names
        rows += [
            (add, found.object, found.pictures, "px", found.score.add_px),
            (mdr, found.object, found.pictures, "share", found.score.mdr),
            ("near", found.object, found.pictures, "share", found.near),
        ]
    rows += [("iou", name, "alpha", "", value) for name, value in silhouettes(result).items()]
    for name, value in steadiness_means(result).items():
        figure, kind, where = name.split(" ", 2)
        rows.append((figure, where, kind, "dB" if "psnr" in figure else "", value))
    if not isinstance(result.novel, str):
        for name, pair in novel_drops(result.novel).items():
            rows += [("psnr", name, kind, "dB", value) for kind, value in zip(("seen", "novel"), pair, strict=True)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["figure", "where", "pictures", "unit", "value"])
    writer.writerows([*row[:4], "" if row[4] != row[4] else row[4]] for row in rows)
    return text.getvalue()


def write_synthesis_evaluation(folder: Path, result: SynthesisEvaluation) -> None:
    """Write a result as JSON, CSV and tables into a folder that is there, each file whole or not at all."""
    texts = {
        JSON_NAME: text_of(summary_to_json(result)),
        FRAMES_NAME: frames_csv(result),
        SCORES_NAME: scores_csv(result),
        TABLE_NAME: evaluation_text(result),
    }
    for name, text in texts.items():
        with whole_file(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
