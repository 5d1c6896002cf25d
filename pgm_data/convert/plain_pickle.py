"""Pickles of plain data, read by a machine of our own that calls nothing which a file names.

A pickle is a program: Python's own reader imports and calls whatever it names. Here each step that plain lists, tuples,
dicts, numbers, texts, NumPy arrays and camera poses need is carried out on plain values, and each name must stand in
`ALLOWED`, where it stands for a few lines of this file and never for the function or class of that name. Everything
else is refused before anything happens. That holds for `torch.storage._load_from_bytes` too, which every pickled tensor
calls and which begins a second, unguarded read of whatever bytes it is given; so files with tensors are refused.

NumPy's own `ndarray.__setstate__` and `dtype.__setstate__` are not used either: made-up states of theirs can lead to
reading and writing any memory.
"""

import pickletools
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from pgm_data.convert.posed_pictures import FieldError

LARGEST_PICKLE = 64 * 2**20
"""Bytes above which a pickle is not read."""
MOST_STEPS = 5_000_000
LARGEST_INTEGER = 2**63
POSES = "utils.lib_3d.pose_parameters"
PLAIN_TYPE = re.compile("[fiu][1248]|b1", re.ASCII)
VALUES = frozenset(
    "NONE NEWTRUE NEWFALSE BININT BININT1 BININT2 LONG1 LONG4 BINFLOAT BINUNICODE SHORT_BINUNICODE BINUNICODE8"
    " BINBYTES SHORT_BINBYTES BINBYTES8".split()
)
"""Steps that put a value on the stack."""
CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}


@dataclass(eq=False)
class PickledArray:
    """A NumPy array of plain numbers."""

    values: np.ndarray | None = None
    """None until the file has said what is in it."""

    def build(self, state: Any) -> None:
        """Take the state that `ndarray.__reduce__` gives: version, shape, type, column order, bytes."""
        if self.values is not None or not isinstance(state, tuple) or len(state) != 5:
            raise FieldError("array", "version, shape, type, order and bytes, once", _kind(state))
        _, shape, kind, is_fortran, raw = state
        sides = isinstance(shape, tuple) and all(isinstance(n, int) and n >= 0 for n in shape) and len(shape) <= 8
        if not sides or not isinstance(kind, PickledType) or kind.dtype is None or not isinstance(raw, bytes):
            raise FieldError("array", "a shape, a type of plain numbers and bytes", _kind(state))
        expected = kind.dtype.itemsize
        for side in shape:
            expected *= side
        if expected != len(raw):
            raise FieldError("array", f"{expected} bytes, as its shape says", f"{len(raw)} bytes")
        self.values = np.frombuffer(raw, dtype=kind.dtype).reshape(shape, order="F" if is_fortran is True else "C")


@dataclass(eq=False)
class PickledType:
    """A NumPy type of plain numbers."""

    letters: str
    dtype: np.dtype | None = None

    def build(self, state: Any) -> None:
        """Take the state that `dtype.__reduce__` gives, of which only the byte order says anything here."""
        plain = isinstance(state, tuple) and len(state) == 8 and state[2:7] == (None, None, None, -1, -1)
        if not plain or state[1] not in ("<", ">", "|", "="):
            raise FieldError("dtype", "a type of plain numbers", _kind(state))
        self.dtype = np.dtype(self.letters).newbyteorder(state[1])


@dataclass(eq=False)
class PickledPose:
    """A camera's pose as PlayableEnvironments keeps it."""

    rotation: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    """Angles about x, y, z, radians."""
    translation: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    """Metres."""

    def build(self, state: Any) -> None:
        """Take the fields."""
        if not isinstance(state, dict) or set(state) != {"rotation", "translation"}:
            got = ", ".join(state) if isinstance(state, dict) else _kind(state)
            raise FieldError("pose", "rotation and translation", ascii(got)[:100])
        for name, value in state.items():
            values = value.values if isinstance(value, PickledArray) else None
            if values is None or values.shape != (3,) or values.dtype.kind != "f":
                raise FieldError(f"pose.{name}", "three numbers", _kind(value))
            setattr(self, name, values.astype(np.float64))


def _new_pose(arguments: tuple) -> PickledPose:
    if arguments:
        raise FieldError("pose", "no arguments, its fields come later", f"{len(arguments)} arguments")
    return PickledPose()


def _new_type(arguments: tuple) -> PickledType:
    letters = arguments[0] if arguments else None
    flags = arguments[1:]
    if not isinstance(letters, str) or PLAIN_TYPE.fullmatch(letters) is None or letters == "f1" or flags[2:]:
        raise FieldError("dtype", "a type of plain numbers", ascii(letters)[:60])
    if not all(flag in (0, 1) for flag in flags):
        raise FieldError("dtype", "a type of plain numbers", "other arguments")
    return PickledType(letters, np.dtype(letters))


