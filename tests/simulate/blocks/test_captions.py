"""Captions are read anew here, word by word, and held against the states alone: positions, headings, blocks."""

import re

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.simulate.blocks.shots import blocks_shots

RATE = 100.0
COMPASS = {
    "north": 0,
    "north east": 45,
    "east": 90,
    "south east": 135,
    "south": 180,
    "south west": 225,
    "west": 270,
    "north west": 315,
}
DIRECTION = r"(north east|north west|south east|south west|north|south|east|west)"


class Reading:
    """What the states of one shot say between two times."""

    def __init__(self, shot, start, end):
        times = np.arange(len(shot)) / RATE
        self.inside = (times >= start - 1e-9) & (times <= end + 1e-9)
        player = shot.states.players[0]
        soles = player.hull_centres.min(axis=1)[:, 2]
        self.all_feet = np.column_stack([player.joints[:, 0, :2], soles])
        self.feet = self.all_feet[self.inside]
        # A landing that ends the span is seen one sample later.
        self.touched = self.all_feet[(times >= start - 0.015) & (times <= end + 0.015)]
        ahead = player.rotations[:, 0, :, 2]
        self.heading = np.degrees(np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 1])))[self.inside]
        self.after = self.all_feet[(times >= start) & (times <= end + 5.0)]
        self.cut_short = times[-1] < end + 5.0
        step = np.diff(self.all_feet, axis=0) * RATE
        fall = np.abs(np.diff(step[:, 2]) * RATE + 28.0) < 1.5
        flies = np.zeros(len(times), dtype=bool)
        flies[1:-1] = fall
        self.flies = flies[self.inside]
        self.vertical = np.append(step[:, 2], 0.0)[self.inside]
        self.speeds = np.linalg.norm(step[:, :2], axis=1)
        self.speeds = np.append(self.speeds, 0.0)[self.inside][:-1]
        self.lands = bool((flies[:-1] & ~flies[1:])[self.inside[:-1]].any())

    @property
    def moved(self):
        return self.feet[-1, :2] - self.feet[0, :2]

    def jumps(self):
        return bool((self.flies & (self.vertical > 1.0)).any())

    def falls(self):
        return bool((self.flies & (self.vertical < -1.0)).any()) and self.feet[:, 2].max() - self.feet[:, 2].min() > 0.3

    def climbs(self, speed):
        steady = (np.abs(self.vertical - speed) < 0.05) & ~self.flies
        return steady.sum() > 8


def columns(element):
    return [(c, level * 0.5) for c, level in zip(element.columns.tolist(), element.levels.tolist(), strict=True)]


def ever_on(feet, element):
    return any(
        ((np.floor(feet[:, :2] + 8) == c).all(axis=1) & (np.abs(feet[:, 2] - top) < 1e-3)).any()
        for c, top in columns(element)
    )


def gap_to(point, element):
    low = element.columns - 8.0
    away = np.maximum(np.maximum(low - point, point - low - 1), 0)
    return np.linalg.norm(away, axis=1).min()


