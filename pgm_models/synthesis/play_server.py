"""The server behind the page of `pgm play`: prompts in, rallies and pictures out, for one person on this machine.

It listens on 127.0.0.1 alone, and answers only addresses that begin with a secret token, which the page's own address
holds, and requests that were meant for this host and came from this page. The page's files are read once, at the start:
no address leads to a file.

    GET    /TOKEN/                              the page; /TOKEN/NAME its other files
    GET    /TOKEN/api/stage                     what is played, where, and by whom
    POST   /TOKEN/api/rallies                   a prompt; begins a rally: {"rally": "1"}
    GET    /TOKEN/api/rallies/1                 {"state", "share", "words"}
    DELETE /TOKEN/api/rallies/1                 cancels it
    GET    /TOKEN/api/rallies/1/states          the rally
    GET    /TOKEN/api/rallies/1/values/17       frame 17 as values of a prompt that goes on from there
    POST   /TOKEN/api/rallies/1/pictures/17     a camera as in CAMERA.json; the picture of frame 17, a PNG

What cannot be done is answered by a status from 400 on and {"error": "words for the reader"}.
"""

import hmac
import json
import secrets
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, NoReturn, cast

import numpy as np
from jaxtyping import Float

from pgm_data.dataset.documents import document_faults
from pgm_data.geometry.camera import Camera
from pgm_models.animation.play_camera import PlayCamera
from pgm_models.synthesis.play_rallies import BusyError, MakeRally, RallyDesk, UnknownRallyError
from pgm_models.synthesis.play_stage import MOST_PIXELS, Stage, rally_to_json, stage_to_json, values_at

HOST = "127.0.0.1"
LARGEST_BODY = 2**20
"""Bytes of a request's body."""
MOST_WAITING = 4
"""Requests for pictures that may wait for the renderer at once."""
PATIENCE_S = 60.0
"""How long a connection may be silent."""
TYPES = {"html": "text/html; charset=utf-8", "js": "text/javascript; charset=utf-8", "css": "text/css; charset=utf-8"}
"""Of the page's files, by suffix."""
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Of every answer: the page loads nothing from elsewhere, and nobody else loads it."""

RenderFrame = Callable[[Mapping[str, Float[np.ndarray, " numbers"]], PlayCamera], bytes]
"""The picture, a PNG of the camera's size, of one frame's columns; the camera is one, without a leading axis.

Raises ValueError in words for the reader where it cannot be. Never called by two threads at once.
"""


@dataclass(frozen=True, eq=False, kw_only=True)
class Renderer:
    """A synthesis model as the page uses it."""

    render: RenderFrame
    scene: str
    """Name of the scene that it was trained on."""
    picture: tuple[int, int]
    """Width and height of the pictures that it was trained with, px."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a request is answered with."""

    body: bytes
    kind: str
    """Media type."""
    status: int = 200


class RefusedError(Exception):
    """A request that cannot be carried out: status, and words for the reader."""

    def __init__(self, status: int, words: str) -> None:
        super().__init__(words)
        self.status = status
        self.words = words


