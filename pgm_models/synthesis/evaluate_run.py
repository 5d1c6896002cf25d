"""Scoring a trained synthesis model on a dataset: clip after clip, then views from elsewhere, then what frames take."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Int

from pgm_data.dataset.files import sha256_of, whole_file
from pgm_data.geometry.camera import Camera
from pgm_models.image_metrics import most_scales
from pgm_models.metrics import FrechetScore, frechet_score
from pgm_models.processes import device_of
from pgm_models.synthesis.evaluate_about import about_run
from pgm_models.synthesis.evaluate_choice import Choice, Split, chosen_frames
from pgm_models.synthesis.evaluate_efficiency import (
    Efficiency,
    EfficiencyOptions,
    camera_at,
    efficiency_from_json,
    efficiency_of,
)
from pgm_models.synthesis.evaluate_frames import ClipFigures, ClipJob, clip_figures
from pgm_models.synthesis.evaluate_maker import RunMaker, worn_in
from pgm_models.synthesis.evaluate_networks import Networks, WeightFiles, WordTaker, load_networks
from pgm_models.synthesis.evaluate_objects import FindOptions
from pgm_models.synthesis.evaluate_result import (
    SynthesisEvaluation,
    figures_from_json,
    figures_to_json,
    number,
    plain,
    text_of,
)
from pgm_models.synthesis.evaluate_sheet import NOVEL_NAME, strip, write_strips
from pgm_models.synthesis.frames import FrameStore, read_frames
from pgm_models.synthesis.model import SynthesisModel, load_model, model_digest
from pgm_models.synthesis.novel_view import NovelOptions, NovelView, novel_views

DIGITS = 12
"""Hexadecimal digits by which a model and a dataset are told."""
LEAST_WORDS = 2
"""Fewer pictures or clips of either kind have no Frechet distance."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SynthesisEvaluationOptions:
    """What is scored on what."""

    run: Path
    """Run of pgm-train synthesis, or a model file."""
    dataset: Path
    """Packed dataset with videos."""
    truth: Path | None = None
    """Work folder of the dataset's clips, as pgm simulate --masks writes it; the renderer's own masks without."""
    split: Split = "auto"
    """Frames that are judged."""
    frames: int = 500
    """Of them, at most; 0 for all."""
    size: tuple[int, int] = (0, 0)
    """Width and height that pictures may have; the model's for (0, 0)."""
    pictures: int = 8
    """From which each style is read."""
    find: FindOptions = field(default_factory=FindOptions)
    novel: NovelOptions = field(default_factory=NovelOptions)
    efficiency: EfficiencyOptions = field(default_factory=EfficiencyOptions)
    efficiency_frames: int = 2
    """Frames whose samples and time are counted; 0 for none."""
    weights: WeightFiles = field(default_factory=WeightFiles)
    device: str = "auto"


@dataclass(frozen=True, eq=False, kw_only=True)
class Judge:
    """A model and the frames on which it is judged."""

    options: SynthesisEvaluationOptions
    store: FrameStore
    choice: Choice
    maker: RunMaker
    networks: Networks
    asked: Mapping[str, str | int | float]
    """What the result depends on, the same for all its parts."""


def open_judge(options: SynthesisEvaluationOptions) -> Judge:
    """Everything that is needed to judge.

    Raises:
        ValueError: If the run is none, the dataset shows another scene, or there is nothing to judge.
    """
    device = device_of(options.device)
    model = load_model(options.run, device)
    about = about_run(options.run) or {}
    size = options.size if min(options.size) > 0 else model.options.picture
    store = read_frames(options.dataset, picture=size)
    if store.scene.name != model.scene.name:
        raise ValueError(f"dataset: expected one of the scene {model.scene.name}, got {store.scene.name}")
    choice = chosen_frames(store, about, options.dataset.name, options.split, options.frames)
    networks = load_networks(options.weights, device)
    asked = _asked(options, model, store, choice, about) | networks.origins
    maker = RunMaker(model, store, worn_in(store, choice.judged, choice.lent), pictures=options.pictures)
    return Judge(options=options, store=store, choice=choice, maker=maker, networks=networks, asked=asked)


