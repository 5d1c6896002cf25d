"""Rallies that are made while somebody waits: one at a time in a thread, with progress, to be cancelled at any time."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_models.animation.play_camera import PlayCamera

KEPT = 12
"""Most rallies that are kept; the oldest goes when another comes."""


class RallyError(ValueError):
    """What was asked for cannot be; says why, for the reader."""


class BusyError(RallyError):
    """Another rally is being made."""


class UnknownRallyError(RallyError):
    """There is no rally of that name."""


class CancelledError(Exception):
    """Whoever asked for the rally wants it no longer."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rally:
    """States of a scene over time, as somebody asked for them."""

    prompt: Mapping[str, object]
    """Document of the schema `prompt` that it was made from."""
    rate: float
    """Frames a second."""
    columns: Mapping[str, Float[np.ndarray, "frames _"]]
    """Of the contract, in its units."""
    view: PlayCamera | None
    """Usual camera of every frame; None where the scene has none."""
    notes: tuple[str, ...]
    """What was done to it, a line each."""
    warnings: tuple[str, ...]
    """What is doubtful about it, a line each."""

    def __post_init__(self) -> None:
        """Raise ValueError where columns differ in length, or there is no frame."""
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) != 1 or 0 in lengths.values():
            raise ValueError(f"columns: expected one length, of 1 frame or more, got {lengths}")

    @property
    def frames(self) -> int:
        """How many."""
        return len(next(iter(self.columns.values())))

    def state(self, frame: int) -> dict[str, Float[np.ndarray, " numbers"]]:
        """The columns' numbers of one frame.

        Raises:
            RallyError: If there is no such frame.
        """
        if not 0 <= frame < self.frames:
            raise RallyError(f"frame: expected 0 to {self.frames - 1}, got {frame}")
        return {name: values[frame] for name, values in self.columns.items()}


Say = Callable[[float, str], None]
"""Told what share of a rally is made, 0 to 1, and what is being done; raises CancelledError to end it."""
MakeRally = Callable[[object, Say], Rally]
"""A rally from a document of the schema `prompt`; raises ValueError in words for the reader where it cannot be."""
RallyState = Literal["waiting", "making", "done", "failed", "cancelled"]


@dataclass(frozen=True, kw_only=True)
class RallyProgress:
    """How far a rally is."""

    state: RallyState
    share: float
    """Of what is to be done, 0 to 1."""
    words: str
    """What is being done, or why it failed."""


@dataclass(eq=False, kw_only=True)
class _Order:
    """One rally that somebody asked for. Its lock guards what changes."""

    progress: RallyProgress
    rally: Rally | None = None
    cancelled: threading.Event = field(default_factory=threading.Event)


class RallyDesk:
    """Takes prompts and hands out rallies; any thread may call it."""

    def __init__(self, make: MakeRally) -> None:
        self._make = make
        self._orders: OrderedDict[str, _Order] = OrderedDict()
        self._lock = threading.Lock()
        self._maker = threading.Lock()
        """Held by whoever uses the model."""
        self._count = 0

    def order(self, document: object) -> str:
        """Begin a rally; its name.

        Raises:
            BusyError: If another one is being made and was not cancelled.
        """
        with self._lock:
            busy = [name for name, order in self._orders.items() if order.progress.state in ("waiting", "making")]
            if busy:
                raise BusyError("a rally is being made already: expected to wait for it, or to cancel it first")
            self._count += 1
            name = str(self._count)
            order = _Order(progress=RallyProgress(state="waiting", share=0.0, words="waiting for the model"))
            self._orders[name] = order
            while len(self._orders) > KEPT:
                self._orders.popitem(last=False)
        threading.Thread(target=self._carry_out, args=(order, document), name=f"rally {name}", daemon=True).start()
        return name

    def progress(self, name: str) -> RallyProgress:
        """How far the rally is.

        Raises:
            UnknownRallyError: If there is none of that name.
        """
        with self._lock:
            return self._order(name).progress

    def cancel(self, name: str) -> RallyProgress:
        """End the making of the rally; one that has ended stays as it is.

        Raises:
            UnknownRallyError: If there is none of that name.
        """
        with self._lock:
            order = self._order(name)
            if order.progress.state in ("waiting", "making"):
                order.cancelled.set()
                order.progress = RallyProgress(state="cancelled", share=order.progress.share, words="cancelled")
            return order.progress

    def rally(self, name: str) -> Rally:
        """The rally.

        Raises:
            UnknownRallyError: If there is none of that name.
            RallyError: If it is not there, or not yet.
        """
        with self._lock:
            order = self._order(name)
            if order.rally is None:
                raise RallyError(f"rally {name}: expected one that is done, got one that is {order.progress.state}")
            return order.rally

    def close(self) -> None:
        """End whatever is being made."""
        with self._lock:
            for order in self._orders.values():
                order.cancelled.set()

    def _order(self, name: str) -> _Order:
        if name not in self._orders:
            expected = ", ".join(self._orders) or "none, as none was made"
            raise UnknownRallyError(f"rally: expected one of {expected}, got {name[:40]!r}")
        return self._orders[name]

    def _carry_out(self, order: _Order, document: object) -> None:
        """Make the rally as soon as the model is free. One that was cancelled may still hold it for a moment."""

        def say(share: float, words: str) -> None:
            if order.cancelled.is_set():
                raise CancelledError
            with self._lock:
                if order.progress.state != "cancelled":
                    order.progress = RallyProgress(state="making", share=min(max(share, 0.0), 1.0), words=words)

        rally, ended = None, RallyProgress(state="cancelled", share=0.0, words="cancelled")
        try:
            with self._maker:
                say(0.0, "reading the prompt")
                rally = self._make(document, say)
                ended = RallyProgress(state="done", share=1.0, words="done")
        except CancelledError:
            pass
        except ValueError as error:
            ended = RallyProgress(state="failed", share=0.0, words=str(error))
        except Exception as error:  # whatever a model raises: the reader is told, and the server goes on
            ended = RallyProgress(state="failed", share=0.0, words=f"{type(error).__name__}: {error}")
        with self._lock:
            if order.progress.state != "cancelled":
                order.progress = ended
                order.rally = rally