class PlayServer:
    """Serves the page from its making until it is closed."""

    def __init__(self, stage: Stage, make: MakeRally, render: RenderFrame | None, *, port: int = 0) -> None:
        """Begin to serve on the port, on a free one for 0.

        Raises:
            OSError: If the port is taken.
        """
        self.token = secrets.token_urlsafe(24)
        self.desk = RallyDesk(make)
        self._stage = stage
        self._render = render
        self._renderer = threading.Lock()
        self._waiting = threading.BoundedSemaphore(MOST_WAITING)
        self._page = page_files()
        self._http = _Http((HOST, port), _Handler)
        self._http.play = self
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.1,), name="play server", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """That it listens on."""
        return self._http.server_address[1]

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    def close(self) -> None:
        """End whatever is being made, and answer no more."""
        self.desk.close()
        self._http.shutdown()
        self._http.server_close()
        self._http.hang_up()
        self._thread.join()

    def __enter__(self) -> "PlayServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def answer(self, method: str, path: str, body: bytes) -> Answer:
        """The answer to a request whose address begins with the token; `path` is what follows it.

        Raises:
            RefusedError: If it cannot be carried out.
        """
        match (method, path.split("/")):
            case ("GET", [name]) if name in self._page:
                return self._page[name]
            case ("GET", ["api", "stage"]):
                return _json(stage_to_json(self._stage, renders=self._render is not None))
            case ("POST", ["api", "rallies"]):
                return self._order(_parsed(body))
            case ("GET", ["api", "rallies", name]):
                return _json(asdict(self.desk.progress(name)))
            case ("DELETE", ["api", "rallies", name]):
                return _json(asdict(self.desk.cancel(name)))
            case ("GET", ["api", "rallies", name, "states"]):
                return _json(rally_to_json(self.desk.rally(name), self._stage.scene))
            case ("GET", ["api", "rallies", name, "values", frame]) if _is_count(frame):
                return _json(values_at(self.desk.rally(name), self._stage.layout, int(frame)))
            case ("POST", ["api", "rallies", name, "pictures", frame]) if _is_count(frame):
                return self._picture(name, int(frame), _parsed(body))
        raise RefusedError(404, "there is nothing at this address")

    def _order(self, document: object) -> Answer:
        frames = document.get("n_frames") if isinstance(document, dict) else None
        if isinstance(frames, int) and frames > self._stage.most_frames:
            raise RefusedError(422, f"n_frames: expected at most {self._stage.most_frames} on this page, got {frames}")
        return _json({"rally": self.desk.order(document)}, status=202)

    def _picture(self, name: str, frame: int, document: object) -> Answer:
        rally = self.desk.rally(name)
        state, view = rally.state(frame), camera_of_document(document)
        if self._render is None:
            raise RefusedError(422, "no synthesis run was given to pgm play, so that nothing is rendered")
        if not self._waiting.acquire(blocking=False):
            raise RefusedError(503, "too many pictures are asked for at once")
        try:
            with self._renderer:
                return Answer(body=self._render(state, view), kind="image/png")
        finally:
            self._waiting.release()


def page_files() -> dict[str, Answer]:
    """The files of the page by name; its first one also by the empty name."""
    found = {}
    for file in files("pgm_models.synthesis").joinpath("play_page").iterdir():
        kind = TYPES.get(file.name.rpartition(".")[2])
        if kind is not None and file.is_file():
            found[file.name] = Answer(body=file.read_bytes(), kind=kind)
    return {"": found["index.html"], **found}


def camera_of_document(document: object) -> PlayCamera:
    """The camera that a document as of CAMERA.json says, for one frame.

    Raises:
        RefusedError: If it is none, or its picture would be too large.
    """
    faults = document_faults("camera", document)
    if faults or not isinstance(document, dict):
        first = faults[0]
        raise RefusedError(422, f"camera: {first.field or 'document'}: expected {first.expected}, got {first.found}")
    width, height = document["width"], document["height"]
    if width * height > MOST_PIXELS:
        raise RefusedError(422, f"camera: expected a picture of at most {MOST_PIXELS} pixels, got {width} x {height}")
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are no rotation, and are refused as such
            camera = Camera(
                K=np.array(document["K"], dtype=np.float64).reshape(3, 3),
                distortion=np.array(document["distortion"], dtype=np.float64),
                R_cam_from_world=np.array(document["R_cam_from_world"], dtype=np.float64).reshape(3, 3),
                t_cam_from_world=np.array(document["t_cam_from_world"], dtype=np.float64),
            )
    except (ValueError, OverflowError) as error:
        raise RefusedError(422, f"camera: {error}") from error
    return PlayCamera(camera=camera, size=(width, height), reason="as the page asked")


def _is_count(word: str) -> bool:
    """Whether a part of an address is a whole number, 0 or more."""
    return word.isascii() and word.isdigit() and len(word) <= 9


def _json(value: object, status: int = 200) -> Answer:
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Answer(body=text.encode(), kind="application/json", status=status)


