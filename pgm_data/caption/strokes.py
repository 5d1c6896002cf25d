"""What each hit is: stroke, side, spin, where it goes, what comes of it. Rules on measured contacts."""

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.caption.contacts import Contacts
from pgm_data.caption.court_areas import SURE, CourtAreas, across, directions, targets
from pgm_data.caption.facts import HitFacts
from pgm_data.dataset.clip_ball import ClipBall
from pgm_data.scene import Scene

SERVE_PAUSE_S = 4.0
"""A serve has no hit in this time before it."""
OVERHEAD_M = 0.30
"""A ball hit this far above the joint of the head is hit overhead."""
CLEAR_SIDE_M = 0.15
"""A ball this far to one side of the body is on that side."""
SURE_IN = 0.8
"""A landing is in above this probability and out below its complement."""
HARD_M_S, SOFT_M_S, HARD_SERVE_M_S = 36.0, 17.0, 54.0
SMASH_M_S = 20.0
LOB_M = 6.0
"""Height that a lob reaches, above the ground."""
DROP_M_S = 16.0
TOPSPIN_RPM, BACKSPIN_RPM, FLAT_RPM = 1600.0, -500.0, 700.0
TWO_HANDS_M = 0.24
"""Wrists nearer to each other than this hold one racket."""


def hit_facts(
    contacts: Contacts,
    ball: ClipBall,
    scene: Scene,
    areas: CourtAreas | None,
    handedness: tuple[str, ...],
) -> HitFacts:
    """The facts of all hits."""
    count = len(contacts.event)
    size = areas if areas is not None else CourtAreas(half_width=np.inf, half_length=np.inf, service_line=np.nan)
    is_serve = _serves(contacts, size, scene)
    hand = np.array([{"right": 1, "left": -1, "": 0}[handedness[p]] for p in contacts.player], dtype=np.int64)
    height = contacts.ball[:, 2]
    overhead = _overhead(contacts, scene)
    side = _sides(contacts, hand, overhead | is_serve)
    stroke = _strokes(contacts, ball, scene, size, is_serve, overhead)
    target = targets(contacts.landing, contacts.landing_std, is_serve, size)
    lands = np.isfinite(contacts.landing).all(axis=1)
    zone_side = target.side.copy()
    taken_x = contacts.taken[:, 0]
    scale = size.half_width / 4.115 if np.isfinite(size.half_width) else 1.0
    no_doubt = np.full(count, 0.2)
    in_air = np.isfinite(taken_x) & (target.zone == "") & ~is_serve
    zone_side[in_air] = across(taken_x, no_doubt, middle=0.8 * scale, beside=1.5 * scale)[in_air]
    direction = directions(contacts.ball[:, 0], contacts.landing[:, 0], contacts.landing_std[:, 0], size)
    direction[is_serve] = ""
    outcome, ending, decided = _ends(contacts, ball, is_serve, size)
    # A serve that is in lies in the box across, though its centre may lie beside the line.
    served = is_serve & (outcome == "in") & (target.zone == "") & lands
    target.zone[served] = "box"
    zone_side[served] = np.where(contacts.landing[served, 0] > 0, "right", "left")
    wrong = (outcome != "in") & (outcome != "") & (outcome != "out") & (outcome != "let")
    for words in (target.zone, target.depth, direction):
        words[wrong] = ""
    zone_side[wrong] = ""
    miss = target.miss.copy()
    miss[outcome != "out"] = ""
    return HitFacts(
        event=contacts.event,
        player=contacts.player,
        time=contacts.time,
        stroke=stroke,
        side=side,
        hands=_hands(contacts, side),
        is_return=_returns(contacts, is_serve),
        spin=_spins(contacts, stroke),
        pace=_paces(contacts, is_serve, stroke, areas),
        direction=direction,
        zone=target.zone,
        zone_side=zone_side,
        depth=target.depth,
        at_sideline=target.at_sideline & ~wrong,
        outcome=outcome,
        miss=miss,
        ending=ending,
        decided_s=decided,
        landing=contacts.landing,
        landing_std=contacts.landing_std,
        contact_height_m=height,
        speed_m_s=contacts.speed,
        apex_m=contacts.apex,
        topspin_rpm=contacts.topspin,
        topspin_std_rpm=contacts.topspin_std,
    )


def _serves(contacts: Contacts, areas: CourtAreas, scene: Scene) -> Bool[np.ndarray, " hits"]:
    """Hits high above the head from behind the baseline, with no hit before them: on courts with service boxes."""
    with np.errstate(invalid="ignore"):
        high = contacts.ball[:, 2] > 1.15 * scene.person_height_m
        # The ball is hit some decimetres inside of the line.
        behind = _depth(contacts) > areas.half_length - np.where(np.isfinite(contacts.body[:, 1]), 0.8, 1.5)
    pause = np.diff(contacts.time, prepend=-np.inf) > SERVE_PAUSE_S
    return high & behind & pause & areas.has_boxes


