"""Decoded pictures kept in memory, up to a bound in bytes."""

import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path

import numpy as np

CACHE_BYTES = 128 * 2**20
"""Of pictures that a cache keeps unless told otherwise."""


class PictureCache:
    """The pictures last used, of one video or of several, as many as fit into so many bytes.

    Threads may share it; another process, forked or unpickled, begins with an empty one of the same size.
    """

    def __init__(self, limit_bytes: int = CACHE_BYTES) -> None:
        """An empty cache; of 0 bytes it keeps nothing."""
        if limit_bytes < 0:
            raise ValueError(f"limit_bytes: expected 0 or more, got {limit_bytes}")
        self.limit_bytes = limit_bytes
        self._renew()

    def _renew(self) -> None:
        self._process, self._lock = os.getpid(), threading.Lock()
        self._pictures: OrderedDict[Hashable, np.ndarray] = OrderedDict()
        self._bytes = 0

    @property
    def used_bytes(self) -> int:
        """Of the pictures in it."""
        return self._bytes

    def __len__(self) -> int:
        """Pictures in it."""
        return len(self._pictures)

    def find(self, key: Hashable) -> np.ndarray | None:
        """The picture kept under the key, which is then the one last used; None where there is none."""
        if self._process != os.getpid():
            self._renew()
        with self._lock:
            if key in self._pictures:
                self._pictures.move_to_end(key)
            return self._pictures.get(key)

    def keep(self, key: Hashable, picture: np.ndarray) -> None:
        """Keep the picture, which nobody may change any more, and drop those not used for longest."""
        if self._process != os.getpid():
            self._renew()
        with self._lock:
            if key in self._pictures or picture.nbytes > self.limit_bytes:
                return
            self._pictures[key] = picture
            self._bytes += picture.nbytes
            while self._bytes > self.limit_bytes:
                self._bytes -= self._pictures.popitem(last=False)[1].nbytes

    def keep_where_room(self, key: Hashable, nbytes: int, make: Callable[[], np.ndarray]) -> None:
        """Keep what `make` returns, unless it is there or something would have to be dropped for it."""
        if self._bytes + nbytes <= self.limit_bytes and key not in self._pictures:
            self.keep(key, make())

    def __reduce__(self) -> tuple:
        return PictureCache, (self.limit_bytes,)


def picture_key(path: Path, number: int, size: tuple[int, int]) -> Hashable:
    """What a cache keeps that frame of a video under, in that width and height."""
    return str(path), number, size