def _parsed(body: bytes) -> Any:
    """The JSON value of a body.

    Raises:
        RefusedError: If it is none.
    """

    def refuse(word: str) -> NoReturn:
        raise ValueError(f"{word} is no number")

    try:
        return json.loads(body.decode("utf-8"), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise RefusedError(400, f"body: expected JSON, got: {error}") from error


class _Http(ThreadingHTTPServer):
    """A thread for each connection; they end with the process."""

    daemon_threads = True
    block_on_close = False
    play: PlayServer

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        super().__init__(address, handler)

    def process_request(self, request: socket.socket | tuple[bytes, socket.socket], client_address: Any) -> None:
        """Note the connection, which a browser keeps open from one request to the next."""
        if isinstance(request, socket.socket):
            with self._lock:
                self._open.add(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: socket.socket | tuple[bytes, socket.socket]) -> None:
        """Note that the connection has ended."""
        if isinstance(request, socket.socket):
            with self._lock:
                self._open.discard(request)
        super().shutdown_request(request)

    def hang_up(self) -> None:
        """End all connections."""
        with self._lock:
            for connection in self._open:
                with suppress(OSError):  # it may have ended by itself
                    connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: socket.socket | tuple[bytes, socket.socket], client_address: object) -> None:
        """A browser that went away in the middle is no news."""


class _Handler(BaseHTTPRequestHandler):
    """Reads requests, refuses those that are none of ours, and writes answers."""

    protocol_version = "HTTP/1.1"
    timeout = PATIENCE_S
    server_version = "pgm"
    sys_version = ""

    def do_GET(self) -> None:
        """Answer."""
        self._answer()

    def do_POST(self) -> None:
        """Answer."""
        self._answer()

    def do_DELETE(self) -> None:
        """Answer."""
        self._answer()

    @property
    def play(self) -> PlayServer:
        """Whose requests these are."""
        return cast(_Http, self.server).play

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not news."""

    def _answer(self) -> None:
        try:
            body = self._body()
            path = self._path()
            answer = self.play.answer(self.command, path, body)
        except RefusedError as error:
            answer = _json({"error": error.words}, status=error.status)
        except UnknownRallyError as error:
            answer = _json({"error": str(error)}, status=404)
        except BusyError as error:
            answer = _json({"error": str(error)}, status=409)
        except ValueError as error:
            answer = _json({"error": str(error)}, status=422)
        except ConnectionError:
            raise
        except Exception as error:  # the reader is told, and the server goes on
            answer = _json({"error": f"{type(error).__name__}: {error}"}, status=500)
        self.send_response(answer.status)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(answer.body)))
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(answer.body)

    def _body(self) -> bytes:
        """The request's body, which is read before anything is refused: the next request follows it."""
        length = self.headers.get("Content-Length", "0")
        if "Transfer-Encoding" in self.headers or not (length.isascii() and length.isdigit()):
            self.close_connection = True
            raise RefusedError(411, "Content-Length: expected the number of the body's bytes")
        if len(length) > 12 or int(length) > LARGEST_BODY:
            self.close_connection = True
            raise RefusedError(413, f"body: expected at most {LARGEST_BODY} bytes, got {length[:20]}")
        body = self.rfile.read(int(length))
        if len(body) < int(length):
            self.close_connection = True
            raise RefusedError(400, f"body: expected {length} bytes, got {len(body)}")
        return body

    def _path(self) -> str:
        """What follows the token in the address.

        Raises:
            RefusedError: If the token is missing, or the request was not meant for this server.
        """
        play = self.play
        hosts = {f"{HOST}:{play.port}", f"localhost:{play.port}"}
        if self.headers.get("Host", "") not in hosts:
            raise RefusedError(403, "Host: expected this server")
        origin = self.headers.get("Origin")
        if origin is not None and origin not in {f"http://{host}" for host in hosts}:
            raise RefusedError(403, "Origin: expected the page of this server")
        token, slash, path = self.path.partition("?")[0].removeprefix("/").partition("/")
        if not (slash and hmac.compare_digest(token.encode("utf-8", "replace"), play.token.encode())):
            raise RefusedError(403, "address: expected the whole one that pgm play printed")
        return path
