"""The steps of a demo: said before, timed after, and the commands that do the same remembered."""

import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pgm_data.stages.demo_report import DemoStep


class DemoSteps:
    """What a demo has done so far."""

    def __init__(self) -> None:
        self.done: list[DemoStep] = []
        self._commands: list[str] = []

    @contextmanager
    def step(self, number: int, title: str) -> Iterator[None]:
        """Say that a step begins, and how long it took when it ends."""
        from pgm_data.stages.demo_report import DemoStep
        from pgm_data.stages.report_parts import duration

        print(f"{number}. {title}", flush=True)
        self._commands, begun = [], time.monotonic()
        yield
        seconds = time.monotonic() - begun
        self.done.append(DemoStep(number=number, title=title, seconds=seconds, commands=tuple(self._commands)))
        print(f"   {duration(seconds)}", flush=True)

    def run(self, name: str, main: Callable[[list[str]], int], words: Sequence[object]) -> int:
        """Run a command of that name with those words; its exit code."""
        argv = [str(word) for word in words]
        self.note([*name.split(), *argv])
        return main(argv)

    def note(self, words: Sequence[object]) -> None:
        """Remember the words of a command that is run in another way."""
        self._commands.append(shlex.join(str(word) for word in words))
