import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pgm_data.dataset.documents import read_document, write_document
from pgm_data.provenance import run_document
from pgm_data.scene import load_scene
from pgm_data.stages.overlay import write_overlays
from pgm_data.stages.report import write_clip_report, write_work_report
from pgm_data.stages.report_figures import clip_figures, counted, work_figures
from pgm_data.stages.report_plots import COLUMNS, Curve, nice_ticks, plot, strip, thinned
from tests.convert.folders import cameras, numbered_video, track, write_work

EVIL = "<img src=x onerror=alert(1)>&\"'.mp4"
VOID = {"meta", "br", "img"}


class Page(HTMLParser):
    """Tags balanced, every attribute and all text of a page."""

    def __init__(self, content: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.text = ""
        self.feed(content)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def assert_self_contained(page: Page) -> None:
    for tag, attributes in page.tags:
        assert tag not in {"script", "link", "iframe", "object", "base", "form"}
        assert not [name for name in attributes if name.startswith("on")]
        if "src" in attributes:
            assert attributes["src"].startswith("data:image/jpeg;base64,")
        if "href" in attributes:
            assert attributes["href"].startswith("./")
    assert "url(" not in page.text and "@import" not in page.text


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    root = tmp_path_factory.mktemp("report")
    numbered_video(root / "match.mp4", 30)
    tracks = [
        track("match.00", cameras(8), interpolated=(3,), first=2),
        track("it's 01&", cameras(12, seed=1), none=(0, 4, 11), first=15),
    ]
    work = root / "work"
    write_work(work, tracks, root / "match.mp4", video_frames=30)
    write_overlays(work, ("match.00", "it's 01&"), video=root / "match.mp4", scene=load_scene("tennis"))
    inputs = [
        {
            "path": "match.mp4",
            "state": "degraded",
            "reason": "3 frames",
            "clips": ["match.00", "it's 01&"],
            "seconds": 2.0,
        },
        {"path": EVIL, "state": "failed", "reason": "expected a video, found <script>", "clips": [], "seconds": 0.1},
        {"path": "notes <b>.txt", "state": "ignored", "reason": "no video by its ending", "clips": [], "seconds": None},
    ]
    from datetime import UTC, datetime

    run = run_document(command="pgm-calibrate <x>", options={}, started=datetime.now(UTC), inputs=inputs)
    write_document(work / "run.json", "run", run)
    return work


def test_a_work_report_stands_alone_and_escapes_every_name(made):
    content = write_work_report(made).read_text(encoding="utf-8")
    page = Page(content)
    assert_self_contained(page)
    assert "<img src=x" not in content and "<script" not in content
    for text in (EVIL, "found <script>", "notes <b>.txt", "pgm-calibrate <x>", "it's 01&", "px above 1.5 px <b>"):
        assert text in page.text
    links = [attributes["href"] for tag, attributes in page.tags if tag == "a"]
    assert links == ["./it%27s%2001%26/report.html", "./match.00/report.html"]


def test_a_work_report_shows_states_shares_speed_and_reasons(made):
    text = Page(write_work_report(made).read_text(encoding="utf-8")).text
    words = " ".join(text.split())
    for expected in (
        "75.0 %",  # measured of the second clip
        "87.5 %",  # measured of the first
        "15.0",  # 30 frames in 2 s
        "no video by its ending",
        "close-up: 2 of 14 points",
        "bridged",
        "0.30 ± 0.10, -35.00 ± 0.20, 9.00 ± 0.05",
        "k1: it lowers the residual from 0.61 to 0.43 px",
    ):
        assert expected in words, expected


def test_a_clip_report_stands_alone_with_plots_and_key_frames(made):
    page = Page(write_clip_report(made, "it's 01&").read_text(encoding="utf-8"))
    assert_self_contained(page)
    tags = [tag for tag, _ in page.tags]
    assert tags.count("img") == 5
    assert tags.count("svg") == 5
    assert "frame 11, 1.05 s: none, residual 3.1 px above 1.5 px <b>" in page.text


def test_the_figures_are_those_of_the_columns(made):
    figures = clip_figures(made / "it's 01&")
    assert (figures.state, figures.frames_of("measured"), figures.frames_of("none")) == ("degraded", 9, 3)
    np.testing.assert_allclose(figures.position_world, [0.3, -35.0, 9.0], atol=1e-9)
    np.testing.assert_allclose(figures.position_std, [0.1, 0.2, 0.05])
    solved = figures.track.has_camera
    # The camera of the folder looks along +y, 15 degrees down, but for a jitter of 0.01 rad.
    assert np.abs(figures.pan_deg[solved]).max() < 3
    np.testing.assert_allclose(figures.tilt_deg[solved], -15, atol=3)
    assert np.isnan(figures.pan_deg[~solved]).all()


def test_a_camera_turned_right_and_up_has_pan_and_tilt_above_zero(made, tmp_path):
    from tests.convert.folders import Camera

    pan, tilt = np.deg2rad(20.0), np.deg2rad(5.0)
    forward = np.array([np.sin(pan) * np.cos(tilt), np.cos(pan) * np.cos(tilt), np.sin(tilt)])
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    camera = cameras(1)
    turned = Camera(
        K=camera.K, distortion=camera.distortion, R_cam_from_world=R[None], t_cam_from_world=np.ones((1, 3))
    )
    (tmp_path / "v.mp4").write_bytes(b"x")
    write_work(tmp_path / "w", [track("c", turned)], tmp_path / "v.mp4", video_frames=1)
    figures = clip_figures(tmp_path / "w" / "c")
    np.testing.assert_allclose((figures.pan_deg[0], figures.tilt_deg[0]), (20.0, 5.0))


def test_stated_positions_go_before_those_of_the_frames(made, tmp_path):
    (tmp_path / "v.mp4").write_bytes(b"x")
    write_work(tmp_path / "w", [track("c", cameras(3))], tmp_path / "v.mp4", video_frames=3)
    path = tmp_path / "w" / "c" / "clip.json"
    camera = {
        "position_world": [1.0, 2.0, 3.0],
        "position_std": [0.1, 0.1, 0.1],
        "jitter_px": 0.07,
        "evidence": {"F": 40},
    }
    write_document(path, "clip", read_document(path, "clip") | {"camera": camera})
    text = Page(write_clip_report(tmp_path / "w", "c").read_text(encoding="utf-8")).text
    assert "1.00 ± 0.10, 2.00 ± 0.10, 3.00 ± 0.10 m" in text and "0.07" in text and '{"F": 40}' in text


def test_a_folder_without_run_shots_or_overlays_still_gets_a_report(tmp_path):
    (tmp_path / "v.mp4").write_bytes(b"x")
    write_work(tmp_path / "w", [track("c", cameras(3), none=(0, 1, 2))], tmp_path / "v.mp4", video_frames=3)
    (tmp_path / "w" / "shots.parquet").unlink()
    page = Page(write_work_report(tmp_path / "w").read_text(encoding="utf-8"))
    assert "There is no run.json" in page.text and "failed" in page.text
    assert "No overlay was written." in Page(write_clip_report(tmp_path / "w", "c").read_text(encoding="utf-8")).text


def test_an_empty_work_folder_gets_a_report(tmp_path):
    assert "There is no run.json" in Page(write_work_report(tmp_path).read_text(encoding="utf-8")).text


def test_a_clip_that_cannot_be_read_is_named_with_its_reason(made, tmp_path):
    (tmp_path / "v.mp4").write_bytes(b"x")
    tracks = [track("good", cameras(3)), track("torn", cameras(3), first=3)]
    write_work(tmp_path / "w", tracks, tmp_path / "v.mp4", video_frames=6)
    (tmp_path / "w" / "torn" / "camera.parquet").write_bytes(b"PAR1")
    figures = work_figures(tmp_path / "w")
    assert [clip.clip_id for clip in figures.clips] == ["good"]
    assert figures.unreadable[0][0] == "torn"
    assert "expected a parquet file" in Page(write_work_report(tmp_path / "w").read_text(encoding="utf-8")).text


def test_names_that_are_no_text_do_not_break_the_page(tmp_path):
    work = tmp_path / "w"
    work.mkdir()
    path = b"bad\xff.mp4".decode("utf-8", "surrogateescape")
    inputs = [{"path": path, "state": "failed", "reason": "", "clips": [], "seconds": 0.0}]
    run = {"command": "x", "options": {}, "versions": {}, "commit": "", "started": "2026-01-01T00:00:00Z"}
    document = run | {"seconds": None, "machine": {}, "inputs": inputs}
    (work / "run.json").write_text(json.dumps(document))
    assert "bad" in Page(write_work_report(work).read_text(encoding="utf-8")).text


def test_reasons_that_differ_in_numbers_count_as_one():
    reasons = [("none", "residual 1.52 px above 1.5", 3), ("none", "residual 9e3 px above 1.5", 4), ("none", "cut", 5)]
    found = counted([*reasons, ("interpolated", "cut", 1)])
    assert [(r.status, r.reason, r.frames) for r in found] == [
        ("none", "residual 1.52 px above 1.5", 7),
        ("none", "cut", 5),
        ("interpolated", "cut", 1),
    ]


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 8))
def test_ticks_are_few_round_and_inside(low, span, most):
    high = low + span
    ticks = nice_ticks(low, high, most)
    assert 1 <= len(ticks) <= most
    slack = 1e-6 * span + 1e-9 * abs(low)
    assert (ticks >= low - slack).all() and (ticks <= high + slack).all()
    if len(ticks) > 1:
        step = np.diff(ticks).mean()
        mantissa = step / 10 ** np.floor(np.log10(step) + 1e-9)
        assert min(abs(mantissa - m) for m in (1, 2, 5, 10)) < 1e-2