def _depth(contacts: Contacts) -> Float[np.ndarray, " hits"]:
    """How far from the net the player is, metres; where that is not known, how far the ball is."""
    return -np.where(np.isfinite(contacts.body[:, 1]), contacts.body[:, 1], contacts.ball[:, 1])


def _overhead(contacts: Contacts, scene: Scene) -> Bool[np.ndarray, " hits"]:
    known = np.isfinite(contacts.head_height)
    limit = np.where(known, contacts.head_height + OVERHEAD_M, 1.15 * scene.person_height_m)
    with np.errstate(invalid="ignore"):
        return contacts.ball[:, 2] > limit


def _sides(
    contacts: Contacts, hand: Int[np.ndarray, " hits"], overhead: Bool[np.ndarray, " hits"]
) -> Shaped[np.ndarray, " hits"]:
    """Forehand where the ball is on the side of the racket's hand, by where the body is and how it is turned."""
    offset = contacts.ball[:, :2] - contacts.body[:, :2]
    # Half of the way between the body's own right and that of one who faces the net: a player turns with the stroke.
    turned = np.where(np.isfinite(contacts.right), contacts.right, [1.0, 0.0]) + [1.0, 0.0]
    axis = turned / np.maximum(np.hypot(*turned.T), 0.3)[:, None]
    lateral = hand * (offset * axis).sum(axis=1)
    limit = CLEAR_SIDE_M + 0.5 * np.nan_to_num(contacts.ball_std)
    words = np.full(len(hand), "", dtype=object)
    with np.errstate(invalid="ignore"):
        words[(hand != 0) & (lateral > limit)] = "forehand"
        words[(hand != 0) & (lateral < -limit)] = "backhand"
    words[overhead] = "overhead"
    return words


def _hands(contacts: Contacts, side: Shaped[np.ndarray, " hits"]) -> Int[np.ndarray, " hits"]:
    """Hands on the racket of backhands, by how far apart the wrists are."""
    apart = np.linalg.norm(contacts.left_wrist - contacts.right_wrist, axis=1)
    hands = np.zeros(len(side), dtype=np.int64)
    with np.errstate(invalid="ignore"):
        hands[(side == "backhand") & (apart < TWO_HANDS_M)] = 2
        hands[(side == "backhand") & (apart > 2 * TWO_HANDS_M)] = 1
    return hands


def _bounced(contacts: Contacts, ball: ClipBall) -> tuple[Float[np.ndarray, " hits"], Bool[np.ndarray, " hits"]]:
    """Time from the last bounce to each hit (infinite where it came without one), and whether the flight was seen."""
    kinds, times = ball.events.kind, ball.events.time
    since = np.full(len(contacts.event), np.inf)
    seen = np.zeros(len(contacts.event), dtype=bool)
    placed = np.asarray(np.isfinite(ball.position).all(axis=1), dtype=bool)
    for k, event in enumerate(contacts.event.tolist()):
        before = [row for row in range(event) if kinds[row] == "hit"]
        if not before:
            continue
        between = range(before[-1] + 1, event)
        inside = (ball.capture_time >= times[before[-1]]) & (ball.capture_time <= times[event])
        seen[k] = bool(inside.any()) and float(placed[inside].mean()) > 0.8
        bounces = [row for row in between if kinds[row] == "bounce"]
        if bounces:
            since[k] = times[event] - times[bounces[-1]]
    return since, seen


def _strokes(
    contacts: Contacts,
    ball: ClipBall,
    scene: Scene,
    areas: CourtAreas,
    is_serve: Bool[np.ndarray, " hits"],
    overhead: Bool[np.ndarray, " hits"],
) -> Shaped[np.ndarray, " hits"]:
    """Names of the strokes; empty where the rules do not apply or what they need is not known."""
    words = np.full(len(contacts.event), "", dtype=object)
    if areas.has_boxes:
        since, seen = _bounced(contacts, ball)
        y = _depth(contacts)
        with np.errstate(invalid="ignore"):
            words[seen & (np.isfinite(since) | (y > areas.service_line + 3.0))] = "groundstroke"
            words[seen & (since < 0.11) & (contacts.ball[:, 2] < 0.65)] = "half volley"
            words[seen & np.isinf(since) & (y < areas.service_line + 2.0)] = "volley"
            lands_short = contacts.landing[:, 1] + SURE * contacts.landing_std[:, 1] < 4.3
            words[lands_short & (contacts.landing[:, 1] > 0) & (contacts.speed < DROP_M_S) & ~overhead] = "drop shot"
            words[(contacts.apex > LOB_M) & (contacts.apex > contacts.ball[:, 2] + 1.5)] = "lob"
    with np.errstate(invalid="ignore"):
        falls = contacts.apex < contacts.ball[:, 2] + 0.5
        if scene.ball is not None and areas.is_walked_on:
            words[overhead & falls & (contacts.speed > SMASH_M_S) & (_depth(contacts) < 1.2 * areas.half_length)] = (
                "smash"
            )
    words[is_serve] = "serve"
    return words


