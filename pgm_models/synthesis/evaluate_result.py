"""What an evaluation of a synthesis model found, and what is said of it: means over frames, scores, ratios."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from pgm_models.image_detections import DetectionScore
from pgm_models.metrics import FrechetScore
from pgm_models.synthesis.evaluate_efficiency import Efficiency
from pgm_models.synthesis.evaluate_frames import ClipFigures, joined_columns
from pgm_models.synthesis.evaluate_objects import FindOptions, near_share, score_of
from pgm_models.synthesis.novel_view import NovelView, novel_drops

STAGES = ("final", "raw")


@dataclass(frozen=True, eq=False, kw_only=True)
class SynthesisEvaluation:
    """Everything that one evaluation found."""

    about: Mapping[str, str | int | float]
    """Of what: run, data, styles, versions of networks."""
    size: tuple[int, int]
    """Width and height of the pictures, px."""
    scales: int
    """Of MS-SSIM, that the size allows."""
    find: FindOptions
    clips: tuple[ClipFigures, ...]
    frechet: Mapping[str, FrechetScore | str]
    """FID and FVD, or why there is none."""
    novel: tuple[NovelView, ...] | str
    """Or why there is none."""
    efficiency: tuple[Efficiency, ...] | str
    """Or why there is none."""

    @property
    def frames(self) -> int:
        """Frames that were judged."""
        return sum(len(clip.frames) for clip in self.clips)

    @property
    def frames_per_second(self) -> float:
        """Of making their final pictures."""
        seconds = sum(clip.seconds for clip in self.clips)
        return self.frames / seconds if seconds > 0 else math.nan

    def columns(self) -> dict[str, Float[np.ndarray, " frames"]]:
        """Those of all clips, one after the other."""
        return joined_columns([clip.columns for clip in self.clips], [len(clip.frames) for clip in self.clips])


@dataclass(frozen=True, kw_only=True)
class Likeness:
    """How like the real pixels those of one mask are: means over frames; NaN where there is no figure."""

    where: str
    """`frame`, an object, or an object's own mask as rendered (`-alpha`)."""
    stage: str
    """`final` or `raw`: after the enhancer, or before it."""
    frames: int
    """That show it."""
    psnr: float
    """dB."""
    lowest_psnr: float
    """Of one frame, dB."""
    ssim: float
    ms_ssim: float
    lpips: float


def likenesses(result: SynthesisEvaluation) -> tuple[Likeness, ...]:
    """Of the frame and of each object, after the enhancer and before it."""
    columns = result.columns()
    places = dict.fromkeys(name.split(" ", 2)[2] for name in columns if name.startswith("psnr "))
    found = []
    for where in places:
        for stage in STAGES:
            values = columns.get(f"psnr {stage} {where}", np.zeros(0))
            there = values[~np.isnan(values)]
            found.append(
                Likeness(
                    where=where,
                    stage=stage,
                    frames=len(there),
                    psnr=_mean(there),
                    lowest_psnr=float(there.min()) if len(there) else math.nan,
                    ssim=_mean(columns.get(f"ssim {stage} {where}")),
                    ms_ssim=_mean(columns.get(f"ms_ssim {stage} {where}")),
                    lpips=_mean(columns.get(f"lpips {stage} {where}")),
                )
            )
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """How well an object is found in pictures of one kind."""

    object: str
    pictures: str
    """`made`; `made, seen in real`: only frames in whose real pictures it is found too; `real`; `alpha`: by the
    renderer's own mask; `chance`: looked for where it is not."""
    score: DetectionScore
    near: float
    """Share of the frames that show it in which it is no farther away than `FindOptions.near_px`."""
    near_px: float
    """That distance in these pictures, px."""


def findings(result: SynthesisEvaluation) -> tuple[Finding, ...]:
    """Of players and ball."""
    columns = result.columns()
    height = result.size[1]
    near_px = result.find.near_px * height / 288
    found = []
    for name in columns:
        kind, _, rest = name.partition(" ")
        if kind != "distance":
            continue
        pictures, _, thing = rest.partition(" ")
        radius = result.find.radius_of("ball" if thing == "ball" else "player", height)
        told = {pictures: columns[name]}
        real = columns.get(f"distance real {thing}")
        if pictures == "made" and real is not None:
            told["made, seen in real"] = np.where(np.isfinite(real), columns[name], np.nan)
        for label, distances in told.items():
            score = score_of(distances, radius, result.size, alpha=label == "alpha")
            near = near_share(distances, near_px)
            found.append(Finding(object=thing, pictures=label, score=score, near=near, near_px=near_px))
    order = {thing: number for number, thing in enumerate(dict.fromkeys(each.object for each in found))}
    return tuple(sorted(found, key=lambda each: order[each.object]))


