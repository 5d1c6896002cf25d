"""Names of what stands in a world: each phrase is true of one thing only."""

from dataclasses import dataclass

import numpy as np

from pgm_data.simulate.blocks.world import Element, ElementKind

COMPASS = ("north", "north east", "east", "south east", "south", "south west", "west", "north west")
"""By eighths of a turn, clockwise from +y."""


@dataclass(eq=False)
class Draft:
    """A thing before it has names."""

    kind: ElementKind
    material: str
    columns: list[tuple[int, int]]
    levels: list[int]
    leads_to: "Draft | None" = None
    """Of stairs: the platform."""
    has_ladder: bool = False
    rank: str = ""
    """Of the pillars in a row: low, intermediate, high."""

    @property
    def middle(self) -> np.ndarray:
        """World x, y."""
        return np.mean(self.columns, axis=0) + 0.5 - 8.0


def bearing(towards: np.ndarray) -> float:
    """Eighths of a turn clockwise from north of a direction (x, y), 0 to 8."""
    return float(np.arctan2(towards[0], towards[1]) / (np.pi / 4) % 8)


def named(drafts: list[Draft]) -> tuple[Element, ...]:
    """The things with all names that fit no other of them; the first is the plainest."""
    phrases = [_phrases(draft, drafts) for draft in drafts]
    count: dict[str, int] = {}
    for own in phrases:
        for phrase in own:
            count[phrase] = count.get(phrase, 0) + 1
    elements = []
    for draft, own in zip(drafts, phrases, strict=True):
        names = tuple(p for p in own if count[p] == 1)
        if names:
            elements.append(
                Element(
                    kind=draft.kind,
                    material=draft.material,
                    columns=np.array(draft.columns),
                    levels=np.array(draft.levels),
                    names=names,
                )
            )
    return tuple(elements)


def _phrases(draft: Draft, drafts: list[Draft]) -> list[str]:
    """All that can be said of a thing, whether or not it fits others too."""
    alike = [d for d in drafts if d.kind == draft.kind]
    kind, word = draft.kind, draft.material
    if kind == "platform":
        return _of_platform(draft, alike, drafts)
    if kind == "pillar":
        phrases = [f"{draft.rank} {word} pillar"] if draft.rank else [f"{word} pillar", f"column of {_matter(word)}"]
        phrases += {"low": ["first wooden pillar"], "high": ["last wooden pillar"]}.get(draft.rank, [])
        phrases += ["middle wooden pillar"] if draft.rank == "intermediate" else []
        phrases += _extreme(draft, alike, "tallest pillar", "shortest pillar")
        if draft.has_ladder and sum(d.has_ladder for d in alike) == 1:
            phrases.append("pillar with the ladder")
        return phrases + _sided(draft, alike)
    if kind == "block":
        near = [f"block at the {side} edge of the map" for side in _edges(draft)]
        return [f"{word} decorated block", f"{word} block", f"{word} cube"] + near + _sided(draft, alike)
    if kind == "stairs":
        goal = draft.leads_to
        leading = [f"stairs leading to the {goal.material} platform"] if goal is not None else []
        return ["stairs", *leading, "stone steps"]
    return ["bridge", "wooden bridge", "bridge between the platforms"]


def _matter(word: str) -> str:
    return {"wooden": "wood", "dark": "dark wood", "birch": "birch wood"}.get(word, word)


def _of_platform(draft: Draft, alike: list[Draft], drafts: list[Draft]) -> list[str]:
    word = draft.material
    sizes = [len(d.columns) for d in alike]
    phrases = [f"{word} platform"]
    if sizes.count(len(draft.columns)) == 1 and len(draft.columns) == max(sizes):
        phrases = [f"big {word} platform", f"{word} platform", "largest platform", f"wide {word} platform"]
    if sizes.count(len(draft.columns)) == 1 and len(draft.columns) == min(sizes):
        phrases = [f"small {word} platform", f"{word} platform", "smallest platform", f"little {word} platform"]
    phrases += _extreme(draft, alike, "highest platform", "lowest platform")
    stairs = [d for d in drafts if d.kind == "stairs"]
    if len(stairs) == 1:
        if stairs[0].leads_to is draft:
            phrases += ["platform next to the stairs", "platform with the stairs"]
        else:
            here, there = draft.middle, stairs[0].middle
            cosine = here @ there / max(float(np.linalg.norm(here) * np.linalg.norm(there)), 1e-9)
            phrases += ["platform opposite to the stairs"] if cosine < -0.5 else []
    if draft.has_ladder and sum(d.has_ladder for d in alike) == 1:
        phrases += ["platform with the ladder"]
    return phrases + _sided(draft, alike)


def _extreme(draft: Draft, alike: list[Draft], most: str, least: str) -> list[str]:
    tops = [max(d.levels) for d in alike]
    own = max(draft.levels)
    if len(tops) < 2 or tops.count(own) > 1:
        return []
    return [most] if own == max(tops) else [least] if own == min(tops) else []


def _sided(draft: Draft, alike: list[Draft]) -> list[str]:
    """Where it lies among its like, where it is clearly on that side and the only one there."""
    if float(np.linalg.norm(draft.middle)) < 3.0 or len(alike) < 2:
        return []
    eighth = bearing(draft.middle)
    nearest = round(eighth) % 8
    if abs((eighth - nearest + 4) % 8 - 4) > 0.4:
        return []
    others = [abs((bearing(d.middle) - nearest + 4) % 8 - 4) for d in alike if d is not draft]
    side = COMPASS[nearest]
    return [f"{draft.kind} in the {side}", f"{draft.kind} on the {side} side"] if min(others) > 0.75 else []


def _edges(draft: Draft) -> list[str]:
    i, j = draft.columns[0]
    sides = {"west": i, "east": 15 - i, "south": j, "north": 15 - j}
    return [side for side, far in sides.items() if far <= 1]
