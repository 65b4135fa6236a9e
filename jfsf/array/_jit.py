"""`jax.jit` that keeps the types of a function, and that can be pickled by its name."""

from collections.abc import Callable
from functools import update_wrapper
from inspect import signature
from typing import Any, Generic, ParamSpec, TypeVar, overload

import jax
from jax.core import Tracer

from jfsf.array._static import static

P = ParamSpec("P")
R = TypeVar("R")


class Jitted(Generic[P, R]):
    """A function of a module, compiled by `jax.jit`.

    Its signature is that of the function, for people and for type checkers. It is
    pickled by its module and name, as functions are, so copies in other processes are
    the same object there: equal, with an equal hash, and one program. Static arguments
    are compared by their content (`jfsf.array._static.static`).
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
