"""Static arguments by their content: as keys, and as text for a person or a file."""

from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from functools import cache, partial
from numbers import Integral, Real
from typing import Any, NamedTuple


def static_key(value: Any) -> Hashable:
    """A hashable key, equal for values of equal content.

    `functools.partial` compares by identity, so two that were made alike would compile
    twice. Here they are equal, if what they hold can be hashed.
    """
    if isinstance(value, partial):
        if isinstance(value.func, partial):  # with a docstring, Python keeps it whole
            inner = value.func
            merged = inner.keywords | value.keywords
            value = partial(inner.func, *inner.args, *value.args, **merged)
            return static_key(value)
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


def static(value: Any) -> Any:
    """A static argument as `jax.jit` takes it: hashable, and equal by its content.

    A list becomes a tuple, a number of numpy one of Python, and a partial the first one
    of equal content that was asked for.
    """
    if isinstance(value, list | tuple) and not hasattr(value, "_fields"):
        return tuple(map(static, value))
    if isinstance(value, partial):
        key = static_key(value)
        return value if key == id(value) else _first(_ByKey(key, (value,)))
    return _plain_number(value)


class _ByKey(NamedTuple):
    """A value in a tuple of its own kind, equal to another if their keys are."""

    key: Hashable
    held: tuple[Any]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByKey) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@cache
def _first(value: _ByKey) -> Any:
    return value.held[0]


def _plain_number(value: Any) -> Any:
    """A number of numpy as one of Python; anything else as it is."""
    if type(value).__module__ == "numpy" and isinstance(value, Real):
        return int(value) if isinstance(value, Integral) else float(value)
    return value


def check_types(settings: Any) -> None:
    """Give the fields of a frozen dataclass their types, where this loses nothing.

    For `__post_init__`: lists become tuples and numbers of numpy those of Python, so
    that equal settings are equal, and can be hashed.

    Raises:
        ValueError: a field is of another type; the message names it.
    """
    kind = type(settings).__name__
    for field in fields(settings):
        value = static(getattr(settings, field.name))
        whole = isinstance(value, int) and not isinstance(value, bool)
        wanted = {
            int: ("a whole number", whole),
            float: ("a number", whole or isinstance(value, float)),
            bool: ("True or False", isinstance(value, bool)),
        }
        what, fits = wanted.get(field.type, ("", True))  # type: ignore[arg-type]
        if is_dataclass(field.type):
            what = f"a {field.type.__name__}"  # type: ignore[union-attr]
            fits = isinstance(value, field.type)  # type: ignore[arg-type]
        if str(field.type).startswith("tuple"):
            what, fits = "a tuple", isinstance(value, tuple)
        if not fits:
            raise ValueError(f"{kind}: {field.name} is {value!r}; give {what}")
        object.__setattr__(settings, field.name, value)


def static_text(value: Any, *, name_of: Callable[[Any], str] | None = None) -> str:
    """The text of a static value: what one would write to make it.

    Args:
        value: a number, text, tuple, frozen dataclass, function, or partial of one.
        name_of: the text of a function, of the class of a record, and of anything else
            that is none of these; for people when absent.
    """
    name_of = name_of or (lambda named: getattr(named, "__name__", repr(named)))
    inner = partial(static_text, name_of=name_of)
    if type(value) in (bool, int, float, str, type(None)):
        return repr(value)
    if isinstance(value, partial):
        named = [f"{name}={inner(v)}" for name, v in sorted(value.keywords.items())]
        parts = [inner(value.func), *map(inner, value.args), *named]
        return f"partial({', '.join(parts)})"
    if is_dataclass(value) and not isinstance(value, type):
        parts = [f"{f.name}={inner(getattr(value, f.name))}" for f in fields(value)]
        return f"{name_of(type(value))}({', '.join(parts)})"
    if isinstance(value, tuple):
        names = getattr(value, "_fields", None)  # of a NamedTuple
        if names is not None:
            named = [f"{n}={inner(v)}" for n, v in zip(names, value, strict=True)]
            return f"{name_of(type(value))}({', '.join(named)})"
        return f"({', '.join(map(inner, value))}{',' if len(value) == 1 else ''})"
    return name_of(value)
