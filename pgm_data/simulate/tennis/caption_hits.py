"""What a caption says of a stroke: its name, where the ball goes, and what comes of it."""

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.tennis.areas import (
    Area,
    course_of,
    miss_of,
    own_frame,
    placement_of,
    side_of,
    targets_of,
)
from pgm_data.simulate.tennis.caption_course import Course, Hit
from pgm_data.simulate.tennis.phrases import Draw
from pgm_data.simulate.tennis.play import Shot, Stroke

RPM = 60.0 / (2.0 * np.pi)
TOPSPIN_RPM, HEAVY_RPM, FLAT_RPM = 1800.0, 3000.0, 700.0
HARD_SPEED, SOFT_SPEED, HARD_SERVE = 36.0, 17.0, 54.0
"""m/s."""
_WEIGHTS = {
    "land": 7.0, "box": 5.0, "boxes": 1.0, "deuce_box": 1.0, "short_box": 2.0, "tee": 2.0, "corner": 2.0,
    "baseline": 2.0, "service_line": 1.0, "sideline": 1.5, "half": 1.5, "front": 3.0,
}  # fmt: skip
"""How readily a target is called by each of its names."""


def hit_slots(course: Course, hit: Hit, draw: Draw) -> dict[str, str]:
    """Slots of the grammar that describe a stroke, its clause in `h`."""
    stroke, shot = hit.stroke, hit.shot
    slots = {"fb": stroke.side, "adj": "", "hands": "", "fault": ""}
    if shot is None:
        return slots | {"h": "{miss}" if stroke.side != "overhead" else "{miss_plain}"}
    slots |= {"np": _stroke_name(hit), "adj": _adjective(course, stroke, shot, draw)}
    if stroke.side == "backhand" and draw() < 0.35:
        slots["hands"] = "{two_handed}" if stroke.hands == 2 else "{one_handed}"
    serve = stroke.kind == "serve"
    if serve and shot.result in ("net", "out"):
        slots["fault"] = "{double_fault}" if course.play.outcome == "double_fault" else "{fault_said}"
    if shot.result == "let":
        return slots | {"h": "{hit_serve_let}"}
    if shot.result == "net":
        return slots | {"h": "{hit_serve_net}" if serve else "{hit_net}"}
    if shot.result == "out":
        return slots | _out(stroke.player, shot, draw, serve=serve) | {"h": "{hit_serve_out}" if serve else "{hit_out}"}
    return slots | _in(course, hit, stroke, shot, draw)


def _in(course: Course, hit: Hit, stroke: Stroke, shot: Shot, draw: Draw) -> dict[str, str]:
    """Slots of a ball that lands in, or that the opponent takes before it lands."""
    play = course.play
    target = _target(stroke, shot, draw)
    if not target:
        return _aim(course, stroke, shot)
    if stroke.kind == "serve":
        ace = play.outcome == "ace" and draw() < 0.8
        return target | {"h": "{hit_ace}" if ace else "{hit_serve}"}
    plain = stroke.kind == "lob" and stroke.side == "overhead"
    said = {"volley": "hit_volley", "smash": "hit_smash", "lob": "hit_lob", "drop": "hit_drop", "slice": "hit_slice"}
    name = "hit_lob_plain" if plain else said.get(stroke.kind, "hit_in")
    if stroke.side == "overhead" and name in ("hit_slice", "hit_volley", "hit_drop"):
        name = "hit_in"
    if hit.is_return:
        name = "hit_return"
        if stroke.kind != "drive" or stroke.side == "overhead":
            target["np_return"] = "{np}"
    if hit.clips_net:
        name = "hit_clips"
    slots = target | {"hit": f"{{{name}}}", "h": f"{{{name}}}", "passive": "{passive_in}"}
    if hit.is_last and play.outcome == "winner" and play.winner == stroke.player and draw() < 0.6:
        slots["h"] = "{hit_winner}"
    return slots


def _stroke_name(hit: Hit) -> str:
    kind, side = hit.stroke.kind, hit.stroke.side
    if kind == "lob" and side == "overhead":
        return "{np_lob_plain}"
    if side == "overhead" and kind not in ("serve", "smash", "volley"):
        return "{np_smash}" if kind == "drive" else f"{{np_{kind}}}"
    if hit.passing:
        return "{np_passing}"
    return f"{{np_{kind}}}"


