"""Results files: JSON with versions, device and date, never written in part."""

import datetime
import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

import jax

from jfsf.storage._atomic import write_text

PACKAGES = ("jax", "jaxlib", "jaxopt", "lineax", "optimistix", "numpy", "scipy")


def provenance() -> dict:
    """Versions, device and date of this run."""
    return {
        "date": datetime.date.today().isoformat(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "device": str(jax.devices()[0].device_kind),
        "cores": os.cpu_count(),
    }


def write(path: Path, **content) -> None:
    """Write `content` and the provenance as JSON, completely or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps({**provenance(), **content}, indent=1) + "\n")