def evaluate_synthesis(
    judge: Judge, parts: Path | None, show: Callable[[float, str], None] = lambda share, line: None
) -> SynthesisEvaluation:
    """What is found; finished clips and parts are kept in the folder `parts`, and taken from there the next time.

    Args:
        judge: Of `open_judge`.
        parts: Where parts are kept; nowhere if None.
        show: Is told to which share, 0 to 1, all is done, and what is being done.

    Raises:
        ValueError: If a frame cannot be read, or parts were made with other options.
    """
    store, choice, options = judge.store, judge.choice, judge.options
    clips, words = [], []
    numbers = np.unique(store.clip[choice.judged])
    done, total = 0, len(choice.judged)
    for clip in numbers.tolist():
        rows = choice.judged[store.clip[choice.judged] == clip]

        def tell(frames: int, clip: int = clip, done: int = done, count: int = len(rows)) -> None:
            show(0.9 * (done + frames) / total, f"clip {store.clips[clip].clip_id}, frame {frames} of {count}")

        figures, said = _clip(judge, int(clip), rows, parts, tell)
        clips.append(figures)
        words.append(said)
        done += len(rows)
    novel = _novel(judge, parts, lambda line: show(0.9, line))
    efficiency = _efficiency(judge, parts, lambda line: show(0.95, line))
    scales = most_scales(store.size[1], store.size[0])
    return SynthesisEvaluation(
        about=dict(judge.asked),
        size=store.size,
        scales=scales,
        find=options.find,
        clips=tuple(clips),
        frechet={name.upper(): _frechet(name, words, judge.networks) for name in ("fid", "fvd")},
        novel=novel,
        efficiency=efficiency,
    )


def _clip(
    judge: Judge, clip: int, rows: Int[np.ndarray, " rows"], parts: Path | None, tell: Callable[[int], None]
) -> tuple[ClipFigures, dict[str, np.ndarray]]:
    """A clip's figures, and what networks said of its pictures."""
    store, options = judge.store, judge.options
    name = store.clips[clip].clip_id
    asked = {**judge.asked, "find": json.dumps(asdict(options.find)), "first": int(rows[0]), "last": int(rows[-1])}
    found = _earlier(parts, f"clip-{name}", asked)
    if found is not None and parts is not None:
        path = parts / f"clip-{name}.npz"
        said = dict(np.load(path)) if path.is_file() else {}
        return figures_from_json(found), said
    taker = WordTaker(judge.networks)
    job = ClipJob(
        store=store,
        rows=rows,
        standing=_standing(store, rows),
        truth=None if options.truth is None else options.truth / name,
        find=options.find,
    )
    figures = clip_figures(job, judge.maker, lpips=judge.networks.distances, words=taker, tell=tell)
    if parts is not None and taker.words:
        parts.mkdir(parents=True, exist_ok=True)
        with whole_file(parts / f"clip-{name}.npz") as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **taker.words)
    _keep(parts, f"clip-{name}", asked, figures_to_json(figures))
    return figures, taker.words


def _standing(store: FrameStore, rows: Int[np.ndarray, " rows"]) -> Int[np.ndarray, " standing"]:
    """Frames of the match whose camera is that of a clip which has one camera throughout; none where it moves."""
    first = store.cameras[int(rows[0])]
    if not _same_camera(store.cameras[rows], first).all():
        return rows[:0]
    matches = np.array(store.matches)[store.clip]
    own = np.flatnonzero(matches == matches[rows[0]])
    return own[_same_camera(store.cameras[own], first)]


def _same_camera(cameras: Camera, one: Camera) -> np.ndarray:
    """Which of the cameras are the same as one."""
    return np.all(
        [(values == getattr(one, name)).reshape(len(values), -1).all(axis=1) for name, values in vars(cameras).items()],
        axis=0,
    )


def _novel(judge: Judge, parts: Path | None, show: Callable[[str], None]) -> tuple[NovelView, ...] | str:
    """Novel views, or why there are none."""
    options = judge.options
    if not options.novel.frames:
        return "not asked for"
    if options.truth is None:
        return "the simulator's work folder was not given"
    asked = {**judge.asked, **asdict(options.novel)}
    found = _earlier(parts, "novel", asked)
    if found is None:
        strips: list[np.ndarray] = []

        def keep(view: NovelView, real: np.ndarray, made: np.ndarray) -> None:
            told = f"{view.place}: {view.direction}, {view.turned_deg:g} degrees; {view.psnr['frame']:.1f} dB"
            strips.append(strip(told, real, made))

        choice = judge.choice
        try:
            views = novel_views(
                judge.maker, choice.judged, choice.learned, options.truth, options.novel, show=show, keep=keep
            )
        except ValueError as error:
            return str(error)
        if parts is not None:
            parts.mkdir(parents=True, exist_ok=True)
            write_strips(parts / NOVEL_NAME, strips)
        _keep(parts, "novel", asked, {"views": [asdict(view) for view in views]})
        return views
    return tuple(
        NovelView(**{**view, "psnr": {name: number(value) for name, value in view["psnr"].items()}})
        for view in found["views"]
    )


