"""A text that is being read, and the world that it is held against."""

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pgm_data.simulate.tennis.play import Play, Shot, Stroke


@dataclass
class Said:
    """A text in work: what is left of it, and what was wrong."""

    left: str
    play: Play
    player: int
    start: float
    end: float
    wrong: list[str] = field(default_factory=list)
    claims: list[tuple[str, Any]] = field(default_factory=list)

    def cut(self, pattern: str) -> re.Match[str] | None:
        """Cross out the first match."""
        match = re.search(rf"(?<![\w'-])(?:{pattern})(?![\w'-])", self.left)
        if match:
            self.left = self.left[: match.start()] + "_" * len(match.group()) + self.left[match.end() :]
        return match

    def all(self, pattern: str) -> list[re.Match[str]]:
        """Cross out every match."""
        found = []
        while match := self.cut(pattern):
            found.append(match)
        return found

    def must(self, holds: bool, what: str) -> None:
        if not holds:
            self.wrong.append(what)


class World:
    """What is true of the player, told in the player's own frame: x to the right, y ahead."""

    def __init__(self, play: Play, player: int) -> None:
        self.play, self.player, self.sign = play, player, (1.0 if player == 0 else -1.0)
        path = play.plans[player].path * self.sign
        self.x, self.y, self.t = path[:, 0], path[:, 1], play.plans[player].times
        self.speed = np.hypot(np.gradient(self.x), np.gradient(self.y)) * 50 if len(path) > 1 else np.zeros(len(path))

    def piece(self, start: float, end: float) -> slice:
        a = min(int(round(start * 50)), len(self.t) - 2)
        return slice(a, max(min(int(round(end * 50)), len(self.t) - 1), a + 1) + 1)

    def strokes(self, player: int, start: float, end: float) -> list[tuple[Stroke, Shot | None]]:
        shots = {shot.stroke: shot for shot in self.play.shots}
        return [
            (s, shots.get(i)) for i, s in enumerate(self.play.strokes) if s.player == player and start <= s.time < end
        ]

    def previous(self, time: float) -> Stroke | None:
        """Who hit the ball last before a time."""
        return next((s for s in reversed(self.play.strokes) if s.hit and s.time < time), None)

    @property
    def last(self) -> Shot:
        return max(self.play.shots, key=lambda shot: shot.stroke)

    @property
    def serve(self) -> Stroke:
        return next(s for s in self.play.strokes if s.kind == "serve")

    def decided(self) -> float:
        """When the last shot is seen to have ended the play."""
        contacts = self.play.ball.contacts[self.last.contact + 1 :]
        ground = [c.time for c in contacts if c.kind == "bounce"]
        net = [c.time for c in contacts if c.kind == "net"]
        if self.last.result == "net":
            return min(net + ground)
        if self.last.result == "in":
            return ground[1] if len(ground) > 1 else contacts[-1].time
        return ground[0] if ground else contacts[-1].time
