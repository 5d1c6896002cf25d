"""Shapes and types of the package checked at every call, at a third of what jaxtyping's own wrapper costs.

That wrapper makes two checkers of each function while its module is imported and runs both over all arguments at
every call, so as to say in its error which argument was wrong. Here one checker is made, when a function is first
called. What is checked is the same, and a dimension is one number within a call as it is with jaxtyping's.
"""

import functools
import inspect
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import is_dataclass
from types import SimpleNamespace
from typing import Any, get_type_hints

import beartype
import jaxtyping

SCOPE: Any = jaxtyping.jaxtyped("context")
"""Within it a dimension is one number."""

# Annotated `float` takes an int, as everywhere in Python.
checker = beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True, violation_type=jaxtyping.TypeCheckError))


def set_known_hints(function: Callable[..., Any]) -> None:
    """Leave the function the annotations that are known while it runs: some name what type checkers alone import."""
    known = {}
    for name, hint in function.__annotations__.items():
        with suppress(Exception):
            alone = SimpleNamespace(__annotations__={name: hint})
            known |= get_type_hints(alone, function.__globals__, include_extras=True)
    function.__annotations__ = known


def checked_function(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with its arguments and what it returns checked."""
    checked: Callable[..., Any] | None = None

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if checked is None:
            set_known_hints(function)
            checked = checker(function)
        with SCOPE:
            return checked(*args, **kwargs)

    return call


def checked_generator(function: Callable[..., Any]) -> Callable[..., Any]:
    """The generator function with its arguments checked as it is called, and not as late as its first step."""
    signature = inspect.signature(function)
    bare = [
        each.replace(annotation=each.empty, default=each.empty if each.default is each.empty else None)
        for each in signature.parameters.values()
    ]
    made: dict[str, Any] = {}
    exec(
        f"def takes{signature.replace(parameters=bare, return_annotation=signature.empty)}: pass",
        function.__globals__,
        made,
    )
    takes = made["takes"]
    takes.__annotations__ = {name: hint for name, hint in function.__annotations__.items() if name != "return"}
    takes.__defaults__, takes.__kwdefaults__ = function.__defaults__, function.__kwdefaults__
    takes.__module__, takes.__qualname__ = function.__module__, function.__qualname__
    arguments = checked_function(takes)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        arguments(*args, **kwargs)
        return function(*args, **kwargs)

    return call


def checked(thing: Any) -> Any:
    """The function, or the dataclass with its fields, checked."""
    if inspect.isclass(thing):
        made = vars(thing).get("__init__")
        if is_dataclass(thing) and made is not None and not hasattr(made, "__wrapped__"):
            thing.__init__ = checked_function(made)
        return thing
    return checked_generator(thing) if inspect.isgeneratorfunction(thing) else checked_function(thing)


def install(modules: Sequence[str]) -> None:
    """Check the functions and dataclasses of those modules, where they are imported from now on."""
    jaxtyping.install_import_hook(modules, None)
    # The hook writes `@jaxtyping.jaxtyped(typechecker=...)` above each of them.
    jaxtyping.jaxtyped = lambda *, typechecker: checked
