"""Compiled functions that keep their types and can be pickled, and static arguments.

Static arguments are compared by their content, and have a text for a person or a file.
"""

from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from functools import cache, partial, update_wrapper
from inspect import signature
from numbers import Integral, Real
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar, overload

import jax
from jax.core import Tracer


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


P = ParamSpec("P")
R = TypeVar("R")


class Jitted(Generic[P, R]):
    """A function of a module, compiled by `jax.jit`.

    Its signature is that of the function, for people and for type checkers. It is
    pickled by its module and name, as functions are, so copies in other processes are
    the same object there: equal, with an equal hash, and one program. Static arguments
    are compared by their content (`jfsf.array._jit.static`).
    """

    def __init__(
        self,
        function: Callable[P, R],
        check: Callable[..., None] | None = None,
        **options: Any,
    ):
        self._jitted = jax.jit(function, **options)
        names = options.get("static_argnames", ())
        self._static = (names,) if isinstance(names, str) else names
        self._check, self._signature = check, signature(function)
        update_wrapper(self, function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        if self._check is not None:
            given = self._signature.bind(*args, **kwargs).arguments
            known = {n: v for n, v in given.items() if not isinstance(v, Tracer)}
            self._check(**known)
        return self._jitted(*args, **self._by_content(kwargs))

    def trace(self, *args: P.args, **kwargs: P.kwargs) -> jax.stages.Traced:
        """As the function that `jax.jit` returns; `jax.export` needs it."""
        return self._jitted.trace(*args, **self._by_content(kwargs))

    def lower(self, *args: P.args, **kwargs: P.kwargs) -> jax.stages.Lowered:
        """As the function that `jax.jit` returns."""
        return self._jitted.lower(*args, **self._by_content(kwargs))

    def _by_content(self, kwargs: dict[str, Any]) -> dict[str, Any]:
        known = {name: static(kwargs[name]) for name in self._static if name in kwargs}
        return kwargs | known

    def __reduce__(self) -> str:
        return self.__qualname__  # type: ignore[attr-defined]

    def __repr__(self) -> str:
        return f"<jitted {self.__module__}.{self.__qualname__}>"  # type: ignore


@overload
def jit(function: Callable[P, R], /) -> Jitted[P, R]: ...


@overload
def jit(
    *, check: Callable[..., None] | None = None, **options: Any
) -> Callable[[Callable[P, R]], Jitted[P, R]]: ...


def jit(function: Any = None, /, **options: Any) -> Any:
    """Decorate a function of a module: `@jit`, or `@jit(static_argnames="k")`.

    Args:
        function: defined at the top of its module, so that its name finds it.
        check: called before the function, with those arguments, by name, that are given
            and are not tracers. It raises errors about values, which a compiled
            function cannot.
        options: options of `jax.jit`.
    """
    if function is None:
        return lambda function: Jitted(function, **options)
    return Jitted(function, **options)
