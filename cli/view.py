"""`pgm view WORK`: a clip in three dimensions, in the browser."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from .console import UsageError, option_error, print_error

if TYPE_CHECKING:
    import numpy as np
    import viser  # pyright: ignore[reportMissingImports] of the extra viz

    from pgm_data.stages.viewer import ClipViewer
    from pgm_data.stages.viewer_scene import ClipScene

NOTHING_USABLE = 4


@dataclass(frozen=True, kw_only=True)
class ViewCommand:
    """Look at a clip in 3D: court, ball with its uncertainty, events, players, camera; in the browser.

    The extra viz brings the viewer. The page is served until Ctrl-C, to this machine alone unless --host says more.
    """

    work: tyro.conf.Positional[Path]
    """Work folder, a clip's folder, or the folder that pgm-ball3d wrote from a track."""
    clip: str = ""
    """Clip to begin with; the first one if not given."""
    scene: str = ""
    """Name or file of a scene, for one that does not ship with pgm."""
    pictures: bool = False
    """Show the video's pictures in the camera; they are read first, which takes a moment."""
    videos: Path | None = None
    """Folder of the source videos, where they are no longer where they were."""
    host: str = "127.0.0.1"
    """Address to serve on; 0.0.0.0 lets other machines see the page."""
    port: int = 8080
    """Port to serve on; another where it is taken."""
    open: bool = True
    """Open the page in the browser."""
    seconds: float = 0.0
    """End by itself after so long; 0 to serve until Ctrl-C."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    command = tyro.cli(ViewCommand, args=argv, prog="pgm view")
    if not 1 <= command.port <= 65535:
        raise option_error("--port", expected="1 to 65535", got=command.port)
    if not 0 <= command.seconds < float("inf"):
        raise option_error("--seconds", expected="0 or more", got=command.seconds)
    if command.videos is not None and not command.videos.is_dir():
        raise option_error("--videos", expected="a folder", got=command.videos)
    from pgm_data.stages.viewer_scene import viewable_clips

    try:
        folders = {folder.name: folder for folder in viewable_clips(command.work)}
    except ValueError as error:
        raise UsageError(str(error)) from error
    if command.clip and command.clip not in folders:
        few = ", ".join(list(folders)[:8]) + (" ..." if len(folders) > 8 else "")
        raise option_error("--clip", expected=f"one of {few}", got=command.clip)
    if find_spec("viser") is None:
        raise UsageError("pgm view: expected the package viser, found none: pip install 'pgm[viz]'")
    return _serve(command, folders, command.clip or next(iter(folders)))


def _serve(command: ViewCommand, folders: dict[str, Path], first: str) -> int:
    from pgm_data.stages.viewer import run_viewer
    from pgm_data.stages.viewer_scene import clip_scene

    try:
        # Before a page is opened that would stay empty.
        opened = clip_scene(folders[first], command.scene)
    except ValueError as error:
        print_error(str(error))
        return NOTHING_USABLE
    import viser  # pyright: ignore[reportMissingImports] of the extra viz

    server = viser.ViserServer(host=command.host, port=command.port, label="pgm view", verbose=False)
    try:
        url = f"http://{command.host}:{server.get_port()}"
        print(f"{url}   {first}, {len(opened.capture_time)} frames; Ctrl-C ends it", flush=True)
        server.initial_camera.position, server.initial_camera.look_at = _begin(opened)
        if command.open:
            import webbrowser

            webbrowser.open(url)
        ends = time.monotonic() + command.seconds if command.seconds else float("inf")
        clips = {name: _viewer_of(server, command, folder) for name, folder in folders.items()}
        run_viewer(server, clips, first=first, until=lambda: time.monotonic() >= ends)
    except KeyboardInterrupt:
        pass  # the way to end it
    finally:
        server.stop()
    return 0


def _begin(clip: "ClipScene") -> "tuple[np.ndarray, np.ndarray]":
    """Where the reader stands at first: to the left behind the near end, above it, looking at the middle."""
    import numpy as np

    half = clip.scene.court.surface_half_size if clip.scene.court is not None else (10.0, 20.0)
    return half[1] * np.array([-0.8, -1.2, 0.7]), np.zeros(3)


def _viewer_of(server: "viser.ViserServer", command: ViewCommand, folder: Path) -> "Callable[[], ClipViewer]":
    def make() -> "ClipViewer":
        from pgm_data.stages.viewer import ClipViewer
        from pgm_data.stages.viewer_scene import clip_scene

        clip = clip_scene(folder, command.scene)
        return ClipViewer(server, clip, _pictures(command, folder, clip) if command.pictures else ())

    return make


def _pictures(command: ViewCommand, folder: Path, clip: "ClipScene") -> "tuple[np.ndarray, ...]":
    """The video's pictures; none, and a word why, where they cannot be had."""
    from pgm_data.convert.frame_pictures import source_video
    from pgm_data.convert.posed_pictures import FieldError
    from pgm_data.dataset.documents import read_document
    from pgm_data.stages.viewer import frame_pictures
    from pgm_data.video import VideoError

    if clip.camera is None:
        return ()
    try:
        document = read_document(folder / "clip.json", "clip")
        return frame_pictures(source_video(folder.parent, document, command.videos), clip)
    except (ValueError, FieldError, VideoError) as error:
        print_error(f"{clip.clip_id}: no pictures: {error}")
        return ()