def _adjective(course: Course, stroke: Stroke, shot: Shot, draw: Draw) -> str:
    """A word on the spin or the speed that holds, or none."""
    words: list[str] = []
    if stroke.kind == "serve":
        words += _serve_spin(course.play.ball.flights[shot.contact].spins[0], course, shot)
        if shot.speed > HARD_SERVE:
            words.append("{hard}")
    else:
        if stroke.kind == "drive":
            if shot.spin_rpm > HEAVY_RPM:
                words.append("{heavy_topspin}")
            elif shot.spin_rpm > TOPSPIN_RPM:
                words.append("{topspin}")
            elif abs(shot.spin_rpm) < FLAT_RPM:
                words.append("{flat}")
        if shot.speed > HARD_SPEED:
            words.append("{hard}")
        elif shot.speed < SOFT_SPEED and stroke.kind not in ("lob", "smash"):
            words.append("{soft}")
    return words[int(draw() * len(words))] if words and draw() < 0.4 else ""


def _serve_spin(spin: Float[np.ndarray, " 3"], course: Course, shot: Shot) -> list[str]:
    """Flat, kick or slice, by how much the ball spins and about which axis."""
    along = course.play.ball.flights[shot.contact].velocities[0][:2]
    along = along / max(float(np.hypot(*along)), 1e-9)
    rpm = float(np.linalg.norm(spin)) * RPM
    # Topspin turns about up x along: its top moves ahead.
    top = float(-spin[0] * along[1] + spin[1] * along[0]) * RPM
    if rpm < 1500:
        return ["{serve_flat}"]
    if rpm > 2500 and top > 0.75 * rpm:
        return ["{serve_kick}"]
    return ["{serve_slice}"] if abs(float(spin[2])) * RPM > 0.75 * rpm else []


def _target(stroke: Stroke, shot: Shot, draw: Draw) -> dict[str, str]:
    """Slots `to` and its sides; empty where the ball does not land or lands nowhere with a name."""
    if not np.isfinite(shot.landing).all():
        return {}
    landing = own_frame(stroke.player, shot.landing)
    areas = targets_of(landing)
    serve = stroke.kind == "serve"
    if serve:
        areas = tuple(a for a in areas if a.name in ("box", "boxes", "deuce_box", "tee", "sideline"))
    if not areas:
        return {}
    area = _pick(areas, draw)
    slots = {"ts": area.side, "dc": "ad" if landing[0] > 0 else "deuce"}
    named = area.name in ("box", "boxes", "deuce_box", "short_box", "tee")
    suffix = "" if named or not area.side else "_middle" if area.side == "middle" else "_side"
    to = f"{{to_{area.name}{suffix}}}"
    if serve:
        placement = placement_of(landing)
        if placement and area.name in ("box", "deuce_box") and draw() < 0.5:
            to = f"{{serve_{placement}}} {to}"
        return slots | {"to": to}
    course = course_of(own_frame(stroke.player, stroke.ball[:2]), landing)
    if course and area.name != "half" and draw() < 0.2:
        if course == "line":
            slots["ts"] = side_of(float(landing[0]), middle=0.0, beside=0.0)
        to = f"{{course_{course}}} {to}"
    return slots | {"to": to}


def _pick(areas: tuple[Area, ...], draw: Draw) -> Area:
    weights = np.cumsum([_WEIGHTS[area.name] for area in areas])
    return areas[int(np.searchsorted(weights, draw() * weights[-1], side="right"))]


def _aim(course: Course, stroke: Stroke, shot: Shot) -> dict[str, str]:
    """Slots of a ball that the opponent takes in the air: the side it was aimed at, where it went there too."""
    contacts = course.play.ball.contacts
    taken = contacts[min(shot.contact + 1, len(contacts) - 1)].position[:2]
    aimed = side_of(float(own_frame(stroke.player, shot.aim)[0]), middle=0.9, beside=1.5)
    went = side_of(float(own_frame(stroke.player, taken)[0]), middle=0.9, beside=0.9)
    if not aimed or aimed != went:
        return {"h": "{hit_bare}"}
    return {"h": "{hit_aim}", "aim": "{aim_middle}" if aimed == "middle" else "{aim_side}", "ts": aimed}


def _out(player: int, shot: Shot, draw: Draw, *, serve: bool) -> dict[str, str]:
    """Slots `out` and its side."""
    if np.isfinite(shot.landing).all() and draw() < 0.6:
        miss, side = miss_of(own_frame(player, shot.landing), serve=serve)
        if miss == "long" and side in ("left", "right") and draw() < 0.4:
            return {"out": "{out_long_side}", "ts": side}
        if miss:
            return {"out": f"{{out_{miss}}}", "ts": side}
    return {"out": "{out_plain}"}