def faults(text, seen: Reading, shot):
    """Everything in a caption that the states deny."""
    found = []

    def claim(true, what):
        if not true:
            found.append(what)

    assert text.startswith("the player ")
    said = text.removeprefix("the player ")
    named = None
    for element in shot.world.elements:
        for name in element.names:
            if re.search(rf"\bthe {name}\b", said) and (named is None or len(name) > len(named[1])):
                named = element, name
    if named is not None:
        said = said.replace(f"the {named[1]}", "X")
        claim("the X" not in said, "two names")
    turned, spread = seen.heading[-1] - seen.heading[0], np.ptp(seen.heading)
    facing = re.search(rf"(?:facing|face|looks) {DIRECTION}", said)
    if facing:
        off = (seen.heading[-1] - COMPASS[facing[1]] + 180) % 360 - 180
        claim(abs(off) < 17, "facing")
        said = said.replace(facing[0], "")
    towards = re.search(rf"\b{DIRECTION}\b", said)
    if towards:
        bearing = np.degrees(np.arctan2(seen.moved[0], seen.moved[1]))
        claim(abs((bearing - COMPASS[towards[1]] + 180) % 360 - 180) < 24, "direction")
        claim(np.linalg.norm(seen.moved) > 0.3, "direction without motion")
    if "counterclockwise" in said:
        claim(turned < -9 if re.search("slightly|little", said) else turned < -23, "counterclockwise")
    elif "clockwise" in said:
        claim(turned > 9 if re.search("slightly|little", said) else turned > 23, "clockwise")
    if re.search("slightly|a little", said):
        claim(abs(turned) < 27, "slightly")
    if re.search("not rotate|without rotating|keeps its direction", said):
        claim(spread < 5, "no rotation")
    if "turns around" in said:
        claim(abs(turned) > 145, "around")
    mean = seen.speeds.mean()
    if re.search(r"\b(runs|sprints|dashes|rushes|fast|quickly|full speed)\b", said):
        claim(mean > 4.6, "fast")
    if re.search(r"\b(walks|strolls|wanders)\b", said):
        claim(seen.speeds.max() < 4.7 and mean > 0.6, "walks")
    if "slowly" in said:
        claim(seen.speeds.max() < 2.6, "slowly")
    if re.search(r"\b(jumps|leaps|hops|bounds)\b", said):
        claim(seen.jumps(), "jumps")
    if re.search(r"in place|on the spot", said) and re.search("jumps|hops", said):
        claim(np.linalg.norm(seen.moved) < 0.15, "on the spot")
    if re.search(r"\b(falls|drops)\b", said):
        claim(seen.falls(), "falls")
    if re.search(r"\b(lands|touches down|ends its jump|comes back to the ground)\b", said):
        claim(seen.lands, "lands")
    if re.search(r"in the air|through the air|middle of a jump|\bflies\b", said):
        claim(seen.flies.any(), "air")
    if re.search(r"\bascends\b|climbs up|climbs the|climbs towards|up the ladder|up along", said):
        claim(seen.climbs(2.35), "up")
    if re.search(r"\bdescends\b|climbs down|down the ladder|down along|by the ladder", said):
        claim(seen.climbs(-3.0), "down")
    still = "nothing|stands|waits|not move|remains|stays in place|stays where|is idle|pauses|without moving|on the spot"
    if re.search(still, said) and not re.search("jumps|hops", said):
        claim(np.ptp(seen.feet[:, :2], axis=0).max() < 0.1, "still")
    if re.search(r"\bthe ground\b|ground level", said) and "lower" not in said:
        claim((np.abs(seen.touched[:, 2]) < 1e-3).any(), "ground")
    if "edge of the map" in said:
        claim((np.abs(seen.feet[:, :2]).max(axis=1) > 6.95).all(), "edge")
    if re.search("up the steps|higher level", said):
        claim(seen.feet[-1, 2] - seen.feet[0, 2] > 0.35, "steps up")
    if re.search("down the steps|lower level", said) and "drops" not in said:
        claim(seen.feet[-1, 2] - seen.feet[0, 2] < -0.35, "steps down")
    if re.search("drops|falls off", said):
        claim(seen.feet[-1, 2] - seen.feet[0, 2] < -0.25, "lower")
    if named is not None:
        element = named[0]
        before, after = gap_to(seen.feet[0, :2], element), gap_to(seen.feet[-1, :2], element)
        if re.search(r"(climbs up to|top of|ladder of) X", said) and "climbs" in said:
            claim(gap_to(seen.feet[-1, :2], element) < 0.55, "climbs beside")
            claim(ever_on(seen.after, element) or seen.cut_short, "climbs to")
        elif re.search(r"\b(reaches|arrives at) X", said):
            claim(after < 0.02 and before > 0.2, "reaches")
        elif re.search(r"\b(on|onto|on top of|over|along|down to) X", said):
            claim(ever_on(seen.touched, element), "on")
        else:
            claim(before - after > 0.25, "towards")
        claim(bool(re.search(r"\b(on|onto|of|to|towards|for|at|over|along|reaches|approaches) X", said)), "how")
    return found


