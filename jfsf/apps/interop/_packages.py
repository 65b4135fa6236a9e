"""Import an optional package, or say how to install it."""

from importlib import import_module
from typing import Any

EXTRA = "pip install 'jfsf[interop]'"


def need(module: str, package: str, install: str = EXTRA) -> Any:
    """The module; ImportError with the name of its package and how to install it."""
    try:
        return import_module(module)
    except ImportError as missing:
        raise ImportError(
            f"jfsf.apps.interop needs {package} ({missing}): {install}"
        ) from missing
