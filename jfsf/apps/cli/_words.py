"""Messages of the package in the words of the command line: options, X and Y."""

import re
import sys

# Arguments of the functions, and what stands for them here. Not in names of files, nor
# in quotes.
_BEFORE, _AFTER = r"(?<![\w/\\.'\"-])", r"(?=[:;,]? |$)"
_OPTIONS = {
    rf"{_BEFORE}pass base=([01])": r"pass --base \1",
    rf"{_BEFORE}partial=True": "--partial",
    rf"{_BEFORE}exact=True": "--exact",
    rf"{_BEFORE}use exact=False": "leave out --exact",
    rf"{_BEFORE}largest_component{_AFTER}": "match --largest-component",
    rf"{_BEFORE}match_components{_AFTER}": "match --components",
    rf"{_BEFORE}with weld{_AFTER}": "with match --repair",
    rf"{_BEFORE}mesh_x{_AFTER}": "X",
    rf"{_BEFORE}mesh_y{_AFTER}": "Y",
}


def in_options(text: str) -> str:
    """A message on one line, with options in place of the arguments of functions."""
    for argument, option in _OPTIONS.items():
        text = re.sub(argument, option, text)
    return " ".join(text.split())


def sentence(error: Exception) -> str:
    """What to say of an error about the input."""
    text = str(error)
    if isinstance(error, OSError) and error.filename and error.strerror:
        text = f"{error.filename}: {error.strerror}; check the path"
    return in_options(text)


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