@pytest.fixture(scope="module")
def shots():
    scene = load_scene("blocks")
    return [next(blocks_shots(scene, seed, frames=5000, fps=RATE, size=(64, 36))) for seed in range(3)]


def test_no_caption_contradicts_the_states(shots):
    checked, wrong, kinds = 0, [], set()
    for shot in shots:
        for caption in shot.states.captions:
            seen = Reading(shot, caption.start_s, caption.end_s)
            for text in caption.texts:
                checked += 1
                kinds |= set(text.split())
                wrong += [(text, f, caption.start_s, caption.end_s) for f in faults(text, seen, shot)]
    assert checked > 900
    assert not wrong, f"{len(wrong)} of {checked}: {wrong[:8]}"
    # Everything that can be read above has been said somewhere.
    said = (
        "counterclockwise clockwise jumps falls climbs walks runs stands nothing lands ladder platform pillar".split()
    )
    assert set(said) <= kinds


def test_the_reading_finds_false_words(shots):
    shot = shots[0]
    lies = 0
    for caption in shot.states.captions:
        seen = Reading(shot, caption.start_s, caption.end_s)
        for text in caption.texts:
            swapped = text
            for a, b in (("counterclockwise", "#"), ("clockwise", "counterclockwise"), ("#", "clockwise")):
                swapped = swapped.replace(a, b)
            swapped = re.sub(r"moves (north|south|east|west)$", lambda m: "moves " + OPPOSITE[m[1]], swapped)
            if swapped != text:
                lies += 1
                assert faults(swapped, seen, shot), (swapped, text)
    assert lies > 10


OPPOSITE = {"north": "south", "south": "north", "east": "west", "west": "east"}


def test_captions_cover_the_shot_without_gaps_in_spans_of_half_a_second(shots):
    for shot in shots:
        captions = shot.states.captions
        assert captions[0].start_s == 0.0
        assert captions[-1].end_s == pytest.approx(len(shot) / RATE)
        assert all(a.end_s == b.start_s for a, b in zip(captions, captions[1:], strict=False))
        lengths = np.array([c.end_s - c.start_s for c in captions])
        assert 0.15 < lengths.min() and lengths.max() < 1.5
        assert 0.4 < lengths.mean() < 0.8
        assert all(len(c.texts) >= 3 and len(set(c.texts)) == len(c.texts) for c in captions)


def test_the_words_are_many(shots):
    words = {w for s in shots for c in s.states.captions for t in c.texts for w in re.findall(r"[a-z]+", t)}
    assert len(words) >= 120


def test_a_name_means_one_thing_and_says_the_truth(shots):
    for shot in shots:
        elements = shot.world.elements
        names = [n for e in elements for n in e.names]
        assert len(names) == len(set(names))
        platforms = [e for e in elements if e.kind == "platform"]
        for element in elements:
            for name in element.names:
                others = [e for e in platforms if e is not element]
                if re.search(r"\b(big|largest|wide)\b", name):
                    assert all(len(element.columns) > len(o.columns) for o in others)
                if re.search(r"\b(small|smallest|little)\b", name):
                    assert all(len(element.columns) < len(o.columns) for o in others)
                if "highest" in name:
                    assert all(element.levels.max() > o.levels.max() for o in others)
                if "intermediate" in name or "middle" in name:
                    row = [e for e in elements if e.kind == "pillar" and e.material == "wooden"]
                    assert sorted(e.levels.max() for e in row)[1] == element.levels.max()
                side = re.search(rf"(?:in|on) the {DIRECTION}(?: side)?$", name)
                if side:
                    x, y = element.centre[:2]
                    off = np.degrees(np.arctan2(x, y)) - COMPASS[side[1]]
                    assert abs((off + 180) % 360 - 180) < 22.5
                if "opposite to the stairs" in name:
                    (stairs,) = [e for e in elements if e.kind == "stairs"]
                    assert element.centre[:2] @ stairs.centre[:2] < 0
