"""The rules of the count: points, games, tie-breaks, sets, who serves, from which court and from which end."""

from dataclasses import dataclass, replace

from pgm_data.simulate.tennis.play import Score

_POINTS = ("0", "15", "30", "40")


@dataclass(frozen=True, eq=False, kw_only=True)
class Count:
    """Where a best-of-three match stands before a serve; players are 0 and 1 as in the match, whatever their end."""

    sets: tuple[tuple[int, int], ...]
    """Games of every set, the running one last."""
    points: tuple[int, int]
    """Points won in the running game or tie-break."""
    first_server: int
    """Who serves the running game, or the first point of the running tie-break."""
    near: int
    """Who plays at the near end."""
    second_serve: bool

    @property
    def tie_break(self) -> bool:
        """Whether the running game is a tie-break."""
        return self.sets[-1] == (6, 6)

    @property
    def server(self) -> int:
        """Who serves now; in a tie-break one point, then two in turn."""
        if self.tie_break and (sum(self.points) + 1) // 2 % 2:
            return 1 - self.first_server
        return self.first_server

    @property
    def right_court(self) -> bool:
        """Whether the serve comes from the server's right half, as for every even point."""
        return sum(self.points) % 2 == 0

    @property
    def set_points_won(self) -> tuple[int, int]:
        """Sets that each has won."""
        won = [0, 0]
        for games in self.sets:
            if set_is_over(games):
                won[games[1] > games[0]] += 1
        return won[0], won[1]

    @property
    def finished(self) -> bool:
        """Whether somebody has won two sets."""
        return max(self.set_points_won) == 2

    def score(self) -> Score:
        """The count as it is called."""
        a, b = self.points
        if self.tie_break:
            return Score(sets=self.sets, points=(str(a), str(b)))
        if min(a, b) >= 3:
            names = ("AD", "40") if a > b else ("40", "AD") if b > a else ("40", "40")
            return Score(sets=self.sets, points=names)
        return Score(sets=self.sets, points=(_POINTS[a], _POINTS[b]))


def new_match(*, first_server: int, near: int) -> Count:
    """The count before the first serve."""
    return Count(sets=((0, 0),), points=(0, 0), first_server=first_server, near=near, second_serve=False)


def set_is_over(games: tuple[int, int]) -> bool:
    """Whether a set of these games is won: six with two ahead, or 7-6 or 7-5."""
    high, low = max(games), min(games)
    return high == 7 or (high == 6 and high - low >= 2)


def after_fault(count: Count) -> Count:
    """The count after a first serve that failed."""
    return replace(count, second_serve=True)


def after_point(count: Count, winner: int) -> Count:
    """The count after player `winner` (0 or 1 of the match) wins a point; of a finished match, no serve follows."""
    points = (count.points[0] + (winner == 0), count.points[1] + (winner == 1))
    ahead = abs(points[0] - points[1])
    if max(points) < (7 if count.tie_break else 4) or ahead < 2:
        changed = count.tie_break and sum(points) % 6 == 0
        near = 1 - count.near if changed else count.near
        return replace(count, points=points, near=near, second_serve=False)
    games = count.sets[-1]
    games = (games[0] + (winner == 0), games[1] + (winner == 1))
    sets = (*count.sets[:-1], games)
    if set_is_over(games) and not replace(count, sets=sets).finished:
        sets = (*sets, (0, 0))
    # Ends change after every odd game of a set, a tie-break counting as one.
    near = 1 - count.near if sum(games) % 2 else count.near
    return Count(sets=sets, points=(0, 0), first_server=1 - count.first_server, near=near, second_serve=False)
