"""A demo's page: what happened is on it, what did not is said, and nothing from outside becomes HTML."""

import json
import re
from pathlib import Path
from urllib.parse import unquote

import cv2
import numpy as np
import pytest

from pgm_data.stages.demo_report import (
    MARK,
    Comparison,
    DemoReport,
    DemoStep,
    RenderedVideo,
    TrainedModel,
    is_demo_report,
    write_demo_report,
)

NASTY = "<script>alert('&')</script>"


@pytest.fixture
def demo(tmp_path: Path) -> DemoReport:
    """A demo that came to its end, with texts that would like to be HTML."""
    overlay = tmp_path / "work" / "rally one" / "overlay.mp4"
    sheet = tmp_path / "rally" / "played" / "sheet.png"
    look = tmp_path / "synthesis" / "samples" / "step_000007.png"
    video = tmp_path / "rendered" / "rally.mp4"
    for path in (overlay, sheet, look, video, tmp_path / "dataset" / "README.md", tmp_path / "prompt" / "rally.json"):
        path.parent.mkdir(parents=True)
        path.write_bytes(b"")
    for path in (sheet, look):
        cv2.imwrite(str(path), np.zeros((2, 3, 3), np.uint8))
    prompt = {
        "scene": "tennis",
        "n_frames": 50,
        "frames_per_second": 25,
        "texts": [{"player": 1, "start_frame": 5, "end_frame": 45, "text": f"the player serves {NASTY}"}],
        "values": [{"column": "ball.position", "start_frame": 0, "end_frame": 1, "value": [0.5, 7.0, 1.4]}],
    }
    (sheet.parent / "prompt.json").write_text(json.dumps(prompt))
    return DemoReport(
        out=tmp_path,
        source=f"{NASTY}.mp4",
        steps=(DemoStep(number=3, title=NASTY, seconds=200.0, commands=(f"pgm players '{NASTY}'",)),),
        compared=(Comparison(title="cameras", rows=(("error", "1.5 cm"), ("frames", 190))),),
        trained=TrainedModel(
            run=look.parent.parent,
            about="tiny, 3 minutes",
            seconds=np.array([1.0, 2.0, 3.0]),
            loss=np.array([3.0, 2.0, 1.0]),
            look_seconds=np.array([1.5, 3.0]),
            psnr=np.array([18.0, 23.4]),
            pictures=(look,),
        ),
        rendered=(RenderedVideo(path=video, caption="as the camera of the match sees it"),),
    )


def test_all_that_happened_is_there_in_its_order(demo):
    page = write_demo_report(demo)
    assert page == demo.out / "report.html" and is_demo_report(page)
    text = page.read_text()
    told = ["rally one", "1.5 cm", "Nothing was packed", "tiny, 3 minutes", "the player serves", "[0.5, 7.0, 1.4]"]
    told += ["what it played", "as the camera of the match sees it", "Where to look next", "pgm players"]
    places = [text.index(word) for word in told]
    assert places == sorted(places)
    assert "0.20" in text and "1.80" in text, "spans are told in seconds"
    assert "23.4" in text and "3.3 min" in text and text.count("data:image/png;base64,") == 2


def test_every_address_leads_to_something_of_the_demo(demo):
    text = write_demo_report(demo).read_text()
    addresses = re.findall(r'(?:href|src)="(?!data:)([^"]*)"', text)
    assert "./work/rally%20one/overlay.mp4" in addresses and "./rendered/rally.mp4" in addresses
    missing = [address for address in addresses if not (demo.out / unquote(address)).exists()]
    assert missing == ["./work/report.html"]  # which the test did not make


def test_texts_from_outside_stay_texts(demo):
    text = write_demo_report(demo).read_text()
    assert "<script" not in text and text.count("&lt;script&gt;") >= 4


def test_what_is_not_there_is_said(tmp_path):
    missing = {"rally": "no weights", "trained": "no minutes", "rendered": "no model"}
    text = write_demo_report(DemoReport(out=tmp_path, source="a.mp4", steps=(), missing=missing)).read_text()
    assert all(why in text for why in [*missing.values(), "No clip was found"])
    assert "<video" not in text and "Against the truth" not in text


def test_pages_of_others_are_told_from_ours(tmp_path):
    other = tmp_path / "report.html"
    assert not is_demo_report(other)
    other.write_text("<html>mine</html>")
    assert not is_demo_report(other)
    other.write_text(f"<html>{MARK}</html>")
    assert is_demo_report(other)
