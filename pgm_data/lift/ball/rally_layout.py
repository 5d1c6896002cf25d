"""Where each unknown of a rally's fit stands in the vector of all of them.

A rally is contacts with flights between them. Unknowns: at each contact its position, the velocity before and after it,
and its time; in each flight its spin and the states of its nodes; and the rally's drag, restitution and friction.
Positions are shared by the flights that meet at a contact, so no constraint is needed to join them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int

from pgm_data.lift.ball.flight_model import AirLaw


@dataclass(frozen=True)
class RallyPattern:
    """What the fit's functions depend on: a key, so rallies of one pattern share them."""

    nodes: tuple[int, ...]
    """Nodes in each flight, its contacts not counted."""
    bounces: tuple[bool, ...]
    """Which contacts between flights are bounces: one less than flights."""
    marks: bool
    """Whether any contact may have a ground mark."""
    between: int
    """Frames after each node that are reached from it, and are no node."""
    steps: int
    """Integrator steps an interval."""
    law: AirLaw

    @property
    def flights(self) -> int:
        """Number of flights."""
        return len(self.nodes)


@dataclass(frozen=True, eq=False, kw_only=True)
class RallyLayout:
    """Places of a pattern's unknowns in their vector."""

    pattern: RallyPattern

    @property
    def contacts(self) -> int:
        """Number of contacts, first and last among them."""
        return self.pattern.flights + 1

    @cached_property
    def position(self) -> Int[np.ndarray, "contacts 3"]:
        """Of the contacts."""
        return np.arange(3 * self.contacts).reshape(-1, 3)

    @cached_property
    def after(self) -> Int[np.ndarray, "flights 3"]:
        """Velocities just after the contact that starts each flight."""
        return self.position.size + np.arange(3 * self.pattern.flights).reshape(-1, 3)

    @cached_property
    def before(self) -> Int[np.ndarray, "flights 3"]:
        """Velocities just before the contact that ends each flight."""
        return self.after[-1, -1] + 1 + np.arange(3 * self.pattern.flights).reshape(-1, 3)

    @cached_property
    def spin(self) -> Int[np.ndarray, "flights 3"]:
        """Of the flights."""
        return self.before[-1, -1] + 1 + np.arange(3 * self.pattern.flights).reshape(-1, 3)

    @cached_property
    def time(self) -> Int[np.ndarray, " contacts"]:
        """Of the contacts."""
        return self.spin[-1, -1] + 1 + np.arange(self.contacts)

    @cached_property
    def drag(self) -> int:
        """The rally's drag."""
        return int(self.time[-1]) + 1

    @property
    def restitution(self) -> int:
        """The rally's restitution."""
        return self.drag + 1

    @property
    def friction(self) -> int:
        """The rally's friction."""
        return self.drag + 2

    @cached_property
    def node(self) -> Int[np.ndarray, "nodes 6"]:
        """States of the nodes, flight after flight."""
        return self.drag + 3 + np.arange(6 * sum(self.pattern.nodes)).reshape(-1, 6)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.drag + 3 + 6 * sum(self.pattern.nodes)

    @cached_property
    def node_flight(self) -> Int[np.ndarray, " nodes"]:
        """The flight of each node."""
        return np.repeat(np.arange(self.pattern.flights), self.pattern.nodes)

    @cached_property
    def _chains(self) -> list[np.ndarray]:
        ends = np.cumsum(self.pattern.nodes)
        chains = []
        for flight, (stop, count) in enumerate(zip(ends, self.pattern.nodes, strict=True)):
            first = np.concatenate([self.position[flight], self.after[flight]])
            last = np.concatenate([self.position[flight + 1], self.before[flight]])
            chains.append(np.concatenate([[first], self.node[stop - count : stop], [last]]))
        return chains

    @cached_property
    def interval_from(self) -> Int[np.ndarray, "intervals 6"]:
        """State that starts each interval between neighbouring nodes or contacts."""
        return np.concatenate([chain[:-1] for chain in self._chains])

    @cached_property
    def interval_to(self) -> Int[np.ndarray, "intervals 6"]:
        """State that ends each interval."""
        return np.concatenate([chain[1:] for chain in self._chains])

    @cached_property
    def interval_flight(self) -> Int[np.ndarray, " intervals"]:
        """The flight of each interval."""
        return np.repeat(np.arange(self.pattern.flights), np.array(self.pattern.nodes) + 1)

    @cached_property
    def interval_times(self) -> Int[np.ndarray, "intervals 2"]:
        """Start and end time of each interval, as places in (contact times, node times)."""
        stops = np.cumsum(self.pattern.nodes)
        rows = []
        for flight, (stop, count) in enumerate(zip(stops, self.pattern.nodes, strict=True)):
            own = self.contacts + np.arange(stop - count, stop)
            chain = np.concatenate([[flight], own, [flight + 1]])
            rows.append(np.stack([chain[:-1], chain[1:]], axis=1))
        return np.concatenate(rows)

    @cached_property
    def bounce(self) -> Int[np.ndarray, " bounces"]:
        """Contacts that are bounces."""
        return 1 + np.flatnonzero(self.pattern.bounces)

    @cached_property
    def bounce_unknowns(self) -> Int[np.ndarray, "bounces 14"]:
        """What the bounce law reads: velocity before and after, spin before and after, restitution, friction."""
        k = self.bounce
        shared = np.broadcast_to([self.restitution, self.friction], (len(k), 2))
        return np.concatenate([self.before[k - 1], self.after[k], self.spin[k - 1], self.spin[k], shared], axis=1)
