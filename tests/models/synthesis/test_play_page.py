"""The page of `pgm play` in headless Chromium: what a person does with it, and what comes of it."""

import json
import time

import numpy as np
import pytest

from pgm_data.dataset.documents import document_faults
from pgm_data.geometry.camera import Camera, project
from pgm_data.geometry.rigid import is_rotation
from pgm_models.animation.prompt import prompt_of
from pgm_models.synthesis.camera_paths import looking_at
from pgm_models.synthesis.play_server import PlayServer
from tests.models.synthesis.headless import Browser, chromium
from tests.models.synthesis.play_stages import Maker, draw_state, toy_stage

pytestmark = pytest.mark.skipif(chromium() is None, reason="no Chromium is installed")
READY = "document.body?.dataset.ready === 'yes'"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    # Chromium may still write into its profile for a moment, which pytest clears away later.
    found = Browser(tmp_path_factory.mktemp("chromium"))
    yield found
    found.close()


@pytest.fixture
def maker():
    return Maker(toy_stage())


@pytest.fixture
def page(browser, maker):
    """The page, freshly opened; afterwards nothing may have gone wrong in it."""
    with PlayServer(maker.stage, maker, draw_state) as server:
        browser.open(server.url, until=READY)
        browser.server = server
        yield browser
        # The page is left before its server goes away, so that nothing of it fails during the next test.
        troubles = list(browser.troubles)
        browser.open("about:blank")
        browser.troubles.clear()
        assert troubles == []


def on_canvas(page, canvas, place):
    """Where a place on a canvas is on the screen."""
    left, top = page.value(
        f"(({{left, top}}) => [left, top])(document.getElementById('{canvas}').getBoundingClientRect())"
    )
    return left + place[0], top + place[1]


def above(page, metres):
    """Where a place of the ground is on the screen, in the top view."""
    page.value("new Promise(requestAnimationFrame)")
    return on_canvas(page, "topview", page.value(f"page.top.px({json.dumps(list(metres))})"))


def drag(page, start, *places):
    page.drag(above(page, start), *[above(page, place) for place in places])


def document(page):
    return json.loads(page.value("JSON.stringify(page.prompt.toDocument())"))


def type_into(page, selector, text, kind="input"):
    page.value(
        f"(e => {{ e.value = {json.dumps(text)}; e.dispatchEvent(new Event('{kind}')); }})"
        f"(document.querySelector({json.dumps(selector)}))"
    )


def click(page, name):
    page.value(f"document.getElementById('{name}').click()")


def trouble(page):
    page.wait("!document.getElementById('trouble').hidden")
    return page.value("document.getElementById('trouble').textContent")


def test_dragging_and_typing_make_a_prompt_that_the_model_follows(page, maker):
    start = page.value("page.prompt.things[2].start")
    drag(page, start, (2.0, 3.0), (3.0, 4.0))  # the ball, at time 0
    page.value("page.scrub(1.0)")
    drag(page, (3.0, 4.0), (3.0, 0.0), (-2.0, -6.0))  # and a second later elsewhere
    type_into(page, "textarea", "  the player serves wide ")
    type_into(page, "#length", "2.0", "change")
    type_into(page, "#seed", "42", "change")
    made = document(page)
    assert document_faults("prompt", made) == ()
    prompt = prompt_of(made, maker.stage.layout)
    assert (prompt.frames, prompt.rate, prompt.seed) == (20, 10.0, 42)
    assert [(text.player, text.start, text.end, text.text) for text in prompt.texts] == [
        (0, 0, 20, "the player serves wide")
    ]
    assert [(value.column, value.start, value.end) for value in prompt.values] == [
        ("ball.position", 0, 1),
        ("ball.position", 10, 11),
    ]
    first, second = (value.values[0] for value in prompt.values)
    np.testing.assert_allclose(first[:2], [3, 4], atol=0.1)
    np.testing.assert_allclose(second[:2], [-2, -6], atol=0.1)
    assert first[2] == start[2]


def test_key_times_are_moved_on_the_timeline_and_let_go(page):
    page.value("page.put('player0', [1, -10, 0.9])")
    x, y = page.value("[page.timeline.x(0), 24 + 13]")
    to = page.value("page.timeline.x(1.5)")
    page.drag(
        on_canvas(page, "timeline", (x, y)),
        on_canvas(page, "timeline", (x + 20, y)),
        on_canvas(page, "timeline", (to, y)),
    )
    (value,) = document(page)["values"]
    assert (value["column"], value["start_frame"]) == ("player0.root_position", 15)
    page.wait("document.getElementById('keytitle').textContent === 'Near player at 1.50 s'")
    type_into(page, "#keyz", "1.25", "change")
    assert document(page)["values"][0]["value"] == [1, -10, 1.25]
    page.press("Delete")
    assert document(page)["values"] == []
    page.wait("document.getElementById('key').hidden")


def test_a_rally_is_made_played_and_scrubbed(page, maker):
    type_into(page, "#length", "2", "change")
    click(page, "asfigures")
    click(page, "make")
    page.wait("page.rally !== null")
    assert maker.made[0] == document(page)
    page.wait("page.time > 0.2")  # it plays by itself
    page.press(" ")
    assert not page.value("page.playing")
    page.value("page.scrub(0.5)")
    page.press("ArrowRight")
    assert page.value("page.time") == pytest.approx(0.6)
    np.testing.assert_allclose(page.value("page.shown.players[1].root"), [0.6, 8.0, 0.9])
    np.testing.assert_allclose(page.value("page.shown.ball.place"), [1, -2, 1], atol=1e-9)
    assert page.value("page.shown.players[0].joints.length") == 72
    x, y = page.value("(page.draw(0), page.top.px([0.6 + 0.4, 8]))")
    ink = pixel(page, "topview", (x, y))
    court = pixel(page, "topview", page.value("page.top.px([-3, 9])"))
    assert np.abs(ink - court).max() > 20  # the player stands there, and nobody elsewhere on the court
    assert "1 warning" in page.value("document.querySelector('#said summary').textContent")


def pixel(page, canvas, place):
    script = (
        "[...document.getElementById('{}').getContext('2d').getImageData(Math.round({}), Math.round({}), 1, 1).data]"
    )
    return np.array(page.value(script.format(canvas, *place)))


def test_rendered_pictures_come_from_the_camera_that_is_seen(page):
    type_into(page, "#length", "0.5", "change")
    click(page, "make")
    page.wait("page.rally !== null")
    page.wait("page.pictures.count === page.rally.frames")
    for turned in (False, True):
        if turned:
            middle = on_canvas(page, "figures", (300, 200))
            page.drag(middle, (middle[0] + 60, middle[1] + 10))
            assert page.value("page.view.orbit !== null")
        page.value("page.scrub(0.3)")
        page.wait("page.pictures.bitmaps.get(3)")
        place = page.value(
            "import('./camera.js').then(({sized, toCamera, toPixel}) => { page.draw(0);"
            "const canvas = document.getElementById('figures');"
            "const camera = sized(page.view.camera(3), canvas.clientWidth, canvas.clientHeight);"
            "return toPixel(camera, toCamera(camera, page.shown.players[0].root)); })"
        )
        red, green, blue, _ = pixel(page, "figures", place)
        assert red > 180 and green < 100 and blue < 100, (turned, place)


def test_trouble_is_said_in_words(page, maker):
    type_into(page, "#seed", "13", "change")
    click(page, "make")
    assert trouble(page) == "prompt: seed: expected a lucky number, got 13"
    assert not page.value("document.getElementById('make').disabled")
    type_into(page, "#seed", "14", "change")
    click(page, "make")
    page.wait("document.getElementById('trouble').textContent.startsWith('RuntimeError')")
    assert page.troubles == []
    page.server.close()
    click(page, "make")
    page.wait("document.getElementById('trouble').textContent.startsWith('The server does not answer')")
    # What was being fetched when the server went away ends as it may: refused, reset, empty or cut short.
    page.troubles[:] = [text for text in page.troubles if not text.startswith("Failed to load resource: net::ERR_")]
    page.server.close = lambda: None


def test_a_rally_is_cancelled(page, maker):
    maker.go.clear()
    click(page, "make")
    page.wait("document.getElementById('doing').textContent.startsWith('step 1')")
    click(page, "cancel")
    page.wait("!document.getElementById('make').disabled")
    assert page.value("page.rally") is None and page.value("document.getElementById('trouble').hidden")
    assert not maker.made


def test_prompts_that_are_saved_are_opened_again(page):
    page.value("page.put('player1', [1, 11, 0.9]); page.scrub(0.7); page.put('ball', [0, 2, 3.5]); 0")
    type_into(page, "textarea", "the player walks")
    saved = document(page)
    saved["values"].append({"column": "player0.root_rotation", "start_frame": 0, "end_frame": 1, "value": [0, 0, 1]})
    click(page, "clear")
    assert document(page)["values"] == document(page)["texts"] == []
    page.value(f"page.panel.take({json.dumps(saved)})")
    again = document(page)
    assert sorted(again["values"], key=str) == sorted(saved["values"], key=str)
    assert {name: again[name] for name in saved if name != "values"} == {n: saved[n] for n in saved if n != "values"}
    assert "player0.root_rotation" in trouble(page)


