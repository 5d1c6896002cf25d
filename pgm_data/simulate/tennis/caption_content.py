"""What a caption says about its span, as slots of the grammar and sentence frames that suit them."""

from dataclasses import dataclass

import numpy as np

from pgm_data.simulate.tennis.areas import Area, own_frame, place_of
from pgm_data.simulate.tennis.caption_course import Course, Hit
from pgm_data.simulate.tennis.caption_hits import hit_slots
from pgm_data.simulate.tennis.caption_motion import Motion, motion_of
from pgm_data.simulate.tennis.phrases import Draw

PREPARING_S = 1.2
"""A stroke is prepared when it follows within this time."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Content:
    """What is said, before it is worded."""

    frames: tuple[str, ...]
    """Symbols of sentences, one of which a text is drawn from; the more often it stands here the likelier."""
    slots: dict[str, str]


def content_of(course: Course, player: int, start_s: float, end_s: float, draw: Draw) -> Content:
    """What is said of the player from start_s to end_s."""
    span = _Span(course=course, player=player, start_s=start_s, end_s=end_s, draw=draw)
    own = course.of(player, start_s, end_s)
    if own:
        return _hitting(span, own[-1] if own[-1].shot is not None else own[0])
    if start_s <= course.decided_s < end_s:
        return _ending(span)
    if start_s >= course.decided_s:
        return _after(span)
    if end_s <= course.serve_s:
        return _before(span)
    other = [hit for hit in course.of(1 - player, start_s, end_s) if hit.shot is not None]
    return _watching(span, other[-1]) if other else _between(span)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Span:
    course: Course
    player: int
    start_s: float
    end_s: float
    draw: Draw

    def motion(self, start_s: float, end_s: float) -> Motion:
        plan = self.course.play.plans[self.player]
        return motion_of(self.player, plan, self.course.speeds[self.player], start_s, end_s)


def _hitting(span: _Span, hit: Hit) -> Content:
    """The player swings."""
    course, draw, stroke = span.course, span.draw, hit.stroke
    slots = hit_slots(course, hit, draw)
    frames = ["frame_h"]
    before = span.motion(span.start_s, stroke.time) if stroke.time - span.start_s > 0.4 else None
    if stroke.kind == "serve":
        slots |= {"nth": _nth(course)}
        spot = _spot(place_of(own_frame(span.player, _position(span, stroke.time))), slots)
        frames = ["frame_h", "frame_h"]
        if spot:
            stands = before is not None and before.kind == "still"
            frames += ["frame_stand_h" if stands else "frame_at_h"]
        if span.start_s < stroke.toss_time:
            frames += ["frame_tossed", "frame_tossed"]
        if stroke.time - span.start_s > 1.2:
            slots["m"] = "{prepare_serve}"
            frames += ["frame_mh"]
        return Content(frames=tuple(frames), slots=slots)
    worth_saying = before is not None and (draw() < 0.4 or any(leg.distance_m > 1.0 for leg in before.legs))
    moved = before is not None and worth_saying and _move(span, before, slots, incoming=True)
    if stroke.stretch > 0.7 and draw() < 0.8:
        if moved:
            slots |= {"effort": ", {stretch}", "purpose": "", "goal": "", "then": ""}
        else:
            slots["m"] = "{stretch}"
        moved = True
    if moved:
        frames = ["frame_mh"] * 9
        if "passive" in slots:
            frames += ["frame_mp"]
        return Content(frames=tuple(frames), slots=slots)
    after = span.motion(stroke.time, span.end_s) if span.end_s - stroke.time > 0.6 else None
    if after is not None and _move(span, after, slots, incoming=False) and after.kind != "still":
        return Content(frames=("frame_hm",), slots=slots)
    if _spot(place_of(own_frame(span.player, _position(span, stroke.time))), slots):
        frames += ["frame_at_h"]
    return Content(frames=(*frames, *(["frame_p"] if "passive" in slots else [])), slots=slots)


def _ending(span: _Span) -> Content:
    """It shows how the play ends."""
    course, play, draw = span.course, span.course.play, span.draw
    last = course.last
    slots: dict[str, str] = {"nth": _nth(course), "w": "{watch}"}
    motion = span.motion(span.start_s, span.end_s)
    moved = _move(span, motion, slots, incoming=False)
    if last is None or last.shot is None:
        return Content(frames=(_alone(slots),) if moved else ("frame_w",), slots=slots)
    result = last.shot.result
    own = last.stroke.player == span.player
    who = "own" if own else "opp"
    if last.stroke.kind == "serve" and result != "in":
        double = play.outcome == "double_fault"
        prefix = "r_own_" if own else "r_"
        kind = "let" if result == "let" else "double" if double else f"fault_{result}"
        slots["r"] = f"{{{prefix}{kind}}}"
    elif result in ("net", "out"):
        slots["r"] = f"{{r_{who}_{result}}}"
    elif play.winner != last.stroke.player:
        return Content(frames=(_alone(slots),) if moved else ("frame_w",), slots=slots)
    else:
        slots["r"] = "{r_opp_ace}" if not own and play.outcome == "ace" else f"{{r_{who}_winner}}"
        if not own and moved and motion.kind == "moves" and draw() < 0.5:
            slots["f"] = "{fail}"
            return Content(frames=("frame_mf",), slots=slots)
    if not own and motion.stops and result in ("net", "out") and last.stroke.kind != "serve" and draw() < 0.35:
        slots["m"] = "{prepare_stop}"
        return Content(frames=("frame_sr",), slots=slots)
    if not moved:
        return Content(frames=("frame_wr",), slots=slots)
    stands = motion.kind == "still" or motion.stops
    frames = ("frame_sr",) if stands and not own else ("frame_mr",)
    return Content(frames=frames, slots=slots)


def _after(span: _Span) -> Content:
    """The play is over."""
    play = span.course.play
    slots: dict[str, str] = {"nth": _nth(span.course)}
    motion = span.motion(span.start_s, span.end_s)
    if play.outcome in ("fault", "let"):
        slots["after"] = "{after_fault}" if play.outcome == "fault" else "{after_let}"
        slots["w"] = "{wait_second}" if play.outcome == "fault" else "{wait_repeat}"
    else:
        side = "won" if play.winner == span.player else "lost"
        slots["after"] = "{after_point}" if span.draw() < 0.5 else f"{{after_{side}}}"
        slots["w"] = "{wait_next}"
    if _move(span, motion, slots, incoming=False):
        return Content(frames=("frame_ma",) if span.draw() < 0.35 else (_alone(slots),), slots=slots)
    return Content(frames=("frame_wa",), slots=slots)


def _before(span: _Span) -> Content:
    """The serve is yet to come."""
    play = span.course.play
    slots: dict[str, str] = {"nth": _nth(span.course)}
    slots["w"] = "{prepare_serve}" if play.server == span.player else "{wait_serve}"
    content = _moving_or_waiting(span, slots)
    where = place_of(span.motion(span.start_s, span.end_s).end)
    if (
        "spot" in slots
        and where.name in ("baseline", "behind")
        and where.side in ("left", "right")
        and span.draw() < 0.35
    ):
        # Each half's deuce side is on the right of the player there.
        slots |= {"spot": "{spot_dc}", "dc": "deuce" if where.side == "right" else "ad"}
    return content


def _watching(span: _Span, other: Hit) -> Content:
    """The opponent hits the ball and the play goes on."""
    stroke = other.stroke
    slots: dict[str, str] = {"nth": _nth(span.course), "ofb": stroke.side}
    slots["o"] = "{o_serve}" if stroke.kind == "serve" else "{o_hit}"
    plain = {"overhead": "{onp_smash}"}.get(stroke.side, f"{{onp_{stroke.kind}}}")
    slots["onp"] = plain if stroke.kind != "serve" else ""
    motion = span.motion(span.start_s, span.end_s)
    late = stroke.time - span.start_s > 0.4 * (span.end_s - span.start_s)
    wait = "{wait_serve}" if stroke.kind == "serve" else "{wait_ball}"
    moved = _move(span, motion, slots, incoming=span.course.next_own(span.player, span.end_s) is not None)
    if late and motion.kind == "still":
        slots["w"] = f"{slots['m']} and {wait}" if span.draw() < 0.4 else wait
        return Content(frames=("frame_wo",), slots=slots)
    if moved:
        return Content(frames=("frame_mo",) if span.draw() < 0.45 else (_alone(slots),), slots=slots)
    slots["w"] = "{watch}"
    return Content(frames=("frame_wo",), slots=slots)


def _between(span: _Span) -> Content:
    """The ball flies, and nobody hits it."""
    course = span.course
    slots: dict[str, str] = {"nth": _nth(course)}
    before = course.ball_before(span.start_s)
    upcoming = course.next_own(span.player, span.end_s)
    if before is None or before.stroke.player == span.player:
        slots["w"] = "{wait_ball}"
        return _moving_or_waiting(span, slots)
    if upcoming is None or upcoming.stroke.time > span.end_s + PREPARING_S:
        slots["w"] = "{watch}"
    else:
        known = upcoming.stroke.side != "overhead"
        slots |= {"w": "{prepare_hit}" if known else "{prepare_plain}", "fb": upcoming.stroke.side}
    motion = span.motion(span.start_s, span.end_s)
    if _move(span, motion, slots, incoming=upcoming is not None):
        prepares = upcoming is not None and upcoming.stroke.time < span.end_s + PREPARING_S and span.draw() < 0.5
        return Content(frames=("frame_mw",) if prepares else (_alone(slots),), slots=slots)
    return Content(frames=("frame_w",), slots=slots)


def _moving_or_waiting(span: _Span, slots: dict[str, str]) -> Content:
    """Motion and waiting (slot `w`) in one sentence."""
    motion = span.motion(span.start_s, span.end_s)
    if motion.kind == "moves" and _recovers(motion) and span.draw() < 0.6:
        slots |= {"m": "{recover}", "gait": _gait(motion)}
        return Content(frames=("frame_mw",) if span.draw() < 0.7 else ("frame_m",), slots=slots)
    moved = _move(span, motion, slots, incoming=False)
    if moved and motion.kind in ("still", "shifts"):
        share = span.draw()
        return Content(frames=("frame_sw" if share < 0.65 else "frame_w" if share < 0.9 else "frame_m",), slots=slots)
    if moved:
        return Content(frames=("frame_mw",) if span.draw() < 0.65 else (_alone(slots),), slots=slots)
    if _spot(place_of(motion.end), slots) and abs(motion.end[0] - motion.start[0]) < 0.5:
        return Content(frames=("frame_ws",), slots=slots)
    return Content(frames=("frame_w",), slots=slots)


def _alone(slots: dict[str, str]) -> str:
    """The frame of a motion by itself; what starts, stops or turns is not said to go on."""
    lasts = slots["motion"] in ("{move}", "{shifts}", "{shifts_at}")
    return "frame_m" if lasts and not slots["first"] and not slots["then"] else "frame_ms"


_GAITS = {"move": "{go}"}
_WAYS = {
    "left": "{way_side}",
    "right": "{way_side}",
    "forward": "{way_forward}",
    "back": "{way_back}",
    "left forward": "{way_side_forward}",
    "right forward": "{way_side_forward}",
    "left back": "{way_side_back}",
    "right back": "{way_side_back}",
}


def _gait(motion: Motion) -> str:
    leg = motion.legs[0]
    name = leg.gait
    if (name == "backpedal" and "back" not in leg.way) or (name == "sidestep" and leg.way in ("forward", "back")):
        name = "move"
    return _GAITS.get(name, f"{{{name}}}")


def _move(span: _Span, motion: Motion, slots: dict[str, str], *, incoming: bool) -> bool:
    """Put the motion into the slots, its sentence into `m`; False where there is nothing clear to say."""
    draw = span.draw
    if motion.kind == "unclear":
        return False
    slots |= {"m": "{moved}", "first": "", "then": "", "effort": ""}
    if motion.kind in ("still", "shifts"):
        at = draw() < 0.5 and _spot(place_of(motion.end), slots)
        slots["motion"] = f"{{{motion.kind}_at}}" if at else f"{{{motion.kind}}}"
    else:
        leg = motion.legs[0]
        slots |= {"gait": _gait(motion), "way": _WAYS[leg.way], "side": leg.way.split()[0]}
        slots |= {"pace": "", "goal": "", "purpose": ""}
        if slots["gait"] == "{backpedal}" and leg.way == "back" and motion.kind == "moves":
            slots |= {"gait": "{retreat}", "way": "{way_retreat}"}
        # One of these at most, since a sentence that holds them all is longer than people write.
        extra = draw()
        hits = "h" in slots
        if incoming and not motion.stops and extra < 0.15:
            slots["purpose"] = "{purpose_reach}"
        elif leg.gait in ("run", "walk") and 0.15 <= extra < 0.35 and not 1.2 < leg.peak < 4.2:
            slots["pace"] = "{fast}" if leg.gait == "run" else "{slow}"
        place = place_of(motion.end)
        if motion.kind == "turns":
            second = motion.legs[1].way
            slots["side2"] = second.split()[0]
            sideways = second.startswith(("left", "right"))
            slots["again"] = "{again_side}" if sideways else f"{{again_{second}}}"
            slots["motion"] = "{turn}"
        elif motion.starts and not hits and draw() < 0.6:
            slots["motion"] = "{start}"
        else:
            # Forward to behind the baseline is true of some moves and clear to nobody.
            fits = "forward" not in leg.way or place.name not in ("behind", "far_back")
            if motion.along_baseline and extra > 0.8:
                slots["goal"] = "{along}"
            elif place.name and fits and leg.distance_m > 0.8 and 0.35 < extra < (0.47 if hits else 0.65):
                slots |= {"goal": _named("goal", place), "at": place.side}
            slots["motion"] = "{move_halt}" if motion.stops else "{move}"
    _split(span, motion, slots)
    return True


def _split(span: _Span, motion: Motion, slots: dict[str, str]) -> None:
    """Add a split step that lands in the span to the motion in the slots."""
    splits = span.course.play.plans[span.player].splits
    inside = splits[(splits >= span.start_s) & (splits < span.end_s)]
    if not len(inside) or span.draw() > 0.25:
        return
    share = (float(inside[-1]) - span.start_s) / (span.end_s - span.start_s)
    if motion.kind in ("still", "shifts") or share > 0.7:
        slots["then"] = "{then_split}"
    elif share < 0.4:
        slots["first"] = "{first_split}"


def _recovers(motion: Motion) -> bool:
    """Comes back to the middle."""
    start, end = abs(float(motion.start[0])), abs(float(motion.end[0]))
    return end < 1.0 and start - end > 0.9


def _named(prefix: str, place: Area) -> str:
    suffix = "" if not place.side else "_middle" if place.side == "middle" else "_side"
    return f"{{{prefix}_{place.name}{suffix}}}"


def _spot(place: Area, slots: dict[str, str]) -> bool:
    """Put a place into the slots; False where it has no name."""
    if not place.name:
        return False
    slots |= {"spot": _named("spot", place), "at": place.side}
    return True


def _position(span: _Span, time: float) -> np.ndarray:
    plan = span.course.play.plans[span.player]
    return plan.path[min(round(time * 50), len(plan.path) - 1)]


def _nth(course: Course) -> str:
    return "first" if course.play.serve_number == 1 else "second"
