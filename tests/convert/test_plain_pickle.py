import builtins
import os
import pickle
import posix
import sys
from collections import OrderedDict
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.plain_pickle import PickledArray, PickledPose, plain_value, read_plain_pickle
from pgm_data.convert.posed_pictures import FieldError
from tests.convert.playable_folders import POSE, POSES, foreign_class, foreign_module, pickled, pose

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.lists(inner).map(tuple) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@settings(max_examples=25)
@given(PLAIN, st.integers(3, 5))
def test_plain_data_is_what_it_was(value, protocol):
    assert plain_value(pickle.dumps(value, protocol=protocol)) == value


@pytest.mark.parametrize("protocol", [2, 3, 4])
@pytest.mark.parametrize("kind", ["f2", "f4", "f8", ">f4", "i1", "i2", "<i4", "i8", "u1", ">u2", "bool"])
def test_arrays_of_plain_numbers_are_what_they_were(kind, protocol):
    for values in (np.arange(6).reshape(2, 3), np.asfortranarray(np.arange(6).reshape(3, 2)), np.zeros((0, 4)), 5):
        array = np.array(values).astype(kind)
        array = np.asfortranarray(array) if np.isfortran(np.asarray(values)) else array
        if protocol == 2 and not array.size:
            continue  # it calls bytes() for no bytes, which is not on the list
        found = plain_value(pickle.dumps(array, protocol=protocol))
        assert isinstance(found, PickledArray) and found.values is not None
        np.testing.assert_array_equal(found.values, array)
        assert found.values.dtype == array.dtype


def test_scalars_and_ordered_dicts_are_plain():
    assert plain_value(pickle.dumps([np.float64(2.5), np.int32(-7), np.bool_(True)])) == [2.5, -7, True]
    assert plain_value(pickle.dumps(OrderedDict(b=1, a=[2]))) == {"b": 1, "a": [2]}
    assert plain_value(pickle.dumps(b"\xff\x00", protocol=2)) == b"\xff\x00"


def test_names_of_numpy_before_its_second_version_are_known():
    content = pickle.dumps([np.arange(3.0), np.float32(1.5)], protocol=2)
    assert b"numpy._core.multiarray" in content
    found = plain_value(content.replace(b"numpy._core.multiarray", b"numpy.core.multiarray"))
    assert found[0].values.tolist() == [0, 1, 2] and found[1] == 1.5


@pytest.mark.parametrize("protocol", [2, 3, 4])
def test_poses_come_through_their_fields(protocol):
    found = plain_value(pickled([pose(), pose(rotation=(1, 2, 3))], protocol))
    assert all(isinstance(each, PickledPose) for each in found)
    assert found[1].rotation.tolist() == [1, 2, 3] and found[0].translation.dtype == np.float64


class Calls:
    """Pickles as the call of a function."""

    def __init__(self, function, *arguments, state=None):
        self.parts = (function, arguments) if state is None else (function, arguments, state)

    def __reduce__(self):
        return self.parts


def type_with(state):
    return Calls(np.dtype, "f8", False, True, state=state)


LOADED = []
"""What the second, unguarded read of a tensor's bytes would fill."""


def torch_bytes(content: bytes) -> bytes:
    """A pickled tensor storage, whose bytes are a pickle themselves."""

    def _load_from_bytes(raw):
        LOADED.append(raw)

    _load_from_bytes.__module__, _load_from_bytes.__qualname__ = "torch.storage", "_load_from_bytes"
    with foreign_module("torch.storage", _load_from_bytes=_load_from_bytes):
        return pickle.dumps([Calls(_load_from_bytes, content)])


def named(module: str, name: str) -> bytes:
    return pickle.PROTO + b"\x04" + pickle.GLOBAL + f"{module}\n{name}\n".encode() + pickle.EMPTY_TUPLE + b"R."


EVIL = "touch {0}"
FILE = "open({0!r}, 'w').close()"


def malicious(mark: str) -> dict[str, bytes]:
    """Pickles that would leave a file behind, or worse."""
    dump = pickle.dumps
    system = dump(Calls(os.system, EVIL.format(mark)))
    with foreign_module(POSES, PoseParametersNumpy=POSE):
        armed = pose()
        armed.rotation = Calls(os.system, EVIL.format(mark))
        return {
            "system": system,
            "system of protocol 0": dump(Calls(os.system, EVIL.format(mark)), protocol=0),
            "system of protocol 2": dump(Calls(posix.system, EVIL.format(mark)), protocol=2),
            "eval": dump(Calls(builtins.eval, f"__import__('os').system({EVIL.format(mark)!r})")),
            "exec": dump(Calls(builtins.exec, FILE.format(mark))),
            "open": dump(Calls(open, mark, "w")),
            "getattr": dump(Calls(getattr, "text", "format")),
            "inside a list": dump([1.0, [Calls(os.system, EVIL.format(mark))]]),
            "a tuple as a key": dump({(1, 2): 3}),
            "in a pose": dump([armed]),
            "in the state of a pose": dump(Calls(POSE, state={"rotation": Calls(os.system, EVIL.format(mark))})),
            "a pose with arguments": dump(Calls(POSE, 1, 2)),
            "a pose with other fields": dump(Calls(POSE, state={"__class__": 1})),
            "a pose without fields of three": dump(Calls(POSE, state={"rotation": 1.0, "translation": 2.0})),
            "torch": torch_bytes(system),
            "a torch tensor": named("torch._utils", "_rebuild_tensor_v2"),
            "objects in an array": dump(np.array([Calls(os.system, EVIL.format(mark))], dtype=object)),
            "a type of objects": dump(np.dtype("O")),
            "a type of fields": dump(np.dtype([("a", "f4")])),
            "a type that became objects": dump(type_with((3, "|", None, None, None, 8, 8, 63))),
            "a type of a subtype": dump(type_with((3, "<", (np.dtype("f4"), (2,)), None, None, -1, -1, 0))),
            "an array by itself": dump(Calls(np.ndarray, (10**6,))),
            "an array without its bytes": dump(
                Calls(np.ndarray, (1,), state=(1, (10**15,), np.dtype("f8"), False, b""))
            ),
            "another codec": dump(Calls(__import__("_codecs").encode, "text", "rot13")),
            "a name with dots": named("collections", "OrderedDict.__init__"),
            "a name of a parent": named("numpy", "core.multiarray._reconstruct"),
            "numpy's loader": named("numpy", "load"),
            "extension registry": pickle.PROTO + b"\x04" + pickle.EXT1 + b"\x01.",
            "persistent id": pickle.PROTO + b"\x04" + b"Pname\n.",
            "old class": b"(cos\nsystem\no.",
            "instance": b"(S'" + EVIL.format(mark).encode() + b"'\nios\nsystem\n.",
        }


