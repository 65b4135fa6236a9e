"""Static arguments by their content: as keys, and as text for a person or a file."""

from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Any


def static_key(value: Any) -> Hashable:
    """A hashable key, equal for values of equal content.

    `functools.partial` compares by identity, so two that were made alike would compile
    twice. Here they are equal, if what they hold can be hashed.
    """
    if isinstance(value, partial):
        inner = (
            "partial",
            static_key(value.func),
            tuple(map(static_key, value.args)),
            tuple((name, static_key(v)) for name, v in sorted(value.keywords.items())),
        )
        try:
            hash(inner)
        except TypeError:  # it holds an array, say
            return id(value)
        return inner
    return value


def static_text(value: Any, *, name_of: Callable[[Any], str] | None = None) -> str:
    """The text of a static value: what one would write to make it.

    Args:
        value: a number, text, tuple, frozen dataclass, function, or partial of one.
        name_of: the text of a function; its `__name__` when absent.
    """
    name_of = name_of or (lambda function: function.__name__)
    inner = partial(static_text, name_of=name_of)
    if isinstance(value, partial):
        named = [f"{name}={inner(v)}" for name, v in sorted(value.keywords.items())]
        parts = [inner(value.func), *map(inner, value.args), *named]
        return f"partial({', '.join(parts)})"
    if is_dataclass(value) and not isinstance(value, type):
        parts = [f"{f.name}={inner(getattr(value, f.name))}" for f in fields(value)]
        return f"{type(value).__name__}({', '.join(parts)})"
    if isinstance(value, tuple):
        names = getattr(value, "_fields", None)  # of a NamedTuple
        if names is not None:
            named = [f"{n}={inner(v)}" for n, v in zip(names, value, strict=True)]
            return f"{type(value).__name__}({', '.join(named)})"
        return f"({', '.join(map(inner, value))}{',' if len(value) == 1 else ''})"
    if callable(value) and hasattr(value, "__name__"):
        return name_of(value)
    return repr(value)