def _new_array(arguments: tuple) -> PickledArray:
    if len(arguments) != 3 or arguments[0] is not _NDARRAY or arguments[1] != (0,):
        raise FieldError("array", "an empty array, to be filled later", "other arguments")
    return PickledArray()


def _scalar(arguments: tuple) -> Any:
    kind, raw = arguments if len(arguments) == 2 else (None, None)
    if not isinstance(kind, PickledType) or kind.dtype is None or not isinstance(raw, bytes):
        raise FieldError("scalar", "a type of plain numbers and bytes", "other arguments")
    if len(raw) != kind.dtype.itemsize:
        raise FieldError("scalar", f"{kind.dtype.itemsize} bytes", f"{len(raw)} bytes")
    return np.frombuffer(raw, dtype=kind.dtype)[0].item()


def _encoded(arguments: tuple) -> bytes:
    """Bytes as protocol 2 writes them."""
    if len(arguments) != 2 or not isinstance(arguments[0], str) or arguments[1] not in ("latin1", "latin-1"):
        raise FieldError("_codecs.encode", "a text and latin1", "other arguments")
    return arguments[0].encode("latin1")


def _new_dict(arguments: tuple) -> dict:
    if arguments:
        raise FieldError("OrderedDict", "no arguments", f"{len(arguments)} arguments")
    return {}


def _not_called(arguments: tuple) -> None:
    raise FieldError("ndarray", "not to be called by itself", f"{len(arguments)} arguments")


@dataclass(frozen=True, eq=False)
class Name:
    """What a name of the file stands for."""

    made: Callable[[tuple], Any]
    """Gives the value that calling it gives."""


_NDARRAY, _POSE, _TYPE = Name(_not_called), Name(_new_pose), Name(_new_type)
ALLOWED: dict[tuple[str, str], Name] = {
    (POSES, "PoseParametersNumpy"): _POSE,
    (POSES, "PoseParameters"): _POSE,
    ("numpy", "ndarray"): _NDARRAY,
    ("numpy", "dtype"): _TYPE,
    ("_codecs", "encode"): Name(_encoded),
    ("collections", "OrderedDict"): Name(_new_dict),
}
for _module in ("numpy.core.multiarray", "numpy._core.multiarray"):  # before NumPy 2 and since
    ALLOWED[_module, "_reconstruct"] = Name(_new_array)
    ALLOWED[_module, "scalar"] = Name(_scalar)


def read_plain_pickle(path: Path) -> Any:
    """The value of a pickle (protocols 2 to 5): lists, tuples, dicts, numbers, texts, `PickledArray`, `PickledPose`.

    Raises:
        FieldError: If the file cannot be read, is too large or cut short, or asks for anything else.
    """
    expected = "a pickle of plain data"
    try:
        if not path.is_file():
            raise FieldError("file", expected, "a folder" if path.is_dir() else "nothing there")
        if path.stat().st_size > LARGEST_PICKLE:
            raise FieldError("file", f"at most {LARGEST_PICKLE} bytes", f"{path.stat().st_size} bytes")
        content = path.read_bytes()
    except OSError as error:
        raise FieldError("file", expected, error) from error
    return plain_value(content)


def plain_value(content: bytes) -> Any:
    """The value of a pickle's bytes, as `read_plain_pickle`."""
    machine = _Machine()
    position = 0
    try:
        for steps, (opcode, argument, place) in enumerate(pickletools.genops(BytesIO(content))):
            position = place or 0
            if steps >= MOST_STEPS:
                raise FieldError("pickle", f"at most {MOST_STEPS} steps", "more")
            machine.step(opcode.name, argument)
    except FieldError as error:
        raise FieldError(f"byte {position}: {error.field}", error.expected, error.found) from error
    except (IndexError, KeyError):
        raise FieldError(f"byte {position}", "a value that is there", "none") from None
    except (ValueError, OverflowError) as error:
        raise FieldError(f"byte {position}", "a whole pickle", ascii(str(error))[:120]) from error
    if position + 1 != len(content):
        raise FieldError(f"byte {position + 1}", "the end of the file", f"{len(content) - position - 1} bytes more")
    return machine.result