def refusing(real: Callable[..., object]) -> Callable[..., object]:
    """Fails the test when it is called, but by what checks types in tests, which makes its checks by `exec`."""

    def call(*arguments: object) -> object:
        if sys._getframe(1).f_globals["__name__"].partition(".")[0] == "beartype":
            return real(*arguments)
        return pytest.fail("called")

    return call


@pytest.mark.parametrize("kind", list(malicious("x")))
def test_a_malicious_pickle_is_refused_and_does_nothing(tmp_path, kind, monkeypatch):
    mark = tmp_path / "mark"
    content = malicious(str(mark))[kind]
    path = tmp_path / "cameras.pkl"
    path.write_bytes(content)
    LOADED.clear()
    for module, name in ((os, "system"), (builtins, "eval"), (builtins, "exec")):
        monkeypatch.setattr(module, name, refusing(getattr(module, name)))
    with pytest.raises(FieldError, match="expected"):
        read_plain_pickle(path)
    assert not mark.exists() and not LOADED


def test_a_pickle_that_python_would_carry_out_is_carried_out_by_python_alone(tmp_path):
    """The test before would mean nothing if these pickles were harmless."""
    mark = tmp_path / "mark"
    pickle.loads(malicious(str(mark))["exec"])
    assert mark.exists()
    mark.unlink()
    pickle.loads(malicious(str(mark))["system"])
    assert mark.exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "whole pickle"),
        (pickle.dumps([1.0] * 50)[:-9], "whole pickle"),
        (pickle.dumps(1) + b"more", "the end of the file"),
        (b"\x80\x04\x8e" + (2**62).to_bytes(8, "little") + b"x.", "whole pickle"),
        (b"\x80\x04]r\xff\xff\xff\x7f.", None),
        (b"\x80\x04h\x07.", "a value that is there"),
        (b"\x80\x04a.", "a value that is there"),
        (b"\x80\x04u.", "a value that is there"),
        (b"\x80\x04]K\x01K\x02s.", "expected"),
        (b"\x80\x04K\x01K\x02.", "one value"),
        (b"\x80\x09K\x01.", "2 to 5"),
        (b"\x80\x04\x8a\x10" + b"\x7f" * 16 + b".", "64 bits"),
        (b"not a pickle at all", "expected"),
    ],
)
def test_a_damaged_or_boundless_pickle_is_refused_at_its_place(content, words):
    if words is None:  # a place in the memo far away costs nothing here
        assert plain_value(content) == []
        return
    with pytest.raises(FieldError, match=words) as caught:
        plain_value(content)
    assert caught.value.field.startswith("byte ")


def test_deep_nesting_neither_crashes_nor_is_shown(tmp_path):
    deep = b"\x80\x04)" + b"\x85" * 60_000
    assert isinstance(plain_value(deep + b"."), tuple)
    with pytest.raises(FieldError) as caught:
        plain_value(b"\x80\x04}" + deep[2:] + b"K\x01s.")
    assert len(str(caught.value)) < 200


def test_an_array_and_its_type_cannot_be_filled_twice_or_by_another(tmp_path):
    state = np.arange(2.0).__reduce__()[2]
    twice = [Calls(np.arange(1.0).__reduce__()[0], np.ndarray, (0,), b"b", state=state[:4])]
    with pytest.raises(FieldError, match="version, shape, type"):
        plain_value(pickle.dumps(twice))
    short = (*state[:4], state[4][:-1])
    with pytest.raises(FieldError, match="16 bytes, as its shape says, got 15 bytes"):
        plain_value(pickle.dumps([Calls(np.arange(1.0).__reduce__()[0], np.ndarray, (0,), b"b", state=short)]))


def test_a_class_of_another_name_in_the_known_module_is_refused():
    other = foreign_class("Transformations3D", POSES)
    with foreign_module(POSES, Transformations3D=other):
        content = pickle.dumps([other()])
    with pytest.raises(FieldError, match="PoseParametersNumpy"):
        plain_value(content)


@settings(max_examples=40)
@given(st.binary(max_size=60))
def test_any_bytes_give_plain_data_or_an_error(content):
    try:
        plain_value(b"\x80\x04" + content)
    except FieldError:
        pass


@settings(max_examples=60)
@given(st.data())
def test_a_pickle_with_one_byte_changed_gives_data_or_an_error(data):
    content = bytearray(pickled([pose(), np.arange(3), {"a": (1, None)}]))
    content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        plain_value(bytes(content))
    except FieldError:
        pass
