"""report.html of a demo: one page from the video to the rendered rally, with the commands that repeat each step.

Pictures stand in the page, videos lie beside it. Texts and file names come from outside: everything is escaped on its
way into the page.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from jaxtyping import Float

from pgm_data.dataset.documents import read_document
from pgm_data.dataset.files import whole_file
from pgm_data.dataset.stats import DatasetStats, dataset_stats, tally_document
from pgm_data.dataset.stats_table import ROWS
from pgm_data.stages.report_parts import duration, number, table, tiles
from pgm_data.stages.report_plots import Curve, plot
from pgm_data.stages.report_style import VIDEO_POLICY, page

PAGE_NAME = "report.html"
MARK = "<!-- written by pgm demo -->"
"""Stands in every page of a demo, by which the next one knows it."""
MOST_OVERLAYS = 3
"""Clips whose overlay plays on the page; of more, the first."""
SHEET_NAME, PROMPT_NAME = "sheet.png", "prompt.json"
"""Files of a played rally's folder."""


@dataclass(frozen=True, kw_only=True)
class DemoStep:
    """A step of a demo."""

    number: int
    title: str
    seconds: float
    """That it took."""
    commands: tuple[str, ...]
    """Lines for a shell that do the same."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What a comparison with the truth came to."""

    title: str
    rows: tuple[tuple[str, str | int], ...]
    """Names of figures, and the figures as they are shown."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainedModel:
    """How a training went."""

    run: Path
    """Its folder."""
    about: str
    """What was trained, for how long."""
    seconds: Float[np.ndarray, " lines"]
    """Of training, at each line of its log."""
    loss: Float[np.ndarray, " lines"]
    look_seconds: Float[np.ndarray, " looks"]
    """Of training, at each look at held-out pictures."""
    psnr: Float[np.ndarray, " looks"]
    """Of these, dB."""
    pictures: tuple[Path, ...]
    """Real pictures beside rendered ones, the latest last."""


@dataclass(frozen=True, kw_only=True)
class RenderedVideo:
    """A video that a model rendered."""

    path: Path
    caption: str


@dataclass(frozen=True, eq=False, kw_only=True)
class DemoReport:
    """All that the page tells; folders that are not there are left out."""

    out: Path
    """Folder of the demo, where the page is written."""
    source: str
    """Of the video, in words."""
    steps: tuple[DemoStep, ...]
    compared: tuple[Comparison, ...] = ()
    """With the truth; none of a video that has no truth."""
    trained: TrainedModel | None = None
    rendered: tuple[RenderedVideo, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    """Why there is none of `rally`, `trained` or `rendered`."""

    @property
    def work(self) -> Path:
        """The annotated clips."""
        return self.out / "work"

    @property
    def dataset(self) -> Path:
        """The packed dataset."""
        return self.out / "dataset"

    @property
    def rally(self) -> Path:
        """The played rally."""
        return self.out / "rally"


def write_demo_report(report: DemoReport) -> Path:
    """Write the demo's report.html; returns its path.

    Raises:
        ValueError: If a file that it shows cannot be read.
    """
    stats = dataset_stats(report.dataset) if (report.dataset / "meta" / "info.json").is_file() else None
    sections = [
        ("From video to metres", _annotated(report)),
        *([("Against the truth, which no step had seen", _compared(report.compared))] if report.compared else []),
        ("The dataset", _packed(report, stats)),
        ("A model that renders, trained on it", _trained(report)),
        ("A rally from words", _rally(report)),
        ("The rally rendered", _rendered(report)),
        ("Where to look next", _next(report)),
        ("How each step is repeated", _steps(report)),
    ]
    body = (
        f"{MARK}<h1>From a video to a rally that nobody played</h1>"
        f'<p class="quiet">{escape(report.source)}</p>{_summary(report, stats)}'
        + "".join(f"<h2>{place}. {escape(title)}</h2>{content}" for place, (title, content) in enumerate(sections, 1))
    )
    path = report.out / PAGE_NAME
    with whole_file(path) as temporary:
        # A file name may hold bytes that are no text.
        temporary.write_bytes(page("pgm demo", body, VIDEO_POLICY).encode("utf-8", "backslashreplace"))
    return path


def is_demo_report(path: Path) -> bool:
    """Whether a file is the page of a demo."""
    try:
        return path.is_file() and MARK in path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False


def _summary(report: DemoReport, stats: DatasetStats | None) -> str:
    values = [(duration(sum(step.seconds for step in report.steps)), "the whole demo")]
    if stats is not None:
        whole = stats.whole
        values += [
            (f"{len(whole.durations_s)}", "clips"),
            (f"{whole.frames}", "frames"),
            (f"{whole.annotated}", "of them with camera and players"),
            (f"{whole.captions}", "captions"),
        ]
    if report.trained is not None and len(report.trained.psnr):
        values.append((number(float(report.trained.psnr[-1]), 1), "PSNR of held-out patches, dB"))
    return tiles(values)


def _annotated(report: DemoReport) -> str:
    clips = sorted(path.parent for path in report.work.glob("*/overlay.mp4"))
    shown = [
        _video(report, clip / "overlay.mp4", f"{clip.name}: court, skeletons and ball drawn where they were found")
        for clip in clips[:MOST_OVERLAYS]
    ]
    more = f'<p class="quiet">{MOST_OVERLAYS} of {len(clips)} clips.</p>' if len(clips) > MOST_OVERLAYS else ""
    videos = f'<div class="pictures wide">{"".join(shown)}</div>{more}' if shown else _none("No clip was found.")
    return videos + f"<p>{_link(report, report.work / 'report.html')} has every clip, frame by frame.</p>"


def _compared(compared: Sequence[Comparison]) -> str:
    parts = []
    for comparison in compared:
        rows = [
            f'<tr><td>{escape(name)}</td><td class="n">{escape(str(value))}</td></tr>'
            for name, value in comparison.rows
        ]
        parts.append(f"<div>{table((comparison.title, '#'), rows)}</div>")
    return f'<div class="plots">{"".join(parts)}</div>'


def _packed(report: DemoReport, stats: DatasetStats | None) -> str:
    if stats is None:
        return _none("Nothing was packed.")
    whole = tally_document(stats.whole)
    facts = [(title, show(whole)) for title, show in ROWS]
    return (
        f'<div class="card">{_facts(facts)}</div>'
        f"<p>{_link(report, report.dataset / 'README.md')} says how pandas, DuckDB, Hugging Face datasets and LeRobot "
        "open it.</p>"
    )


def _trained(report: DemoReport) -> str:
    trained = report.trained
    if trained is None:
        return _none(report.missing.get("trained", "None was trained."))
    loss = Curve(name="loss", values=trained.loss, style="c1")
    psnr = Curve(name="psnr", values=trained.psnr, style="c2")
    looks = (
        plot("PSNR of held-out patches", "dB, over seconds of training", trained.look_seconds, (psnr,))
        if len(trained.psnr) > 1
        else ""
    )
    pictures = [
        _picture(path, f"{path.stem.replace('_', ' ')}: frames that it did not learn from, and beside them its own")
        for path in trained.pictures
    ]
    return (
        f'<p>{escape(trained.about)}</p><div class="card"><div class="plots">'
        + plot("Loss", "over seconds of training", trained.seconds, (loss,))
        + f'{looks}</div></div><div class="pictures wide">{"".join(pictures)}</div>'
    )


def _rally(report: DemoReport) -> str:
    clips = sorted(path.parent for path in report.rally.glob(f"*/{PROMPT_NAME}"))
    if not clips:
        return _none(report.missing.get("rally", "None was played."))
    parts = []
    for clip in clips:
        prompt = read_document(clip / PROMPT_NAME, "prompt")
        rate = float(prompt["frames_per_second"])
        said = [
            f"<tr>{_span(words, rate)}<td>player{words['player']}</td><td>{escape(words['text'])}</td></tr>"
            for words in prompt.get("texts", ())
        ]
        given = [
            f"<tr>{_span(value, rate)}<td>{escape(value['column'])}</td><td>{escape(str(value['value']))}</td></tr>"
            for value in prompt.get("values", ())
        ]
        length = prompt["n_frames"] / rate
        parts.append(
            f"<p>{_link(report, clip / PROMPT_NAME)}, {length:.1f} s: all that the model was told.</p>"
            f"{table(('From s#', 'To s#', 'Player', 'Words'), said)}<br>"
            f"{table(('From s#', 'To s#', 'Column', 'Given value'), given)}"
        )
        if (clip / SHEET_NAME).is_file():
            parts.append(f"<p></p>{_picture(clip / SHEET_NAME, 'what it played, from above, and over time')}")
    return "".join(parts)


def _span(said: Mapping[str, Any], rate: float) -> str:
    """Cells of when it begins and ends, seconds."""
    return "".join(f'<td class="n">{said[end] / rate:.2f}</td>' for end in ("start_frame", "end_frame"))


def _rendered(report: DemoReport) -> str:
    shown = [_video(report, video.path, video.caption) for video in report.rendered]
    why = report.missing.get("rendered", "")
    return (_none(why) if why or not shown else "") + f'<div class="pictures wide">{"".join(shown)}</div>'


def _next(report: DemoReport) -> str:
    places = [
        (report.work / "report.html", "cameras, players, ball and words of every clip, with their plots"),
        (report.dataset / "README.md", "what the dataset holds, and how it is opened"),
        (report.rally, "the rally as a work folder, with all that an annotated video has"),
        (report.out / "prompt", "its prompt and camera: change them, and play again"),
        (report.out / "synthesis", "the run of the model that renders: log, pictures and weights"),
        (report.out / "rendered", "the videos, and how they were made"),
    ]
    links = [f"<li>{_link(report, path)}: {escape(what)}</li>" for path, what in places if path.exists()]
    return f'<div class="card"><ul>{"".join(links)}</ul></div>'


def _steps(report: DemoReport) -> str:
    rows = []
    for step in report.steps:
        commands = "<br>".join(f"<code>{escape(command)}</code>" for command in step.commands)
        rows.append(
            f'<tr><td class="n">{step.number}</td><td>{escape(step.title)}</td>'
            f'<td class="n">{duration(step.seconds)}</td><td class="why">{commands}</td></tr>'
        )
    return table(("#", "Step", "Took#", "Commands"), rows)


def _facts(facts: Sequence[tuple[str, str]]) -> str:
    return "<dl>" + "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts) + "</dl>"


def _none(why: str) -> str:
    return f'<p class="quiet">{escape(why)}</p>'


def _address(report: DemoReport, path: Path) -> str:
    relative = path.relative_to(report.out).as_posix()
    return f"./{quote(relative, errors='replace')}{'/' if path.is_dir() else ''}"


def _link(report: DemoReport, path: Path) -> str:
    return f'<a href="{_address(report, path)}">{escape(path.relative_to(report.out).as_posix())}</a>'


def _video(report: DemoReport, path: Path, caption: str) -> str:
    return (
        f'<figure><video controls muted loop playsinline preload="metadata" src="{_address(report, path)}"></video>'
        f"<figcaption>{escape(caption)}; {_link(report, path)}</figcaption></figure>"
    )


def _picture(path: Path, caption: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return (
        f'<figure><img src="data:image/png;base64,{data}" alt="{escape(caption)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )
