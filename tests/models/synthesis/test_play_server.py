"""The server of the page: who may ask, what is answered, and that no address leads to a file."""

import re
import socket
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from pgm_data.geometry.camera import project
from pgm_models.synthesis.play_server import HOST, LARGEST_BODY, PlayServer, page_files
from tests.models.synthesis.play_stages import FRAMES, PROMPT, Maker, ask, draw_state, toy_stage

STAGE = toy_stage()
PAGE = Path(__file__).parents[3] / "pgm_models" / "synthesis" / "play_page"


@pytest.fixture(scope="module")
def server():
    with PlayServer(STAGE, Maker(STAGE), draw_state) as found:
        yield found


@pytest.fixture(scope="module")
def rally(server):
    """Name of a rally that is done."""
    return made(server, PROMPT)


def made(server, prompt):
    status, _, answer = ask(server.url + "api/rallies", prompt)
    assert status == 202, answer
    while (progress := ask(f"{server.url}api/rallies/{answer['rally']}")[2])["state"] in ("waiting", "making"):
        time.sleep(0.01)
    assert progress["state"] == "done", progress
    return answer["rally"]


def raw(server, text):
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall(text.encode())
        connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(65536), b"")).decode()


def camera_of(server, width=64, height=36):
    told = ask(server.url + "api/stage")[2]["camera"]
    K = np.array(told["K"][0]).reshape(3, 3)
    K[:2] *= width / told["width"]
    return {
        "width": width,
        "height": height,
        "K": K.ravel().tolist(),
        "distortion": told["distortion"],
        "R_cam_from_world": told["R"][0],
        "t_cam_from_world": told["t"][0],
    }


def test_the_page_and_its_files_are_served_as_they_are(server):
    status, headers, content = ask(server.url)
    assert status == 200 and headers["Content-Type"].startswith("text/html")
    assert content == (PAGE / "index.html").read_bytes()
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    for name, kind in (("page.js", "text/javascript"), ("page.css", "text/css"), ("index.html", "text/html")):
        status, headers, content = ask(server.url + name)
        assert status == 200 and headers.get_content_type() == kind and content == (PAGE / name).read_bytes()


def test_the_page_takes_nothing_from_elsewhere_and_all_it_takes_is_there():
    files = page_files()
    for path in PAGE.iterdir():
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"https?://|@import|\bsrc=\"//|url\(", text), path.name
        wanted = re.findall(r"(?:from |src=|href=)\"(?:\./)?([\w.]+\.(?:js|css))\"", text)
        assert set(wanted) <= set(files), path.name
    assert files[""] is files["index.html"] and not {"__init__.py", "README.md"} & set(files)


def test_it_listens_on_this_machine_alone(server):
    assert server.url.startswith(f"http://127.0.0.1:{server.port}/") and HOST == "127.0.0.1"
    assert len(server.token) >= 32
    other = PlayServer(STAGE, Maker(STAGE), None)
    assert other.token != server.token
    other.close()
    with pytest.raises(OSError, match=r"[Aa]ddress already in use"):
        PlayServer(STAGE, Maker(STAGE), None, port=server.port)


def test_a_connection_that_is_kept_open_ends_with_the_server():
    server = PlayServer(STAGE, Maker(STAGE), None)
    request = f"GET /{server.token}/page.css HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode()
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall(request)
        assert connection.recv(100).startswith(b"HTTP/1.1 200 ")
        server.close()
        rest = b"".join(iter(lambda: connection.recv(65536), b""))  # until it hangs up
    assert b"HTTP/1.1" not in rest


@pytest.mark.parametrize("address", ["", "api/stage", "wrong/", "wrong/api/stage", "TOKEN", "TOKENx/", "%2e%2e/"])
def test_without_the_token_nothing_is_told(server, address):
    address = address.replace("TOKEN", server.token)
    status, _, answer = ask(f"http://127.0.0.1:{server.port}/{address}")
    assert status == 403 and "pgm play printed" in answer["error"] and server.token not in str(answer)


@pytest.mark.parametrize(
    "address",
    [
        "../play_server.py",
        "..%2fplay_server.py",
        "%2e%2e/play_server.py",
        "/etc/passwd",
        "play_server.py",
        "page.js/",
        "./page.js",
        "api",
        "api/rallies",
        "api/rallies/1/states/x",
        "api/rallies/1/pictures/-1",
        "api/rallies/1/pictures/²",
    ],
)
def test_no_address_leads_to_a_file_or_elsewhere(server, address):
    # By hand: a client would tidy it.
    lines = f"GET /{server.token}/{address} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n"
    answer = raw(server, lines)
    assert answer.startswith("HTTP/1.1 404 ") and answer.endswith('{"error":"there is nothing at this address"}')


@pytest.mark.parametrize(
    "headers",
    [{"Host": "elsewhere.org"}, {"Host": "127.0.0.1"}, {"Origin": "http://elsewhere.org"}, {"Origin": "null"}],
)
def test_other_pages_may_not_ask(server, headers):
    status, _, answer = ask(server.url + "api/rallies", PROMPT, **headers)
    assert status == 403 and "expected" in answer["error"]
    assert ask(server.url, Origin=f"http://127.0.0.1:{server.port}")[0] == 200


def test_a_page_is_told_of_the_stage(server):
    told = ask(server.url + "api/stage")[2]
    assert told["scene"] == "tennis" and told["renders"] and told["rates"] == {"low": 4, "high": 10, "usual": 10}
    assert [player["label"] for player in told["players"]] == ["Near player", "Far player"]
    assert len(told["lines"]) == len(STAGE.scene.court.line_names) and told["ball"]["column"] == "ball.position"


def test_a_rally_comes_back_as_it_was_made(server, rally):
    told = ask(f"{server.url}api/rallies/{rally}/states")[2]
    assert told["frames"] == FRAMES and told["prompt"] == PROMPT and told["warnings"] == ["a doubt"]
    assert told["players"][1]["root"][3] == [0.3, 8.0, 0.9]
    assert told["ball"][0] is None and told["ball"][4] == [1.0, -3.0, 1.0]


def test_a_picture_of_a_frame_is_that_of_its_state_and_of_the_camera_asked_for(server, rally):
    camera = camera_of(server)
    status, headers, content = ask(f"{server.url}api/rallies/{rally}/pictures/5", camera)
    assert status == 200 and headers.get_content_type() == "image/png"
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (36, 64, 3)
    red = np.argwhere(picture[..., 2] > 200)[:, ::-1]
    view = server.desk.rally(rally).view.camera[0]
    places, _ = project(view, np.array([[0.5, -8.0, 0.9], [0.5, 8.0, 0.9]]))
    for place in places * 64 / 1280:
        assert np.abs(red - place).max(axis=1).min() <= 1.5


def changed(server, **values):
    return camera_of(server) | values


@pytest.mark.parametrize(
    ("address", "body", "status", "said"),
    [
        ("pictures/20", {}, 422, "frame: expected 0 to 19, got 20"),
        ("pictures/5", {"width": 4000, "height": 4000}, 422, "at most 3686400 pixels, got 4000 x 4000"),
        ("pictures/5", {"width": -1}, 422, "camera: width: expected"),
        ("pictures/5", {"K": [0.0] * 9}, 422, "expected positive focal lengths"),
        ("pictures/5", {"R_cam_from_world": [1e308] * 9}, 422, "R_cam_from_world: expected rotations"),
        ("pictures/5", {"width": 13, "height": 13}, 422, "width: expected another size, got 13"),
    ],
)
def test_pictures_that_cannot_be_are_refused_in_words(server, rally, address, body, status, said):
    got, _, answer = ask(f"{server.url}api/rallies/{rally}/{address}", changed(server, **body))
    assert got == status and said in answer["error"]


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        (b"{", 400, "body: expected JSON"),
        (b"\xff\xfe", 400, "body: expected JSON"),
        (b"[" * 200_000, 400, "body: expected JSON"),
        (b'{"seed": NaN}', 400, "NaN is no number"),
        ({"n_frames": 10**6}, 422, "n_frames: expected at most 1500 on this page, got 1000000"),
        (b" " * (LARGEST_BODY + 1), 413, "body: expected at most"),
    ],
)
def test_bodies_that_cannot_be_are_refused_in_words(server, body, status, said):
    try:
        got, _, answer = ask(server.url + "api/rallies", body)
    except (ConnectionError, OSError):
        assert status == 413  # the answer may come while the body is still on its way
        return
    assert got == status and said in answer["error"]


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ("Transfer-Encoding: chunked", 411),
        ("Content-Length: -5", 411),
        ("Content-Length: many", 411),
        ("Content-Length: 99999999999999999999", 413),
        ("Content-Length: 50", 400),
    ],
)
def test_bodies_of_unsaid_length_end_the_connection(server, headers, status):
    lines = f"POST /{server.token}/api/rallies HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n{headers}\r\n\r\n{{}}"
    answer = raw(server, lines)
    assert answer.startswith(f"HTTP/1.1 {status} ") and "Connection: close" in answer


def test_methods_that_are_none_of_ours_are_refused(server):
    assert ask(server.url, method="PUT")[0] == 501
    assert ask(server.url + "api/stage", {}, method="POST")[0] == 404
    assert ask(server.url + "api/stage", method="DELETE")[0] == 404


def test_a_prompt_that_cannot_be_followed_says_why(server):
    name = ask(server.url + "api/rallies", PROMPT | {"seed": 13})[2]["rally"]
    while (progress := ask(f"{server.url}api/rallies/{name}")[2])["state"] in ("waiting", "making"):
        time.sleep(0.01)
    assert progress["state"] == "failed" and "expected a lucky number" in progress["words"]
    status, _, answer = ask(f"{server.url}api/rallies/{name}/states")
    assert status == 422 and "got one that is failed" in answer["error"]
    assert ask(server.url + "api/rallies/77")[0] == 404


def test_one_rally_at_a_time_and_it_can_be_cancelled():
    maker = Maker(STAGE, held=True)
    with PlayServer(STAGE, maker, None) as server:
        name = ask(server.url + "api/rallies", PROMPT)[2]["rally"]
        status, _, answer = ask(server.url + "api/rallies", PROMPT)
        assert status == 409 and "cancel" in answer["error"]
        assert ask(f"{server.url}api/rallies/{name}", method="DELETE")[2]["state"] == "cancelled"
        maker.go.set()
        second = made(server, PROMPT)
        status, _, answer = ask(f"{server.url}api/rallies/{second}/pictures/0", camera_of(server))
        assert status == 422 and "no synthesis run" in answer["error"]
        assert not ask(server.url + "api/stage")[2]["renders"]


def test_pictures_are_rendered_one_at_a_time_and_few_may_wait():
    inside, most, go = [], [], threading.Event()

    def render(state, view):
        inside.append(1)
        most.append(len(inside))
        go.wait(30)
        inside.pop()
        return draw_state(state, view)

    with PlayServer(STAGE, Maker(STAGE), render) as server:
        name, camera = made(server, PROMPT), camera_of(server)
        answers = []
        threads = [
            threading.Thread(
                target=lambda: answers.append(ask(f"{server.url}api/rallies/{name}/pictures/1", camera)[0])
            )
            for _ in range(6)
        ]
        for thread in threads:
            thread.start()
        ends = time.monotonic() + 20
        while len(answers) < 2 and time.monotonic() < ends:
            time.sleep(0.01)
        go.set()
        for thread in threads:
            thread.join()
    assert sorted(answers) == [200] * 4 + [503] * 2 and max(most) == 1


def test_trouble_inside_a_renderer_is_told_and_the_server_goes_on():
    def render(state, view):
        raise RuntimeError("CUDA out of memory")

    with PlayServer(STAGE, Maker(STAGE), render) as server:
        name = made(server, PROMPT)
        status, _, answer = ask(f"{server.url}api/rallies/{name}/pictures/1", camera_of(server))
        assert (status, answer["error"]) == (500, "RuntimeError: CUDA out of memory")
        assert ask(server.url)[0] == 200
