"""Prompts hold to their schema and to what a model knows, or say where they do not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pgm_models.animation
from pgm_models.animation.encode import encode_known, standardise
from pgm_models.animation.layout import Layout
from pgm_models.animation.prompt import Prompt, given_by, prompt_of, prompt_to_json, read_prompt
from tests.models.animation.toy_models import toy_layout

EXAMPLES = sorted((Path(pgm_models.animation.__file__).parent / "prompts").glob("*.json"))


def document(**changes) -> dict:
    return {"scene": "tennis", "n_frames": 10, "frames_per_second": 25} | changes


def text(player=0, start=0, end=10, said="the player runs") -> dict:
    return {"player": player, "start_frame": start, "end_frame": end, "text": said}


def value(column="ball.position", start=0, end=10, numbers=None) -> dict:
    numbers = [1, 2, 3] if numbers is None else numbers
    return {"column": column, "start_frame": start, "end_frame": end, "value": numbers}


def scaled(layout: Layout) -> Layout:
    """The layout with means and scales of its own."""
    rng = np.random.default_rng(0)
    parts = [
        replace(part, mean=rng.normal(0, 5, len(part.channels)), std=rng.uniform(0.1, 9, len(part.channels)))
        for part in (*layout.properties, *layout.constants)
    ]
    count = len(layout.properties)
    return replace(layout, properties=tuple(parts[:count]), constants=tuple(parts[count:]))


def same(first: Prompt, second: Prompt) -> bool:
    return json.dumps(prompt_to_json(first)) == json.dumps(prompt_to_json(second))


def test_what_is_read_is_what_was_written(tmp_path):
    rows = np.arange(12.0).reshape(4, 3).tolist()
    raw = document(
        seed=7,
        texts=[text(1, 2, 5, "the player serves"), text(1, 5, 10), text(0, 3, 4)],
        values=[
            value(end=4, numbers=rows),
            value(start=6, end=8, numbers=[0.5, 0, -1]),
            value("player0.root_position"),
        ],
    )
    (tmp_path / "prompt.json").write_text(json.dumps(raw))
    prompt = read_prompt(tmp_path / "prompt.json", toy_layout())
    assert (prompt.frames, prompt.rate, prompt.seed) == (10, 25.0, 7)
    assert prompt.values[0].values.tolist() == rows
    assert prompt.values[1].values.tolist() == [[0.5, 0, -1]] * 2
    assert prompt_to_json(prompt) == raw | {"frames_per_second": 25.0}
    assert same(prompt, prompt_of(prompt_to_json(prompt), toy_layout()))


def test_numbers_given_are_the_encoders_own_to_the_bit():
    layout = scaled(toy_layout())
    rows = np.random.default_rng(1).normal(0, 3, (4, 3))
    given = given_by(prompt_of(document(values=[value(start=3, end=7, numbers=rows.tolist())]), layout), layout)
    row = layout.row_of("ball.position")
    expected = np.zeros((10, layout.channels), np.float32)
    expected[3:7, layout.slice_of(row)] = encode_known(layout, "ball.position", rows)
    told = np.zeros((10, len(layout.properties)), bool)
    told[3:7, row] = True
    assert (given.known == told).all()
    own = told[:, layout.property_of_channel]
    assert (given.state[own] == standardise(layout, expected)[own]).all()
    assert (given.state[~own] == 0).all()


def test_texts_stand_at_their_frames_each_different_one_once():
    layout = toy_layout()
    texts = [text(0, 0, 4, "a"), text(1, 2, 3, "b"), text(0, 6, 10, "b")]
    given = given_by(prompt_of(document(texts=texts), layout), layout)
    assert given.texts == ("a", "b")
    assert given.text[:, 0].tolist() == [0] * 4 + [-1] * 2 + [1] * 4
    assert given.text[:, 1].tolist() == [-1, -1, 1] + [-1] * 7


def test_bones_are_the_prompts_or_the_average():
    layout = scaled(toy_layout())
    numbers = [0.0, 0.0, 0.0, 4.0, 5.0, 6.0, 7.0]
    raw = document(values=[value("player1.joint_translations", numbers=numbers)])
    given = given_by(prompt_of(raw, layout), layout)
    part = layout.constants[1]
    assert given.constants[:4].tolist() == [0.0] * 4
    np.testing.assert_allclose(given.constants[4:], (np.array(numbers[3:]) - part.mean) / part.std, rtol=1e-6)
    assert not given.known.any()
    assert (given_by(prompt_of(document(), layout), layout).constants == 0).all()


@pytest.mark.parametrize("rate", [1, 50, 0.5])
def test_any_rate_and_one_frame_will_do(rate):
    prompt = prompt_of(document(n_frames=1, frames_per_second=rate), toy_layout())
    assert (prompt.frames, prompt.rate, prompt.texts, prompt.values) == (1, float(rate), (), ())


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (document(scene="blocks"), "p: scene: expected tennis"),
        (document(frames_per_second=0), "frames_per_second: expected above 0"),
        (document(n_frames=0), "n_frames: expected at least 1"),
        (document(n_frames=10_000_000), "n_frames: expected at most 1000000"),
        (document(length=3), "length: expected one of the fields"),
        ([], "prompt: expected object"),
        (document(texts=[text(end=11)]), r"texts\[0\]: expected start_frame < end_frame <= 10, got 0 to 11"),
        (document(texts=[text(2)]), r"texts\[0\].player: expected one of 0 \(player0\), 1 \(player1\), got 2"),
        (document(texts=[text(said=" ")]), r"texts\[0\].text: expected words"),
        (document(texts=[text(end=6), text(start=5)]), r"texts\[1\]: expected frames without a text .* got frame 5"),
        (document(values=[value(start=4, end=4)]), r"values\[0\]: expected start_frame < end_frame"),
        (document(values=[value("ball.spin")]), r"values\[0\].column: expected one of .*ball.velocity.*'ball.spin'"),
        (document(values=[value("player0.joints")]), "follows from root and rotations and cannot be fixed"),
        (document(values=[value(numbers=[1, 2])]), r"values\[0\].value: expected 3 numbers, or 10 times 3 numbers"),
        (document(values=[value(numbers=3)]), "expected 3 numbers"),
        (document(values=[value(numbers=[])]), "expected 3 numbers"),
        (document(values=[value(numbers=[[1, 2, 3]] * 9)]), "got 9 rows"),
        (document(values=[value(numbers=[[1, 2, 3]] * 9 + [[1, 2]])]), "got 2 numbers in row 9"),
        (document(values=[value(numbers=[1, "2", 3])]), "got '2' in row 0"),
        (document(values=[value(numbers=[1, True, 3])]), "got True in row 0"),
        (document(values=[value(numbers=[1, None, 3])]), "got None in row 0"),
        (document(values=[value(numbers=[1, float("nan"), 3])]), "got nan in row 0"),
        (
            document(values=[value(), value(start=9)]),
            r"values\[1\]: expected frames without .* got frame 9, which values",
        ),
        (
            document(values=[value("player0.joint_translations", end=5, numbers=[0] * 7)]),
            "expected one value for all frames, 0 to 10",
        ),
        (
            document(values=[value("player0.joint_translations", numbers=[[i] * 7 for i in range(10)])]),
            "got values that differ",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(raw, said):
    with pytest.raises(ValueError, match=said):
        prompt_of(raw, toy_layout(), place="p")


def test_a_file_that_is_no_json_is_named(tmp_path):
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(ValueError, match="bad.json: expected a JSON document"):
        read_prompt(tmp_path / "bad.json", toy_layout())


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_that_ship_can_be_read(path):
    scene = json.loads(path.read_text())["scene"]
    layout = toy_layout() if scene == "tennis" else replace(toy_layout(players=1, ball=False), scene=scene)
    assert read_prompt(path, layout).frames > 16


def test_examples_ship():
    assert len(EXAMPLES) >= 5
