"""What a check of files finds: each way in which one misses the contract, with its place."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pgm_data.dataset.document_check import law_faults
from pgm_data.dataset.documents import Fault, document_faults, parse_document
from pgm_data.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Violation:
    """One way in which a file misses the contract."""

    path: Path
    field: str
    """Where in the file; empty for the file itself."""
    expected: str
    found: str

    def __str__(self) -> str:
        """One line, with nothing in it that a terminal would obey."""
        line = f"{self.path}: {self.field + ': ' if self.field else ''}expected {self.expected}, got {self.found}"
        return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in line)


@dataclass(frozen=True, eq=False, kw_only=True)
class Checked:
    """What a check looked at, and what it found."""

    files: tuple[Path, ...]
    violations: tuple[Violation, ...]


@dataclass(eq=False, kw_only=True)
class Findings:
    """Files and violations, as they are found."""

    scene: Scene | None = None
    """Stands in for the scenes that files name."""
    kind: str = ""
    """Of single files whose name does not tell."""
    files: list[Path] = field(default_factory=list)
    violations: list[Violation] = field(default_factory=list)

    def add(self, path: Path, faults: Iterable[Fault]) -> None:
        """Note the faults of a file."""
        self.violations += [Violation(path=path, field=f.field, expected=f.expected, found=f.found) for f in faults]

    def say(self, path: Path, field: str, expected: str, found: str) -> None:
        """Note one violation."""
        self.violations.append(Violation(path=path, field=field, expected=expected, found=found))

    def document(self, path: Path, kind: str) -> dict[str, Any] | None:
        """The document where it holds to its schema; otherwise its faults are noted."""
        self.files.append(path)
        try:
            value = parse_document(path)
        except ValueError as error:
            found = str(error).removeprefix(f"{path}: ")
            self.say(path, "", "a document that can be parsed", found)
            return None
        faults = document_faults(kind, value)
        if not faults:
            faults = tuple(law_faults(kind, value, self.scene))
            self.add(path, faults)
            return value
        self.add(path, faults)
        return None

    def expect(self, path: Path) -> bool:
        """Whether there is a file; otherwise that is noted."""
        if not path.exists():
            self.say(path, "", "the file", "nothing there")
        elif not path.is_file():
            self.say(path, "", "a file", "something else")
        return path.is_file()
