"""Messages of the package in the words of the command line: options, X and Y."""

import sys
from functools import cache

from jfsf.mesh._values import LEAVE_OUT, InputError

# Arguments of functions, as they name a mesh in errors, and what it is called here.
_SHAPES = {
    f"{part}mesh_{side.lower()}": f"{part}{side}"
    for part in ("", "part of ")
    for side in "XY"
}


@cache
def _in_options() -> dict[str, str]:
    """Advice of the package that names functions: the same advice with options."""
    from jfsf.apps.mapfiles._formats import FROM_0, FROM_1
    from jfsf.geometry._geodesics import NOT_EXACT
    from jfsf.mesh._check import ONE_COMPONENT

    return {
        FROM_0: "pass --base 0",
        FROM_1: "it looks 1-based: pass --base 1",
        LEAVE_OUT: "leave them out with --repair",
        NOT_EXACT: "leave out --exact",
        ONE_COMPONENT: "keep one with match --largest-component, match all with match "
        "--components, or join seams of coincident vertices with match --repair",
    }


def said(error: Exception) -> str:
    """The message of an error on one line; its advice names options."""
    if isinstance(error, InputError):
        advice = _in_options().get(error.advice, error.advice)
        name = _SHAPES.get(error.name, error.name)
        error = InputError(error.what, advice, name)
    return " ".join(str(error).split())


def sentence(error: Exception) -> str:
    """What to say of an error about the input."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}; check the path"
    return said(error)


def counted(number: int, one: str, many: str) -> str:
    """A number and its noun: 1 point, 2 points."""
    return f"{number} {one if number == 1 else many}"


def print_any_letter() -> None:
    """Let stdout and stderr write names in letters that their encoding lacks.

    Else such a name ends the command after its work. The letters become escapes.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # type: ignore