class _Machine:
    """Stack, marks and memo of a pickle that is being read."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.below: list[list[Any]] = []
        self.memo: dict[int, Any] = {}
        self.result: Any = None

    def step(self, name: str, argument: Any) -> None:
        if name in VALUES:
            if isinstance(argument, int) and not -LARGEST_INTEGER <= argument < LARGEST_INTEGER:
                raise FieldError("integer", "64 bits", "more")
            self.stack.append(CONSTANTS.get(name, argument))
            return
        own = getattr(self, f"_{name.lower()}", None) if name in STEPS else None
        if own is None:
            raise FieldError("step", f"one that plain data needs, not {name}", "it")
        own(argument)

    def _pop(self, kind: type) -> Any:
        value = self.stack.pop()
        if not isinstance(value, kind):
            raise FieldError("step", f"a {kind.__name__}", _kind(value))
        return value

    def _top(self, kind: type) -> Any:
        if not isinstance(self.stack[-1], kind):
            raise FieldError("step", f"a {kind.__name__}", _kind(self.stack[-1]))
        return self.stack[-1]

    def _marked(self) -> list[Any]:
        """What was put since the last mark."""
        items, self.stack = self.stack, self.below.pop()
        return items

    def _proto(self, version: int) -> None:
        if not 2 <= version <= 5:
            raise FieldError("protocol", "2 to 5", version)

    def _frame(self, _: Any) -> None:
        """Frames say how much to read at once, which is nothing to us."""

    def _mark(self, _: Any) -> None:
        self.below.append(self.stack)
        self.stack = []

    def _empty_list(self, _: Any) -> None:
        self.stack.append([])

    def _empty_tuple(self, _: Any) -> None:
        self.stack.append(())

    def _empty_dict(self, _: Any) -> None:
        self.stack.append({})

    def _append(self, _: Any) -> None:
        value = self.stack.pop()
        self._top(list).append(value)

    def _appends(self, _: Any) -> None:
        items = self._marked()
        self._top(list).extend(items)

    def _tuple(self, _: Any) -> None:
        items = tuple(self._marked())
        self.stack.append(items)

    def _tuple1(self, _: Any) -> None:
        self.stack.append((self.stack.pop(),))

    def _tuple2(self, _: Any) -> None:
        second, first = self.stack.pop(), self.stack.pop()
        self.stack.append((first, second))

    def _tuple3(self, _: Any) -> None:
        third, second, first = self.stack.pop(), self.stack.pop(), self.stack.pop()
        self.stack.append((first, second, third))

    def _setitem(self, _: Any) -> None:
        value, key = self.stack.pop(), self._pop(str)
        self._top(dict)[key] = value

    def _setitems(self, _: Any) -> None:
        items = self._marked()
        if len(items) % 2 or not all(isinstance(key, str) for key in items[::2]):
            raise FieldError("dict", "texts as keys", "others")
        self._top(dict).update(zip(items[::2], items[1::2], strict=True))

    def _binput(self, place: int) -> None:
        self.memo[place] = self.stack[-1]

    def _memoize(self, _: Any) -> None:
        self.memo[len(self.memo)] = self.stack[-1]

    def _binget(self, place: int) -> None:
        self.stack.append(self.memo[place])

    _long_binput, _long_binget = _binput, _binget

    def _global(self, names: str) -> None:
        module, _, name = names.partition(" ")
        self.stack.append(_allowed(module, name))

    def _stack_global(self, _: Any) -> None:
        name, module = self._pop(str), self._pop(str)
        self.stack.append(_allowed(module, name))

    def _reduce(self, _: Any) -> None:
        arguments, called = self._pop(tuple), self._pop(Name)
        self.stack.append(called.made(arguments))

    def _newobj(self, _: Any) -> None:
        arguments, called = self._pop(tuple), self._pop(Name)
        if called is not _POSE:
            raise FieldError("step", "a pose to be made", "another class")
        self.stack.append(called.made(arguments))

    def _build(self, _: Any) -> None:
        state = self.stack.pop()
        made = self.stack[-1]
        if not isinstance(made, PickledArray | PickledType | PickledPose):
            raise FieldError("step", "an array, a type or a pose to be filled", _kind(made))
        made.build(state)

    def _stop(self, _: Any) -> None:
        self.result = self.stack.pop()
        if self.stack or self.below:
            raise FieldError("end", "one value", "more")


STEPS = frozenset(
    "PROTO FRAME MARK STOP EMPTY_LIST EMPTY_TUPLE EMPTY_DICT APPEND APPENDS TUPLE TUPLE1 TUPLE2 TUPLE3 SETITEM SETITEMS"
    " BINPUT LONG_BINPUT MEMOIZE BINGET LONG_BINGET GLOBAL STACK_GLOBAL REDUCE NEWOBJ BUILD".split()
)
"""The other steps that plain data needs."""


def _allowed(module: str, name: str) -> Name:
    found = ALLOWED.get((module, name))
    if found is not None:
        return found
    if module.partition(".")[0] == "torch":
        expected = "poses and boxes as NumPy arrays; save the dataset again with the version that writes these"
        raise FieldError("name", expected, f"a torch tensor ({ascii(f'{module}.{name}')[:80]})")
    raise FieldError("name", f"one of {', '.join('.'.join(pair) for pair in ALLOWED)}", ascii(f"{module}.{name}")[:80])


def _kind(value: Any) -> str:
    """A value's kind in a word; never its content, which may be endless."""
    return f"{type(value).__name__} of {len(value)}" if isinstance(value, tuple | list | dict) else type(value).__name__
