"""What every results file says about its run: versions, device, date; written whole."""

import datetime
import json
import os
import platform
from importlib.metadata import version
from pathlib import Path

import jax

PACKAGES = ("jax", "jaxlib", "jaxopt", "lineax", "numpy", "scipy")


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
    """Write `content` and the provenance as JSON, under a temporary name first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({**provenance(), **content}, indent=1) + "\n"
    part = path.with_suffix(".part")
    part.write_text(text)
    part.replace(path)
