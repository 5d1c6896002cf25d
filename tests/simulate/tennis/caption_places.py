"""What a caption says of places: where the player is, where the ball goes."""
# ruff: noqa: E501 (tables of conditions stay whole)

import re

import numpy as np

from pgm_data.simulate.tennis.play import Shot, Stroke
from tests.simulate.tennis.caption_said import Said, World
from tests.simulate.tennis.caption_words import NET_WAYS, PLACES, RECOVER, RESULTS


def landing(stroke: Stroke, shot: Shot) -> np.ndarray:
    """Where the ball lands, as the player that hits it sees it: x to the right, y ahead."""
    return shot.landing * (1.0 if stroke.player == 0 else -1.0)


def read_places(
    said: Said, world: World, verbs: list, stroke: Stroke | None, shot: Shot | None, window: tuple[float, float]
) -> set[str]:
    """Read named places and what comes of the ball; what the text tells of it, `target` where it tells the place."""
    told: set[str] = set()
    for name, pattern in RESULTS.items():
        if said.all(pattern):
            told.add(name)
    if said.all(RECOVER):
        said.claims.append(("recover", 0))
    for way, pattern in NET_WAYS.items():
        said.claims += [("way", (m.start(), way)) for m in said.all(pattern)]
    for pattern in PLACES:
        for m in said.all(pattern):
            groups = m.groupdict()
            how, side, area = (
                groups.get("how") or "",
                groups.get("side") or groups.get("side_") or "",
                groups["area"] or groups["area_"],
            )
            kind = next((k for at, k in reversed(verbs) if at < m.start()), "stay")
            if kind == "hit" and stroke is not None and shot is not None:
                told |= _ball_place(said, m.group(), how, side, area, stroke, shot)
            else:
                _own_place(said, world, m.group(), how, side, area, kind, window)
    if stroke is not None and shot is not None:
        told |= _ball_ways(said, stroke, shot, verbs)
    return told


def _ball_place(said: Said, words: str, how: str, side: str, area: str, stroke: Stroke, shot: Shot) -> set[str]:
    """Hold a place that the ball goes to against where it lands."""
    x, y = landing(stroke, shot)
    if np.isnan(x):
        aim = shot.aim[0] * (1.0 if stroke.player == 0 else -1.0)
        aimed = {"left": aim < -1, "right": aim > 1, "": False}.get(side, abs(aim) < 1.3)
        said.must(aimed and area in ("court", "of the court") and shot.result == "in", words)
        return {"aim"}
    out = (
        how in ("past", "behind", "beyond", "out behind", "out past", "long on")
        or "alley" in area
        or area == "tramlines"
    )
    if area == "sideline" and (how in ("past", "beyond", "out past")):
        out = True
    serve = stroke.kind == "serve"
    box = area in ("service box", "service boxes", "box")
    holds = {
        "no man's land": 6.3 < y < 11.95, "service boxes": 0 < y < 6.5, "service box": 0 < y < 6.5, "box": 0 < y < 6.5,
        "service line": y > 6.4 if out else abs(y - 6.4) < 0.9, "t": abs(y - 6.4) < 0.9 and abs(x) < 1.0,
        "the t": abs(y - 6.4) < 0.9 and abs(x) < 1.0, "court": True, "field": True, "of the court": True,
        "baseline": y > 11.88 if out else y > 6.3 if "between" in words else y > 10.2, "net": y < 2.8,
        "corner": y > 9.3 and abs(x) > 2.3, "back corner": y > 9.3 and abs(x) > 2.3,
        "sideline": abs(x) > 4.1 if out else 3.2 < abs(x) < 4.2,
        "alley": 4.1 < abs(x) < 5.5 and 0 < y < 11.9, "doubles alley": 4.1 < abs(x) < 5.5 and 0 < y < 11.9,
        "tramlines": 4.1 < abs(x) < 5.5 and 0 < y < 11.9,
    }[area]  # fmt: skip
    least = 0.04 if box else 0.9
    sides = {
        "": True, "left": x < -least, "right": x > least, "deuce": x < 0, "ad": x > 0,
        "middle": abs(x) < 1.2, "center": abs(x) < 1.2, "central": abs(x) < 1.2,
    }  # fmt: skip
    said.must(holds and sides[side], words)
    said.must("short" not in how and "front" not in words or y < 3.6, words)
    said.must(not serve or out or box or area in ("t", "the t", "sideline"), words)
    return {"out"} if out else {"target"}


