"""Whether a pair fits into the memory that this machine has left."""

import os
from pathlib import Path

# Of a process `jfsf match`, measured by experiments/bench/bench_files.py: 0.72 GB for
# two files of 5000 vertices, 1.3 GB for 100 000, 8 GB for a million.
ALWAYS, A_VERTEX = 0.7e9, 3.7e3  # bytes
_MEMINFO = Path("/proc/meminfo")
_CGROUP = Path("/sys/fs/cgroup")


def needed_bytes(vertices: int) -> float:
    """The most memory of a match of two shapes with so many vertices together."""
    return ALWAYS + A_VERTEX * vertices


def free_bytes() -> float | None:
    """Memory that can be had now, within the limit of a container; None if unknown."""
    known = []
    try:
        lines = _MEMINFO.read_text(encoding="utf-8").splitlines()
        known += [1024.0 * int(s.split()[1]) for s in lines if "MemAvailable" in s]
    except OSError:  # not Linux: what other processes have is not known
        try:
            known.append(
                float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
            )
        except (AttributeError, OSError, ValueError):  # Windows
            return None
    try:
        limit, used = (
            (_CGROUP / f"memory.{name}").read_text(encoding="utf-8").strip()
            for name in ("max", "current")
        )
        known += [] if limit == "max" else [float(limit) - float(used)]
    except OSError:  # no such limits
        pass
    return min(known, default=None)


def memory_doubt(vertices: int) -> str:
    """A sentence if a pair may need more memory than there is; else ""."""
    needs, free = needed_bytes(vertices), free_bytes()
    if free is None or needs <= free:
        return ""
    return (
        f"the pair may need {needs / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB "
        "are free; end other programs, or match coarser meshes and carry the map over, "
        "as the guide to troubleshooting shows"
    )