def _returns(contacts: Contacts, is_serve: Bool[np.ndarray, " hits"]) -> Bool[np.ndarray, " hits"]:
    """The first hit after a serve, by another."""
    result = np.zeros(len(is_serve), dtype=bool)
    if len(result) > 1:
        result[1:] = is_serve[:-1] & (contacts.player[1:] != contacts.player[:-1])
        result[1:] &= np.diff(contacts.time) < SERVE_PAUSE_S
    return result


def _spins(contacts: Contacts, stroke: Shaped[np.ndarray, " hits"]) -> Shaped[np.ndarray, " hits"]:
    """Topspin, flat or slice of strokes after a bounce, where the spin is known well enough to tell."""
    words = np.full(len(stroke), "", dtype=object)
    spin, reach = contacts.topspin, SURE * contacts.topspin_std
    drive = stroke == "groundstroke"
    with np.errstate(invalid="ignore"):
        words[drive & (spin - reach > TOPSPIN_RPM)] = "topspin"
        words[drive & (spin + reach < BACKSPIN_RPM)] = "slice"
        words[drive & (np.abs(spin) + reach < FLAT_RPM) & (words == "")] = "flat"
    return words


def _paces(
    contacts: Contacts, is_serve: np.ndarray, stroke: Shaped[np.ndarray, " hits"], areas: CourtAreas | None
) -> Shaped[np.ndarray, " hits"]:
    """Hard or soft, by the speed after the hit; of tennis alone."""
    words = np.full(len(stroke), "", dtype=object)
    if areas is None or not areas.has_boxes:
        return words
    with np.errstate(invalid="ignore"):
        words[contacts.speed > np.where(is_serve, HARD_SERVE_M_S, HARD_M_S)] = "hard"
        soft = (contacts.speed < SOFT_M_S) & (stroke != "lob") & (stroke != "smash") & (stroke != "serve")
        words[soft & (stroke != "drop shot")] = "soft"
    return words


def _ends(
    contacts: Contacts, ball: ClipBall, is_serve: Bool[np.ndarray, " hits"], areas: CourtAreas
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outcome, ending and when it shows, of every hit."""
    events = ball.events
    count = len(contacts.event)
    outcome, ending = np.full(count, "", dtype=object), np.full(count, "", dtype=object)
    decided = np.full(count, np.nan)
    for k, rows in enumerate(contacts.after):
        kinds = [str(events.kind[row]) for row in rows]
        following = int(contacts.next_event[k])
        rally_goes_on = following >= 0 and events.time[following] - contacts.time[k] < SERVE_PAUSE_S
        probability = float(contacts.in_probability[k])
        bounces = [row for row in rows if events.kind[row] == "bounce"]
        netted = [row for row in rows if events.kind[row] == "net"]
        over = len(bounces) > 0 and bool(contacts.landing[k, 1] > 0.3)
        if rally_goes_on:
            # The other player hits it: it was in, taken in the air, or a serve that was a fault and hit all the same.
            outcome[k] = "in" if probability > SURE_IN else ""
            continue
        if netted and not over and (bounces or "last" in kinds):
            outcome[k], decided[k] = "net", events.time[netted[0]]
        elif netted:
            outcome[k] = "let" if is_serve[k] and over and _in_for_sure(contacts, k, areas) else ""
            if outcome[k]:
                decided[k] = events.time[bounces[0]]
            continue
        elif bounces and probability < 1 - SURE_IN:
            outcome[k], decided[k] = "out", events.time[bounces[0]]
        elif probability > SURE_IN:
            outcome[k] = "in"
            if len(bounces) > 1:
                ending[k], decided[k] = ("ace" if is_serve[k] else "winner"), events.time[bounces[1]]
        if outcome[k] in ("net", "out"):
            ending[k] = "fault" if is_serve[k] else "error"
    return outcome, ending, decided


def _in_for_sure(contacts: Contacts, k: int, areas: CourtAreas) -> bool:
    """Whether a serve that touched the net lands in a box, whatever its flight's probability."""
    x, y = contacts.landing[k]
    reach = SURE * contacts.landing_std[k]
    crossed = x * contacts.ball[k, 0] < 0
    return bool(crossed and abs(x) + reach[0] < areas.half_width and 0 < y and y + reach[1] < areas.service_line)