def test_a_moment_of_a_rally_begins_the_next_one(page, maker):
    type_into(page, "textarea", "the player serves")
    click(page, "make")
    page.wait("page.rally !== null")
    page.value("page.scrub(1.2)")
    page.wait("!document.getElementById('goon').hidden")
    click(page, "goon")
    page.wait("page.rally === null")
    type_into(page, "#length", "1", "change")
    made = document(page)
    assert [text["end_frame"] for text in made["texts"]] == [10]
    prompt = prompt_of(made, maker.stage.layout)
    given = {value.column: (value.start, value.end, value.values[0].tolist()) for value in prompt.values}
    assert given.keys() == {"player0.root_position", "player1.root_position", "ball.position", "ball.velocity"}
    assert given["ball.velocity"] == (0, 1, [0.0, 5.0, 0.0])
    np.testing.assert_allclose(given["player1.root_position"][2], [1.2, 8.0, 0.9])
    np.testing.assert_allclose(page.value("page.shown.ball.place"), [1, 1, 1])


def test_words_can_follow_one_another(page):
    type_into(page, "textarea", "the player serves")
    page.value("document.querySelector('.who button').click()")
    type_into(page, ".saying + .saying textarea", "then runs")
    texts = [(text["start_frame"], text["end_frame"], text["text"]) for text in document(page)["texts"]]
    assert texts == [(0, 20, "the player serves"), (20, 40, "then runs")]
    page.value("document.querySelector('.span button').click()")
    assert [(text["start_frame"], text["end_frame"], text["text"]) for text in document(page)["texts"]] == [
        (0, 40, "then runs")
    ]


def test_the_page_projects_as_the_package_does(page):
    rng = np.random.default_rng(0)
    position, points = np.array([3.0, -30.0, 9.0]), rng.uniform(-6, 6, (20, 3))
    K = np.array([[900.0, 3.0, 320.0], [0, 950, 170], [0, 0, 1]])
    R, lens = looking_at(position, np.array([1.0, 0, 0]), 4.0), np.array([0.05, -0.02, 0.002, -0.003])
    camera = Camera(K=K, distortion=lens, R_cam_from_world=R, t_cam_from_world=-R @ position)
    sent = {"width": 640, "height": 360, "K": K.ravel().tolist(), "distortion": lens.tolist()}
    sent |= {"R": R.ravel().tolist(), "t": camera.t_cam_from_world.tolist()}
    made = page.value(
        f"import('./camera.js').then(({{toCamera, toPixel}}) => {json.dumps(points.tolist())}"
        f".map((point) => toPixel({json.dumps(sent)}, toCamera({json.dumps(sent)}, point))))"
    )
    np.testing.assert_allclose(made, project(camera, points)[0], atol=1e-9)
    orbit = page.value(
        f"import('./camera.js').then(({{Orbit}}) => {{ const o = new Orbit({json.dumps(sent)}, 0);"
        "const before = o.now; o.turn(0.7, 0.1); return [o.aim, before, o.now]; })"
    )
    aim, before, after = orbit
    R_level = looking_at(position, np.array(aim))
    np.testing.assert_allclose(np.reshape(before["R"], (3, 3)), R_level, atol=1e-9)
    R_after = np.reshape(after["R"], (3, 3))
    assert is_rotation(R_after)
    there = -R_after.T @ after["t"]
    np.testing.assert_allclose(R_after, looking_at(there, np.array(aim)), atol=1e-9)
    assert np.linalg.norm(there - aim) == pytest.approx(np.linalg.norm(position - aim))


def test_a_scene_without_court_and_ball_has_its_page_in_the_dark_too(browser, tmp_path):
    stage = toy_stage("blocks")
    browser.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    with PlayServer(stage, Maker(stage), None) as server:
        browser.troubles.clear()
        browser.open(server.url, until=READY)
        start = browser.value("page.prompt.things[0].start")
        drag(browser, start, (2.0, 2.0), (3.0, -4.0))
        (value,) = document(browser)["values"]
        np.testing.assert_allclose(value["value"][:2], [3, -4], atol=0.1)
        assert browser.value("document.getElementById('kinds').hidden")
        assert browser.value("getComputedStyle(document.body).backgroundColor") == "rgb(14, 18, 23)"
        assert pixel(browser, "topview", (200, 5))[:3].max() < 80
        type_into(browser, "#length", "1", "change")
        click(browser, "make")
        browser.wait("page.rally !== null")
        ends = time.monotonic() + 20
        while browser.value("page.time") == 0 and time.monotonic() < ends:
            time.sleep(0.05)
        assert browser.troubles == []
    browser.ask("Emulation.setEmulatedMedia", features=[])
