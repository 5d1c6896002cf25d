"""A small stage for the page of `pgm play`, and what makes rallies and pictures for it without a trained model."""

import json
import threading
import urllib.error
import urllib.request
from dataclasses import replace

import cv2
import numpy as np

from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from pgm_models.synthesis.play_rallies import Rally
from pgm_models.synthesis.play_stage import Stage, usual_view
from tests.models.animation.toy_models import toy_layout

FRAMES, RATE = 20, 10.0
PROMPT = {"scene": "tennis", "n_frames": FRAMES, "frames_per_second": RATE, "seed": 7}


def toy_stage(scene="tennis"):
    layout = toy_layout() if scene == "tennis" else replace(toy_layout(1, False), scene=scene)
    return Stage(
        scene=load_scene(scene), layout=layout, rates=(4.0, 10.0), animation="anim", synthesis="syn", picture=(64, 36)
    )


def toy_columns(scene, frames):
    """Players who walk to the right in their rest pose, and a ball that is missing in the first frame."""
    time = np.arange(frames)[:, None] / RATE
    columns = {}
    for number, player in enumerate(scene.players):
        root = np.array([0.0, -8.0 + 16.0 * number, 0.9]) + time * [1.0, 0.0, 0.0]
        rest = np.cumsum(np.full((len(player.skeleton.parents), 3), 0.02), axis=0)
        columns[f"{player.name}.root_position"] = root
        columns[f"{player.name}.joints"] = (root[:, None] + rest - rest[0]).reshape(frames, -1)
    if scene.ball is not None:
        columns["ball.position"] = np.array([1.0, -5.0, 1.0]) + time * [0.0, 5.0, 0.0]
        columns["ball.position"][0] = np.nan
        columns["ball.velocity"] = np.tile([0.0, 5.0, 0.0], (frames, 1))
    return columns


class Maker:
    """Makes rallies step by step, each step when it is let; seed 13 is refused."""

    def __init__(self, stage, steps=4, held=False):
        self.stage, self.steps = stage, steps
        self.go = threading.Event()
        self.made = []
        if not held:
            self.go.set()

    def __call__(self, document, say):
        if document["seed"] == 13:
            raise ValueError("prompt: seed: expected a lucky number, got 13")
        if document["seed"] == 14:
            raise RuntimeError("out of memory")
        for step in range(self.steps):
            say(step / self.steps, f"step {step + 1} of {self.steps}")
            while not self.go.wait(0.01):
                say(step / self.steps, f"step {step + 1} of {self.steps}")
        frames, rate = document["n_frames"], document["frames_per_second"]
        self.made.append(document)
        return Rally(
            prompt=document,
            rate=rate,
            columns=toy_columns(self.stage.scene, frames),
            view=usual_view(self.stage.scene, np.arange(frames) / rate),
            notes=("ball: moved 1 cm",),
            warnings=("a doubt",),
        )


def draw_state(state, view):
    """A green picture with a red dot on each player's root."""
    width, height = view.size
    if (width, height) == (13, 13):
        raise ValueError("width: expected another size, got 13")
    picture = np.zeros((height, width, 3), dtype=np.uint8)
    picture[:] = (60, 140, 60)
    for name, values in state.items():
        if name.endswith(".root_position"):
            pixels, seen = project(view.camera, values[None])
            if seen[0]:
                cv2.circle(picture, tuple(np.rint(pixels[0]).astype(int).tolist()), 2, (0, 0, 255), -1)
    return cv2.imencode(".png", picture)[1].tobytes()


def ask(url, body=None, method=None, **headers):
    """Status, headers and content of an answer; JSON where it is such."""
    data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    request = urllib.request.Request(url, data=data, method=method, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return _read(answer.status, answer)
    except urllib.error.HTTPError as error:
        with error:
            return _read(error.code, error)


def _read(status, answer):
    content = answer.read()
    if answer.headers.get_content_type() == "application/json":
        content = json.loads(content)
    return status, answer.headers, content
