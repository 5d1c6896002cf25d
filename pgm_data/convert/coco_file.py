"""The parts of a COCO JSON file: images, categories and numbers, each of them what it must be."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pgm_data.convert.foreign_people import LONGEST_PX, PeopleOptions
from pgm_data.convert.posed_pictures import FieldError

LARGEST_FILE = 512 * 2**20
"""Bytes above which a file is not read."""
PEOPLE = ("person", "people", "human", "player", "pedestrian")
"""Categories without keypoints that are people."""


@dataclass(frozen=True, kw_only=True)
class CocoCategory:
    """A category of people."""

    name: str
    points: tuple[str, ...]
    """As the file names them, made plain; empty where it does not."""


def read_foreign_json(path: Path) -> Any:
    """The JSON value of a file.

    Raises:
        ValueError: If it is too large, no JSON, or holds NaN or infinity.
    """
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise ValueError("a folder" if path.is_dir() else "no regular file" if path.exists() else "nothing there")
        if path.stat().st_size > LARGEST_FILE:
            raise ValueError(f"{path.stat().st_size} bytes, more than {LARGEST_FILE}")
        return json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected a JSON file, got: {error or type(error).__name__}") from error


def _refuse_constant(word: str) -> None:
    raise ValueError(f"{word}, which is no number of JSON")


def key_of(path: Path, content: Any, key: str) -> Any:
    """The value of a key of the file's object.

    Raises:
        ValueError: If there is none.
    """
    if not isinstance(content, dict) or key not in content:
        got = ", ".join(list(content)[:10]) or "nothing" if isinstance(content, dict) else type(content).__name__
        raise ValueError(f"{path}: {key}: expected a COCO file with the list, got {got}")
    return content[key]


def objects_of(path: Path, key: str, raw: Any) -> list[dict[str, Any]]:
    """The objects of a list.

    Raises:
        ValueError: If it is no list of objects.
    """
    if not isinstance(raw, list) or not all(isinstance(value, dict) for value in raw):
        raise ValueError(f"{path}: {key}: expected a list of objects, got {repr(raw)[:60]}")
    return raw


def id_of(value: dict[str, Any], name: str, seen: set) -> Any:
    """The id of an object, which no other has; None where it has none.

    Raises:
        FieldError: If it is no id, or another has it.
    """
    found = value.get(name)
    if found is not None and (isinstance(found, bool) or not isinstance(found, int | str)):
        raise FieldError(name, "a number or a text", repr(found)[:60])
    if found is not None and found in seen:
        raise FieldError(name, "each id once", f"{found!r} again"[:60])
    return found


def images_of(path: Path, content: dict[str, Any]) -> list[dict[str, Any]]:
    """The images, each with an id of its own.

    Raises:
        ValueError: If there is none, or an id is missing or repeats.
    """
    images = objects_of(path, "images", key_of(path, content, "images"))
    seen: set[Any] = set()
    for row, image in enumerate(images):
        try:
            found = id_of(image, "id", seen)
            if found is None:
                raise FieldError("id", "a number or a text", "nothing")
            seen.add(found)
        except FieldError as error:
            raise ValueError(str(error.at(f"{path}: images[{row}]"))) from error
    if not images:
        raise ValueError(f"{path}: images: expected at least one, got none")
    return images


def images_of_results(path: Path, results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The images that a list of results is about, whose ids are numbers of frames or names of files.

    Raises:
        ValueError: If there is no result.
    """
    ids = list(dict.fromkeys(str(result.get("image_id")) for result in results))
    if not ids:
        raise ValueError(f"{path}: expected at least one result, got none")
    own = {str(result.get("image_id")): result.get("image_id") for result in results}
    return [{"id": own[text], "file_name": text if "." in text else f"{text}.jpg"} for text in ids]


def categories_of(path: Path, content: dict[str, Any]) -> dict[Any, CocoCategory | None]:
    """Categories by id; None of those that are no people.

    Raises:
        ValueError: If none is, or names of keypoints repeat.
    """
    found: dict[Any, CocoCategory | None] = {}
    for row, raw in enumerate(objects_of(path, "categories", key_of(path, content, "categories"))):
        try:
            found_id = id_of(raw, "id", set(found))
            points = raw.get("keypoints", [])
            if not isinstance(points, list) or not all(isinstance(name, str) for name in points):
                raise FieldError("keypoints", "a list of names", repr(points)[:60])
            plain = tuple(plain_name(name) for name in points)
            if len(set(plain)) != len(plain):
                raise FieldError("keypoints", "each name once", repr(points)[:60])
        except FieldError as error:
            raise ValueError(str(error.at(f"{path}: categories[{row}]"))) from error
        name = str(raw.get("name", ""))
        is_person = plain or name.lower().startswith(PEOPLE) or name == ""
        found[found_id] = CocoCategory(name=name, points=plain) if is_person else None
    if not any(found.values()):
        raise ValueError(f"{path}: categories: expected one of people, got {len(found)} others")
    return found


def plain_name(name: str) -> str:
    """A point's name in small letters, with underscores."""
    return name.strip().lower().replace(" ", "_").replace("-", "_")


def category_of(
    annotation: dict[str, Any], categories: dict[Any, CocoCategory | None], is_results: bool
) -> CocoCategory | None:
    """The category of an annotation; None where it is no person.

    Raises:
        FieldError: If the file has no such category.
    """
    found = annotation.get("category_id")
    if is_results:
        return CocoCategory(name="", points=())
    if not isinstance(found, int | str) or found not in categories:
        raise FieldError("category_id", "the id of a category of the file", repr(found)[:60])
    return categories[found]


def video_scale(path: Path, row: int, image: dict[str, Any], options: PeopleOptions) -> Float[np.ndarray, " 2"]:
    """Factors from the image's pixels to those of the video's picture, x and y.

    Raises:
        ValueError: If it has another shape.
    """
    width, height = image.get("width"), image.get("height")
    if options.width is None or options.height is None or (width is None and height is None):
        return np.ones(2)
    whole = all(isinstance(side, int) and not isinstance(side, bool) and side > 0 for side in (width, height))
    if not whole or width is None or height is None:
        raise ValueError(f"{path}: images[{row}]: width, height: expected whole numbers above 0, got {width}, {height}")
    scale = np.array([options.width / width, options.height / height])
    # Rounding a side to a whole pixel is no other shape.
    if abs(options.width * height - options.height * width) > max(options.width, options.height, width, height):
        size = f"the shape of {options.width} x {options.height}, as the video's pictures have"
        raise ValueError(f"{path}: images[{row}]: width, height: expected {size}, got {width} x {height}")
    return scale


def numbers_of(name: str, raw: Any, count: int) -> list[float]:
    """So many numbers of a list.

    Raises:
        FieldError: If it is no such list, or a number is absurd.
    """
    if not isinstance(raw, list) or len(raw) != count:
        raise FieldError(name, f"{count} numbers", repr(raw)[:60])
    for value in raw:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LONGEST_PX:
            raise FieldError(name, f"numbers of at most {LONGEST_PX:g} px", repr(value)[:60])
    return [float(value) for value in raw]


def share_of(name: str, value: Any) -> float:
    """A number from 0 to 1.

    Raises:
        FieldError: If it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise FieldError(name, "a number from 0 to 1", repr(value)[:60])
    return float(value)
