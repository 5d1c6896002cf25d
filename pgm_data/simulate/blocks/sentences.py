"""Sentences that the facts of a span allow, and a choice among them by lot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pgm_data.simulate.blocks.world import BlockWorld

if TYPE_CHECKING:
    from pgm_data.simulate.blocks.captions import Facts

LEAST_TURN = np.radians(25)
SLIGHT_TURN = np.radians(10)
NO_TURN = np.radians(4)
FAST = 4.8
"""m/s, mean over the span: above it one runs, well below it one walks."""
ALTERNATIVES = (3, 6)

RUNS = ("runs", "runs", "sprints", "dashes", "rushes")
WALKS = ("walks", "walks", "strolls", "wanders")
STANDS = ("does nothing", "stands still", "waits", "does not move", "remains still", "stays in place", "is idle")


def sentences(rng: np.random.Generator, facts: Facts, world: BlockWorld) -> tuple[str, ...]:
    """Three to six different sentences, the main one first."""
    pool = _Pool(rng, world)
    _say(pool, facts)
    said = list(dict.fromkeys(pool.clauses))
    order = rng.permutation(len(said))
    count = min(int(rng.integers(ALTERNATIVES[0], ALTERNATIVES[1] + 1)), len(said))
    return tuple(f"the player {said[int(i)]}" for i in order[:count])


class _Pool:
    """Clauses gathered for one span."""

    def __init__(self, rng: np.random.Generator, world: BlockWorld) -> None:
        self.rng = rng
        self.world = world
        self.clauses: list[str] = []

    def one(self, *choices: str) -> str:
        return choices[int(self.rng.integers(len(choices)))]

    def name(self, element: int) -> str:
        return "the " + self.one(*self.world.elements[element].names)

    def add(self, *clauses: str) -> None:
        self.clauses += [" ".join(c.split()).replace(" ,", ",") for c in clauses]


def _say(pool: _Pool, facts: Facts) -> None:
    share = facts.shares
    climbs_up, climbs_down = share.get("climb_up", 0.0), share.get("climb_down", 0.0)
    if facts.take_off:
        _jump(pool, facts)
    elif facts.landed_by == "jump":
        _land(pool, facts)
    elif share.get("jump", 0.0) > 0.5:
        _in_the_air(pool, facts)
    elif share.get("fall", 0.0) > 0.25 and facts.rise < -0.3:
        _fall(pool, facts)
    elif climbs_up > 0.3 and facts.rise > 0.2:
        _climb(pool, facts, "up")
    elif climbs_down > 0.3 and facts.rise < -0.2:
        _climb(pool, facts, "down")
    elif facts.most_speed < 0.05 and facts.rise == 0:
        _rest(pool, facts)
    else:
        _travel(pool, facts)
    if len(pool.clauses) < 3:
        _plain(pool, facts)


def _turning(pool: _Pool, facts: Facts) -> list[str]:
    """Ways to end a sentence that say how the player turns; at least the empty one."""
    if abs(facts.turned) > LEAST_TURN:
        sense = "counterclockwise" if facts.turned > 0 else "clockwise"
        ends = [f"and rotates {sense}", f"and turns {sense}", f"while rotating {sense}", f"rotating {sense}"]
        return [*ends, "and turns around"] if abs(facts.turned) > np.radians(150) else ends
    if abs(facts.turned) > SLIGHT_TURN and facts.turn_range < abs(facts.turned) + NO_TURN:
        sense = "counterclockwise" if facts.turned > 0 else "clockwise"
        return ["", f"and rotates slightly {sense}", f"and turns a little {sense}"]
    if facts.turn_range < NO_TURN:
        ends = ["", "and does not rotate", "without rotating", "and keeps its direction"]
        return [*ends, f"while facing {facts.facing}", f"facing {facts.facing}"] if facts.facing else ends
    return [""]


def _moves(pool: _Pool, facts: Facts) -> list[str]:
    """Verbs for how the player gets on, by speed."""
    ground = facts.shares.get("walk", 0.0) + facts.shares.get("sprint", 0.0)
    if facts.speed > FAST and ground > 0.9:
        return [pool.one(*RUNS), pool.one(*RUNS), "moves fast", "moves quickly", "goes at full speed"]
    if facts.most_speed < FAST - 0.3 and facts.speed > 0.8 and ground > 0.9:
        slowly = ["moves slowly"] if facts.most_speed < 2.2 else []
        return [pool.one(*WALKS), pool.one(*WALKS), "moves", "goes", *slowly]
    return ["moves", "goes", "advances", "proceeds"]


def _jump(pool: _Pool, facts: Facts) -> None:
    turning = _turning(pool, facts)
    if facts.on_the_spot and float(np.linalg.norm(facts.moved)) < 0.1:
        end = pool.one(*turning)
        pool.add(
            f"jumps {end}",
            f"jumps on the spot {end}",
            f"jumps in place {end}",
            f"hops {end}",
            f"leaps into the air {end}",
        )
        return
    fast = "fast " if facts.speed > FAST else ""
    if facts.landed_by == "jump" and facts.landed_on >= 0:
        for verb in ("jumps on", "jumps onto", "leaps onto", "hops onto", "jumps and lands on"):
            pool.add(f"{verb} {pool.name(facts.landed_on)}")
        pool.add(f"jumps on {pool.name(facts.landed_on)} {pool.one(*turning)}")
    elif facts.nears >= 0:
        for way in ("to", "towards", "in the direction of"):
            pool.add(f"{pool.one('jumps', 'leaps', 'bounds')} {way} {pool.name(facts.nears)}")
    if facts.gap:
        pool.add("jumps over the gap", "jumps across the empty space", "leaps over the void")
    if facts.direction:
        to = facts.direction
        pool.add(
            f"moves {fast}{to}, jumps {pool.one(*turning)}",
            f"jumps {to} {pool.one(*turning)}",
            f"jumps while moving {fast}{to}",
            f"leaps {to}",
            f"heads {to} and jumps",
        )


def _land(pool: _Pool, facts: Facts) -> None:
    end = pool.one(*_turning(pool, facts))
    if facts.landed_on >= 0:
        for verb in ("lands on", "lands on top of", "touches down on", "ends its jump on"):
            pool.add(f"{verb} {pool.name(facts.landed_on)} {end if verb == 'lands on' else ''}")
    elif facts.lands_on_ground:
        pool.add(f"lands on the ground {end}", "comes back to the ground", "touches down on the ground")
    else:
        pool.add(f"lands {end}", "ends its jump", "touches down")
    if facts.direction:
        pool.add(f"moves {facts.direction} and lands")
    pool.add("lands after a jump")


def _in_the_air(pool: _Pool, facts: Facts) -> None:
    end = pool.one(*_turning(pool, facts))
    pool.add(f"is in the air {end}", f"flies through the air {end}", "is in the middle of a jump")
    if facts.direction:
        pool.add(f"moves {facts.direction} through the air", f"flies {facts.direction}")


def _fall(pool: _Pool, facts: Facts) -> None:
    end = pool.one(*_turning(pool, facts))
    if facts.landed_by == "fall" and facts.landed_on >= 0:
        for verb in ("falls on", "falls onto", "drops onto", "falls down on", "drops down to"):
            pool.add(f"{verb} {pool.name(facts.landed_on)}")
        pool.add(f"falls on {pool.name(facts.landed_on)} {end}")
    elif facts.landed_by == "fall" and facts.lands_on_ground:
        pool.add(
            "falls to the ground", f"falls on the ground {end}", "drops to the ground", "falls down to ground level"
        )
    pool.add(f"falls {end}", f"falls down {end}", "drops to a lower level", "falls off the edge")
    if facts.direction:
        pool.add(f"moves {facts.direction} and falls {end}", f"falls while moving {facts.direction}")


def _climb(pool: _Pool, facts: Facts, way: str) -> None:
    for end in _turning(pool, facts):
        pool.add(f"climbs {way} {end}")
    pool.add(f"climbs {way} the ladder", f"goes {way} the ladder", f"moves {way} along the ladder")
    pool.add(*(("ascends", "ascends the ladder") if way == "up" else ("descends", "descends the ladder")))
    if way == "up" and facts.climbs_to >= 0:
        pool.add(
            f"climbs up to {pool.name(facts.climbs_to)}",
            f"climbs towards the top of {pool.name(facts.climbs_to)}",
            f"climbs the ladder of {pool.name(facts.climbs_to)}",
        )
    if way == "down" and facts.landed_by == "climb_down" and facts.lands_on_ground:
        pool.add("climbs down to the ground", "reaches the ground by the ladder")


def _rest(pool: _Pool, facts: Facts) -> None:
    if abs(facts.turned) > LEAST_TURN:
        sense = "counterclockwise" if facts.turned > 0 else "clockwise"
        pool.add(
            f"rotates {sense}",
            f"turns {sense} on the spot",
            f"rotates {sense} without moving",
            f"does not move and rotates {sense}",
            f"spins {sense}" if abs(facts.turned) > np.radians(120) else f"stands and turns {sense}",
        )
        if abs(facts.turned) > np.radians(150):
            pool.add("turns around")
        if facts.facing:
            pool.add(f"turns to face {facts.facing}", f"rotates {sense} until facing {facts.facing}")
        return
    if facts.turn_range > NO_TURN:
        pool.add("stands in place", "does not move", "stays where it is", "remains at the same place")
        if abs(facts.turned) > SLIGHT_TURN:
            sense = "counterclockwise" if facts.turned > 0 else "clockwise"
            pool.add(f"rotates slightly {sense}", f"turns a little {sense}")
        return
    pool.add(*STANDS, "pauses for a moment")
    if facts.facing:
        pool.add(
            f"stands facing {facts.facing}", f"looks {facts.facing} and waits", f"does nothing, facing {facts.facing}"
        )
    if facts.stands_on >= 0:
        name = pool.name(facts.stands_on)
        pool.add(f"stands on {name}", f"waits on {name}", f"stays on top of {name}", f"does nothing on {name}")


def _travel(pool: _Pool, facts: Facts) -> None:
    turning = _turning(pool, facts)
    verbs = _moves(pool, facts)
    if facts.nears >= 0:
        for verb in verbs[:3]:
            pool.add(f"{verb} {pool.one('to', 'to', 'towards', 'in the direction of')} {pool.name(facts.nears)}")
        if pool.world.elements[facts.nears].kind != "stairs":
            pool.add(f"{verbs[0]} to {pool.name(facts.nears)} {pool.one(*turning)}")
        if facts.away < 0.01:
            pool.add(f"reaches {pool.name(facts.nears)}", f"arrives at {pool.name(facts.nears)}")
        elif facts.away > 3.0:
            pool.add(f"heads for {pool.name(facts.nears)}", f"goes in the direction of {pool.name(facts.nears)}")
        else:
            pool.add(f"approaches {pool.name(facts.nears)}", f"gets close to {pool.name(facts.nears)}")
    if facts.direction:
        to = facts.direction
        pool.add(
            f"{pool.one(*verbs)} {to}",
            f"{pool.one(*verbs)} {to} {pool.one(*turning)}",
            f"{pool.one(*verbs)} {to} {pool.one(*turning)}",
            f"heads {to}",
            f"keeps moving {to} {pool.one(*turning)}",
        )
        if facts.stands_on >= 0:
            where = {"bridge": "over", "stairs": "along"}.get(pool.world.elements[facts.stands_on].kind, "on")
            pool.add(f"{pool.one(*verbs)} {to} {where} {pool.name(facts.stands_on)}")
        elif facts.at_edge:
            pool.add(f"{pool.one(*verbs)} {to} along the edge of the map")
    else:
        pool.add(f"{pool.one(*verbs)} a short distance {pool.one(*turning)}")
    if facts.rise > 0.4:
        pool.add(f"{pool.one('goes up', 'moves up')} the steps", "steps up to a higher level")
    if facts.rise < -0.4:
        pool.add(f"{pool.one('goes down', 'moves down')} the steps", "steps down to a lower level")


def _plain(pool: _Pool, facts: Facts) -> None:
    """Sentences that are always true of a span with any motion."""
    end = pool.one(*_turning(pool, facts))
    if float(np.linalg.norm(facts.moved)) > 0.1:
        pool.add(f"moves {end}", f"is moving {end}", "changes its position", "is on its way")
    else:
        pool.add(f"stays nearly in place {end}", f"hardly moves {end}", "stays around the same place")
