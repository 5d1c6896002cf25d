import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from pgm_data.dataset.clip_ball import write_clip_ball
from pgm_data.scene import load_scene
from pgm_data.stages.ball_paths import flight_paths
from pgm_data.stages.ball_plots import rally_plots, views_of
from pgm_data.stages.ball_report import ball_cells, ball_section
from pgm_data.stages.report import write_clip_report, write_work_report
from tests.convert.folders import cameras, numbered_video, track, write_work
from tests.stages.ball_clips import known_ball

TRACK = track("rally", cameras(24))
BALL = known_ball(TRACK)
PATHS = flight_paths(BALL)
COURT = load_scene("tennis").court
SCENE = load_scene("tennis")
EVIL = '"><script>alert(1)</script>'


class Shapes(HTMLParser):
    """Tags and attributes of a page, which must be balanced."""

    def __init__(self, content):
        super().__init__()
        self.open, self.tags, self.text = [], [], ""
        self.feed(content)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in {"meta", "br", "img"}:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def numbers(text):
    return np.array([float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", text)])


def test_the_page_of_a_clip_with_a_ball_has_its_section_and_others_have_none(tmp_path):
    numbered_video(tmp_path / "match.mp4", 40)
    work = tmp_path / "work"
    tracks = [TRACK, track("other", cameras(10), first=26)]
    write_work(work, tracks, tmp_path / "match.mp4", video_frames=40)
    assert "Ball" not in write_work_report(work).read_text()
    write_clip_ball(work / "rally", BALL, scene=SCENE)
    page = write_clip_report(work, "rally").read_text()
    assert "<h2>Ball</h2>" in page and "<h2>Rallies</h2>" in page
    Shapes(page)
    assert "<h2>Ball</h2>" not in write_clip_report(work, "other").read_text()
    whole = Shapes(write_work_report(work).read_text())
    assert "Fastest km/h" in whole.text and "180" in whole.text
    (work / "rally" / "events.parquet").write_bytes(b"PAR1")
    with pytest.raises(ValueError, match=r"events.parquet"):
        write_clip_report(work, "rally")
    page = Shapes(write_work_report(work).read_text())
    assert "events.parquet" in page.text
    spans = [int(attributes["colspan"]) for tag, attributes in page.tags if "colspan" in attributes]
    heads = page.text[: page.text.index("events.parquet")]
    assert spans == [13] and "Fastest" not in heads


def test_the_section_tells_speeds_spin_landing_events_and_the_solvers_words():
    section = ball_section(BALL, "tennis")
    text = Shapes(section).text
    assert "solved" in text and "fallback: <few> frames" in text and "<few>" not in section
    row = re.findall(r"<tr>.*?</tr>", section)[1]
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert cells[4] == "180" and cells[5:8] == ["hit to bounce", "player1", "topspin 2866/min"]
    assert cells[8:11] == ["-2.00, -7.00", "0.97", "0.80"]
    net = re.findall(r"<tr>.*?</tr>", section)[3]
    assert "near end" in net and re.findall(r"<td[^>]*>(.*?)</td>", net)[7] == "–"
    placed = (BALL.status == "measured").sum() / len(BALL.status)
    assert f"{100 * placed:.1f} %" in text and "human" in text and "0.60" in text
    assert ball_cells(BALL) == (f"{100 * (BALL.status != 'none').mean():.1f} %", "2", "180")
    assert ball_cells(None) == ("–", "–", "–")


def test_words_from_outside_are_escaped():
    words = {"player": np.array([EVIL, "", ""], dtype=object), "status": np.array([EVIL] * 3, dtype=object)}
    evil = replace(
        BALL,
        shots=replace(BALL.shots, free_parameters=words["status"], **words),
        events=replace(
            BALL.events, player=np.array([EVIL] * 4, dtype=object), source=np.array([EVIL] * 4, dtype=object)
        ),
    )
    assert "<script" not in ball_section(evil, EVIL)


def test_both_views_put_court_and_ball_where_they_are_in_centimetres():
    above, side = views_of(COURT, PATHS)
    points = np.array([[1.0, -7.0, 2.0]])
    np.testing.assert_allclose(above.places(points), [[-700, 100]])
    np.testing.assert_allclose(side.places(points), [[-700, -200]])
    cov = np.array([[[1.0, 0.2, 0.3], [0.2, 4.0, 0.5], [0.3, 0.5, 9.0]]])
    np.testing.assert_allclose(above.cov(cov), [1e4 * np.array([[4, 0.2], [0.2, 1]])])
    np.testing.assert_allclose(side.cov(cov), [1e4 * np.array([[4, -0.5], [-0.5, 9]])])
    for view in (above, side):
        seen = view.places(np.concatenate([COURT.points_world, PATHS.points_world]))
        assert (seen >= view.low).all() and (seen <= view.high).all()


def test_a_rally_is_drawn_flight_by_flight_with_its_contacts_landings_and_bands():
    html = rally_plots(BALL, PATHS, COURT, np.arange(3))
    tags = Shapes(html).tags
    flights = [attributes for tag, attributes in tags if attributes.get("class", "").startswith("flight")]
    assert [attributes["class"] for attributes in flights] == ["flight h2", "flight h2", "flight h1"] * 2
    drawn = numbers(flights[0]["d"]).reshape(-1, 2)
    np.testing.assert_allclose(drawn, 100 * PATHS.points_world[PATHS.samples(0)][:, [1, 0]], atol=0.51)
    bands = [attributes for tag, attributes in tags if tag == "ellipse"]
    # The long axis, 30 cm, lies along y, which runs across the page.
    assert {(b["rx"], b["ry"]) for b in bands} == {("30.0", "10.0")}
    assert all(abs(numbers(b["transform"])[-1]) in (0, 180) for b in bands)
    classes = [attributes["class"] for tag, attributes in tags if tag == "circle"]
    assert classes == ["hit", "bounce", "hit", "touch", "in", "out"] * 2
    assert "0.97" in html and "probability 0.04" in html


def test_a_rally_without_a_court_without_places_or_with_a_stray_ball_is_drawn_too():
    assert "<svg" in rally_plots(BALL, PATHS, None, np.arange(3))
    nowhere = replace(
        BALL,
        position=np.full_like(BALL.position, np.nan),
        events=replace(BALL.events, position=np.full((4, 3), np.nan)),
    )
    html = rally_plots(nowhere, flight_paths(nowhere), None, np.arange(3))
    assert "nan" not in html.lower()
    far = replace(BALL, events=replace(BALL.events, position=BALL.events.position * [1, 1, 1] + [0, 1e6, 0]))
    _, side = views_of(COURT, flight_paths(far))
    assert side.high[0] < 100 * 18.3 * 1.6 + 100


def test_a_ball_without_flights_or_of_an_unknown_scene_has_a_section():
    shots = replace(BALL.shots, **{name: getattr(BALL.shots, name)[:0] for name in BALL.shots.__dataclass_fields__})
    Shapes(ball_section(replace(BALL, shots=shots), "tennis"))
    Shapes(ball_section(BALL, "a scene of somebody's"))
