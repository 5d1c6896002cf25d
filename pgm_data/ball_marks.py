"""Events that a person marked put in the place of those that were detected."""

import numpy as np

from pgm_data.ball import BallEvents

CONTACTS = ("hit", "bounce", "net")
ORDER = ("first", *CONTACTS, "last")
"""What stands first of events at one time."""


def merge_events(
    detected: BallEvents, human: BallEvents, *, within_s: float, complete_kinds: bool = False
) -> BallEvents:
    """Human events, and the detected ones that they leave standing, in order of time.

    A human contact (hit, bounce, net) removes every detected contact near it, of whatever kind; a human `first` or
    `last` those bounds alone, since a contact may stand beside one. A human hit that names no player takes the name
    from the nearest detected hit that it replaces.

    Args:
        detected: What a program found.
        human: What a person says.
        within_s: How near, s: two frames.
        complete_kinds: Whether the person marked all there is of the kinds that occur in their list; then detected
            events of these kinds go wherever they are.

    Raises:
        ValueError: If `within_s` is negative or not finite.
    """
    if not 0 <= within_s < np.inf:
        raise ValueError(f"within_s: expected 0 or more, got {within_s}")
    if not len(human):
        return detected
    near = np.abs(detected.times[:, None] - human.times) <= within_s * (1 + 1e-9)
    rivals = np.isin(detected.kinds, CONTACTS)[:, None] == np.isin(human.kinds, CONTACTS)
    gone = (near & rivals).any(axis=1)
    if complete_kinds:
        gone |= np.isin(detected.kinds, np.unique(human.kinds.astype(str)))
    players = np.array(human.players, dtype=object)
    named = np.flatnonzero((detected.kinds == "hit") & (detected.players != ""))
    for row in np.flatnonzero((human.kinds == "hit") & (human.players == "")):
        candidates = named[near[named, row]]
        if len(candidates):
            players[row] = detected.players[candidates[np.abs(detected.times[candidates] - human.times[row]).argmin()]]
    kept = detected.take(np.flatnonzero(~gone))
    parts = {
        name: np.concatenate([getattr(kept, name), players if name == "players" else getattr(human, name)])
        for name in ("times", "kinds", "probability", "time_std", "sources", "players", "ground_px")
    }
    rank = np.array([ORDER.index(kind) for kind in parts["kinds"]])
    order = np.lexsort((rank, parts["times"]))
    return BallEvents(**{name: values[order] for name, values in parts.items()})