@given(st.integers(1, 20_000), st.integers(0, 2**32 - 1))
def test_a_thinned_curve_keeps_its_extremes_and_gaps(frames, seed):
    rng = np.random.default_rng(seed)
    times, values = np.arange(frames) / 25.0, rng.normal(size=frames)
    if frames > 100:
        values[frames // 2 : frames // 2 + 50] = np.nan
    t, v = thinned(times, values)
    assert len(t) <= 3 * COLUMNS and (np.diff(t) > 0).all()
    assert (np.nanmin(v), np.nanmax(v)) == (np.nanmin(values), np.nanmax(values))
    assert np.isnan(v).any() == np.isnan(values).any()


def test_one_frame_without_a_camera_among_many_shows_in_the_strip():
    status = np.full(50_000, "measured", dtype=object)
    status[31_000] = "none"
    found = strip(np.arange(50_000) / 50, status, axis=False)
    assert found.count("s-none") == 1
    assert len(found) < 1000


@given(arrays(np.float64, 7, elements=st.floats(allow_nan=True, allow_infinity=True, width=32)))
def test_any_values_give_a_plot_without_nan(values):
    found = plot("t", "px", np.arange(7.0), (Curve(name="a", values=values, style="c1"),))
    assert not re.search(r"nan|inf", found.lower().replace("infinity", "inf"))
    Page(found)