def _efficiency(judge: Judge, parts: Path | None, show: Callable[[str], None]) -> tuple[Efficiency, ...] | str:
    """What frames take, or why nobody knows."""
    options, store, model = judge.options, judge.store, judge.maker.model
    if not options.efficiency_frames:
        return "not asked for"
    asked = {**judge.asked, **asdict(options.efficiency), "count": options.efficiency_frames}
    asked["size"] = "x".join(map(str, options.efficiency.size))
    found = _earlier(parts, "efficiency", asked)
    if found is not None:
        return tuple(efficiency_from_json(each) for each in found["frames"])
    measured = []
    judged = judge.choice.judged
    places = (np.arange(options.efficiency_frames) + 0.5) / options.efficiency_frames * len(judged)
    for row in np.unique(judged[places.astype(np.int64)]).tolist():
        show(f"efficiency: {store.place(row)}")
        camera = camera_at(store.cameras[row], np.array(options.efficiency.size) / np.array(store.size))
        states, styles = store.states([row], model.device), judge.maker.styles(row)
        try:
            each = efficiency_of(model, styles, camera, states, options.efficiency, place=store.place(row))
        except ValueError as error:
            return str(error)
        measured.append(each)
    _keep(parts, "efficiency", asked, {"frames": [asdict(each) for each in measured]})
    return tuple(measured)


def _frechet(name: Literal["fid", "fvd"], words: list[dict[str, np.ndarray]], networks: Networks) -> FrechetScore | str:
    """A Frechet distance of what a network said of made and real pictures."""
    origin = networks.origins[name.upper()]
    if origin.startswith("n/a"):
        return origin
    made, real = ([each[f"{name} {kind}"] for each in words if f"{name} {kind}" in each] for kind in ("made", "real"))
    if sum(len(part) for part in made) < LEAST_WORDS:
        return f"n/a (expected {LEAST_WORDS} pictures or clips at least, got {sum(len(part) for part in made)})"
    return frechet_score(np.concatenate(made), np.concatenate(real), np.random.default_rng(0))


def _asked(
    options: SynthesisEvaluationOptions,
    model: SynthesisModel,
    store: FrameStore,
    choice: Choice,
    about: Mapping[str, Any],
) -> dict[str, str | int | float]:
    data = about.get("data", {})
    return {
        "run": options.run.name,
        "model": model_digest(model)[:DIGITS],
        "preset": str(data.get("preset", "-")),
        "steps": int(about.get("step", 0)),
        "training minutes": round(float(about.get("elapsed_s", 0.0)) / 60, 1),
        "dataset": f"{options.dataset.name} {sha256_of(options.dataset / 'meta' / 'info.json')[:DIGITS]}",
        "split": choice.split,
        "judged frames": len(choice.judged),
        "pictures": f"{store.size[0]}x{store.size[1]}",
        "masks": "the renderer's own (-alpha)" if options.truth is None else "true",
        "styles": f"means over {options.pictures} frames that are not judged",
        "device": model.device.type,
    }


def _earlier(parts: Path | None, name: str, asked: Mapping[str, object]) -> dict[str, Any] | None:
    """A part of an earlier run with the same options.

    Raises:
        ValueError: If it was made with other ones; names them.
    """
    if parts is None or not (parts / f"{name}.json").is_file():
        return None
    path = parts / f"{name}.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        had, found = document["asked"], document["found"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: expected a part of an evaluation, got {error!r}") from error
    changed = [
        f"{key} ({had.get(key, 'none')} then, {value} now)"
        for key, value in plain(dict(asked)).items()
        if had.get(key) != value
    ]
    if changed:
        raise ValueError(f"{path}: expected the options it was begun with, got others: {', '.join(changed)}")
    return found


def _keep(parts: Path | None, name: str, asked: Mapping[str, object], found: Mapping[str, Any]) -> None:
    if parts is not None:
        parts.mkdir(parents=True, exist_ok=True)
        with whole_file(parts / f"{name}.json") as temporary:
            temporary.write_text(text_of(plain({"asked": dict(asked), "found": dict(found)})), encoding="utf-8")
