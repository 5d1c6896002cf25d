"""What the objects of a rendered video wear: read off pictures of a clip, or kept with the model."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pgm_models.synthesis.frames import FrameStore, frames_of_work, read_frames
from pgm_models.synthesis.match_styles import styles_of
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.render_source import RenderSource, find_clip, scene_name


@dataclass(frozen=True, kw_only=True)
class StyleWord:
    """Who wears what, as somebody said it: `[OBJECT=]FROM`."""

    thing: str
    """The object; empty for all."""
    origin: str
    """Match of the model, clip of the rendered clip's folder, or FOLDER[:CLIP] of another one with videos."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Styles:
    """What all objects wear."""

    codes: Float[Tensor, "1 objects style"]
    words: tuple[str, ...]
    """Where they are from, a line each."""


def style_words(words: Sequence[str], things: Sequence[str]) -> tuple[StyleWord, ...]:
    """Who wears what.

    Raises:
        ValueError: If a word names no origin, or the same objects are dressed twice.
    """
    found: list[StyleWord] = []
    for word in words:
        thing, equals, origin = word.partition("=")
        if not equals or thing not in things:
            # A folder's name may hold the sign as well; one that begins like an object it does not.
            if equals and "/" not in thing and not Path(word).exists():
                raise ValueError(f"expected an object among {', '.join(things)} before the =, got {thing!r}")
            thing, origin = "", word
        if not origin:
            raise ValueError(f"expected [OBJECT=]FROM, got {word!r}")
        if any(thing == other.thing for other in found):
            raise ValueError(f"expected one style of {thing or 'all objects'}, got two")
        found.append(StyleWord(thing=thing, origin=origin))
    return tuple(found)


def chosen_styles(
    model: SynthesisModel, source: RenderSource, words: Sequence[StyleWord], *, videos: Path | None = None
) -> Styles:
    """What all objects wear.

    Those of which nobody said anything look as in the clip's own pictures; where it has none, as in the first match
    that is kept with the model.

    Args:
        model: That renders.
        source: The clip that is rendered.
        words: Who wears what.
        videos: Folder of the videos of the clip's work folder, where they are no longer where they were.

    Raises:
        ValueError: If there is no such origin, or it has no pictures.
    """
    names = [thing.name for thing in model.scene.objects]
    said = next((word for word in words if not word.thing), None)
    single = [word for word in words if word.thing]
    codes, told = torch.zeros(1, len(names), model.options.fields.style, device=model.device), []
    if said is not None or len(single) < len(names):
        codes, line = _usual(model, source, videos) if said is None else _from(model, source, said.origin, videos)
        told.append(line)
    for word in single:
        number = names.index(word.thing)
        own, line = _from(model, source, word.origin, videos)
        codes[:, number] = own[:, number]
        told.append(f"{word.thing}: {line}")
    return Styles(codes=codes, words=tuple(told))


def _usual(
    model: SynthesisModel, source: RenderSource, videos: Path | None
) -> tuple[Float[Tensor, "1 objects style"], str]:
    if source.clip.video is not None:
        return _of_clip(model, source, videos), f"as in the pictures of {source.clip.clip_id}"
    for name, codes in model.match_styles.items():
        why = f"as {source.clip.clip_id} has no video"
        return codes[None].clone(), f"as in the match {name} that the model learned from, {why}"
    clip, reason = source.clip.clip_id, source.clip.no_video
    raise ValueError(f"expected a clip to take styles from, as {clip} has no video and the model keeps none: {reason}")


def _from(
    model: SynthesisModel, source: RenderSource, origin: str, videos: Path | None
) -> tuple[Float[Tensor, "1 objects style"], str]:
    """Styles of all objects by a word, and where they are from."""
    if origin in model.match_styles:
        return model.match_styles[origin][None].clone(), f"as in the match {origin} that the model learned from"
    folder, colon, clip = origin.rpartition(":")
    if Path(origin).is_dir():
        folder, clip = origin, ""
    elif not colon or not Path(folder).is_dir():
        folder, clip = "", origin
    if folder:
        other = find_clip(Path(folder), clip=clip)
        return _of_clip(model, other, None), f"as in the pictures of {other.clip.clip_id}"
    try:
        other = find_clip(source.path, clip=clip, videos=videos)
    except ValueError as error:
        matches = ", ".join(model.match_styles) or "none"
        raise ValueError(
            f"expected a match of the model ({matches}), a clip of {source.path}, or FOLDER or FOLDER:CLIP of one with "
            f"videos, got {origin!r}"
        ) from error
    return _of_clip(model, other, videos), f"as in the pictures of {other.clip.clip_id}"


def _of_clip(model: SynthesisModel, source: RenderSource, videos: Path | None) -> Float[Tensor, "1 objects style"]:
    """Styles that the pictures of a clip show."""
    if scene_name(source) != model.scene.name:
        raise ValueError(f"expected a clip of {model.scene.name}, as the model is, got one of {scene_name(source)}")
    if source.clip.video is None:
        raise ValueError(f"expected a clip with pictures, got {source.clip.clip_id}: {source.clip.no_video}")
    store = _pictures(model, source, videos)
    return styles_of(model, store, np.asarray(store.clip_rows(source.clip.clip_id)))


def _pictures(model: SynthesisModel, source: RenderSource, videos: Path | None) -> FrameStore:
    if source.packed:
        return read_frames(source.path, picture=model.options.picture, scene=model.scene)
    return frames_of_work(source.folder, picture=model.options.picture, scene=model.scene, videos=videos)