def steadiness_means(result: SynthesisEvaluation) -> dict[str, float]:
    """Means over changes from frame to frame, by the names of their columns."""
    columns = result.columns()
    names = ("change_psnr final frame", "flicker final frame", "flicker real frame", "still real frame")
    return {name: _mean(columns.get(name)) for name in names}


def silhouettes(result: SynthesisEvaluation) -> dict[str, float]:
    """Mean intersection over union of players' rendered masks with the true ones, by player."""
    columns = result.columns()
    return {name.split(" ", 2)[2]: _mean(values) for name, values in columns.items() if name.startswith("iou ")}


def _mean(values: np.ndarray | None) -> float:
    if values is None:
        return math.nan
    there = values[~np.isnan(values)]
    return float(there.mean()) if len(there) else math.nan


def summary_to_json(result: SynthesisEvaluation) -> dict[str, Any]:
    """What was found, as JSON values; null for NaN, the word `inf` for what is endless."""
    scores = [
        {
            "object": each.object,
            "pictures": each.pictures,
            "names": list(each.score.names),
            "add_px": each.score.add_px,
            "add_of_diagonal": each.score.add_of_diagonal,
            "mdr": each.score.mdr,
            "matched": each.score.matched,
            "valid": each.score.valid,
            "radius_px": each.score.radius_px,
            "near_share": each.near,
            "near_px": each.near_px,
        }
        for each in findings(result)
    ]
    frechet = {
        name: each if isinstance(each, str) else {**asdict(each), "reliable": each.reliable}
        for name, each in result.frechet.items()
    }
    novel: Any = result.novel
    if not isinstance(novel, str):
        means = {name: {"seen": pair[0], "novel": pair[1]} for name, pair in novel_drops(novel).items()}
        novel = {"psnr": means, "views": [asdict(view) for view in novel]}
    efficiency: Any = result.efficiency
    if not isinstance(efficiency, str):
        efficiency = [
            {
                **asdict(each),
                "samples_ratio": each.samples_ratio,
                "time_ratio": each.time_ratio,
                "cpu_ratio": each.cpu_ratio,
            }
            for each in efficiency
        ]
    return plain(
        {
            "about": dict(result.about),
            "size": list(result.size),
            "frames": result.frames,
            "frames_per_second": result.frames_per_second,
            "ms_ssim_scales": result.scales,
            "find": asdict(result.find),
            "likeness": [asdict(each) for each in likenesses(result)],
            "objects": scores,
            "silhouettes": silhouettes(result),
            "steadiness": steadiness_means(result),
            "frechet": frechet,
            "novel_view": novel,
            "efficiency": efficiency,
        }
    )


def figures_to_json(clip: ClipFigures) -> dict[str, Any]:
    """A clip's figures as JSON values."""
    return plain(
        {**vars(clip), "frames": clip.frames.tolist(), "columns": {k: v.tolist() for k, v in clip.columns.items()}}
    )


def figures_from_json(raw: Mapping[str, Any]) -> ClipFigures:
    """The figures that `figures_to_json` gave.

    Raises:
        ValueError: If they are not such.
    """
    try:
        return ClipFigures(
            clip=raw["clip"],
            match=raw["match"],
            frames=np.array(raw["frames"], dtype=np.int64),
            columns={name: np.array([number(value) for value in each]) for name, each in raw["columns"].items()},
            seconds=float(raw["seconds"]),
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"figures: expected what figures_to_json writes, got {error!r}") from error


def number(value: float | str | None) -> float:
    """A number that `plain` made."""
    return math.nan if value is None else float(value)


def plain(value: Any) -> Any:
    """JSON values: null for NaN, words for what is endless."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def text_of(document: Mapping[str, Any]) -> str:
    """A JSON document."""
    return json.dumps(document, indent=1, allow_nan=False) + "\n"