def _ball_ways(said: Said, stroke: Stroke, shot: Shot, verbs: list) -> set[str]:
    """Courses of the ball that name no area."""
    told: set[str] = set()
    x, y = landing(stroke, shot)
    start = stroke.ball[0] * (1.0 if stroke.player == 0 else -1.0)
    for m in said.all(r"cross court|crosscourt|across the court"):
        said.must(x * start < 0 and abs(x) > 1.2, m.group())
    for m in said.all(r"down the (?:(left|right) )?line"):
        said.must(x * start > 0 and abs(x - start) < 2.5 and abs(x) > 2.0, m.group())
        said.must(m.group(1) is None or (m.group(1) == "right") == (x > 0), m.group())
    for m in said.all(r"down the middle|through the middle|down the t|along the center line"):
        said.must(abs(x) < 1.2, m.group())
    for m in said.all(r"(?<=long )on the (left|right) side"):
        said.must((m.group(1) == "right") == (x > 0) and abs(x) > 0.9, m.group())
    for m in said.all(r"(?:too wide|out|wide) to the (left|right)"):
        said.must((m.group(1) == "right") == (x > 0) and (abs(x) > 4.1 or shot.result == "in"), m.group())
        told.add("out")
    for m in said.all(r"(?:wide|out) of the (left|right) sideline"):
        said.must((m.group(1) == "right") == (x > 0) and abs(x) > 4.1, m.group())
        told.add("out")
    for m in said.all(r"too long|long|too deep|over the baseline and out"):
        said.must(y > (6.4 if stroke.kind == "serve" else 11.88), m.group())
        told.add("out")
    if said.all(r"out"):
        told.add("out")
    for m in said.all(r"wide|with a wide angle"):
        said.must(stroke.kind == "serve" and shot.result == "in" and abs(x) > 2.9, m.group())
    first = next((at for at, kind in verbs if kind == "hit"), len(said.left))
    for m in re.finditer(r"(to|towards|at|in the direction of) the (left|right|middle)(?: side)?", said.left):
        if m.start() > first and next(k for at, k in reversed(verbs) if at < m.start()) == "hit":
            aim = shot.aim[0] * (1.0 if stroke.player == 0 else -1.0) if np.isnan(x) else x
            said.must({"left": aim < -0.9, "right": aim > 0.9, "middle": abs(aim) < 1.3}[m.group(2)], m.group())
            said.left = said.left[: m.start()] + "_" * len(m.group()) + said.left[m.end() :]
            told.add("aim" if np.isnan(x) else "target")
    said.all(r"the ball (?:goes|ends|lands|touches|brushes)|that lands|which goes|that flies")
    return told


def _own_place(said: Said, world: World, words: str, how: str, side: str, area: str, kind: str, window: tuple) -> None:
    """Hold a place of the player against its path: the end of a move, any moment of a stay."""
    piece = world.piece(*window) if kind == "move" else world.piece(said.start, said.end)
    x, depth = world.x[piece], -world.y[piece]
    if "recover" in words:
        return
    if how in ("along", "across"):
        said.must(area == "baseline" and bool((np.abs(depth - 11.885) < 1.5).all()) and abs(x[-1] - x[0]) > 1.2, words)
        return
    if kind == "move":
        x, depth = x[-1:], depth[-1:]
    behind = how.endswith("behind")
    where = {
        "no man's land": (depth > 6.9) & (depth < 11.1),
        "baseline": (depth > (13.9 if how in ("far behind", "well behind", "deep behind") else 12.2) if behind else (abs(depth - 11.885) < 0.9)),
        "service line": abs(depth - 6.4) < 0.8, "the t": (abs(depth - 6.4) < 0.8) & (abs(x) < 1.2), "t": abs(depth - 6.4) < 0.8,
        "service box": (depth > 3.4) & (depth < 5.9), "service boxes": (depth > 3.4) & (depth < 5.9), "net": depth < 3.4,
        "court": np.full(len(x), True) if side in ("deuce", "ad") else depth > 12.2 if "back of" in words else depth < 11.1,
        "side": np.full(len(x), True),
    }  # fmt: skip
    if area not in where:
        said.must(False, f"place not understood: {words}")
        return
    if area == "court" and how in ("to", "towards") and side in ("middle", "center"):
        said.must(bool(abs(x[-1]) < 1.2), words)
        return
    sides = {
        "": np.full(len(x), True), "left": x < -1.3, "right": x > 1.3, "middle": abs(x) < 1.2, "center": abs(x) < 1.2,
        "central": abs(x) < 1.2, "deuce": x > 0.8, "ad": x < -0.8,
    }  # fmt: skip
    said.must(bool((where[area] & sides[side]).any()), words)
