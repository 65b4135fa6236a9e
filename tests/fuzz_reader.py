"""Reads the files named on stdin; a line on stdout for each, empty if it behaved.

A file behaves if it is read, and what is read is sound, or refused by an error of the
package's own that names it; without a warning, and in little memory.
"""

import os
import resource
import sys
import time
import warnings
from functools import partial
from pathlib import Path

import numpy as np

from jfsf.apps.landmarks import read_landmarks, read_specimens
from jfsf.apps.landmarks._files import read_vertex_pairs
from jfsf.apps.mapfiles import MapFileError, read_map, read_match
from jfsf.apps.mapfiles._stored import read_stored
from jfsf.batch._pair_list import read_pairs
from jfsf.mesh import MeshError, read_noted
from jfsf.mesh._read import SUFFIXES, format_of

MEGABYTES = int(sys.argv[1])


def mesh(path):
    (vertices, faces), _ = read_noted(path)
    assert vertices.dtype == np.float64 and np.isfinite(vertices).all()
    assert vertices.shape == (len(vertices), 3) and len(vertices) > 0
    assert faces.dtype == np.int32 and faces.shape == (len(faces), 3)
    assert faces.min(initial=0) >= 0 and faces.max(initial=0) < len(vertices)


def indices(path, **options):
    found = read_map(path, n_to=59, **options)
    assert found.dtype == np.int32 and found.ndim == 1
    assert 0 <= found.min() and found.max() < 59


def stored(path):
    T_xy, T_yx, C_yx, index_x, index_y = read_stored(path, n_x=59, n_y=59)
    assert T_xy.dtype == np.int32
    assert len(T_xy) == (59 if index_x is None else len(index_x))
    assert T_yx is None or len(T_yx) == (59 if index_y is None else len(index_y))
    assert C_yx is None or (C_yx.ndim == 2 and np.isfinite(C_yx).all())


def match(path):
    found = read_match(path)
    assert found.T_xy.max() < len(found.T_yx) and found.T_yx.max() < len(found.T_xy)
    for value in found.certificate.figures().values():
        float(value)


def pairs(path):
    found = read_pairs(path)
    assert found and len({pair.name for pair in found}) == len(found)
    assert not any("/" in pair.name or "\0" in f"{pair.x}{pair.y}" for pair in found)


def landmark_pairs(path):
    found = read_vertex_pairs(path)
    assert found.shape == (len(found), 2) and found.dtype.kind == "i"


def landmarks(path):
    names, points, vertices, system, _ = read_landmarks(path)
    assert names and system in (None, "LPS", "RAS")
    if points is None:
        assert vertices.shape == (len(names),) and vertices.min() >= 0
    else:
        assert points.shape == (len(names), 3) and np.isfinite(points).all()


def specimens(path):
    names, titles, points = read_specimens(path)
    assert names and len(set(names)) == len(names)
    assert points.shape == (len(names), len(titles), 3)
    missing = np.isnan(points).any(2)
    assert np.isfinite(points[~missing]).all() and np.isnan(points[missing]).all()


def grow(path):
    np.ones(MEGABYTES << 18)


MAPS = [indices, partial(indices, base=0), stored]
READERS = {
    **dict.fromkeys(SUFFIXES, [mesh]),
    **dict.fromkeys([".vts", ".map", ".mat"], MAPS),
    ".npz": [*MAPS, match],
    ".csv": [pairs, landmarks, specimens],
    ".CSV": [specimens, landmarks],
    ".txt": [landmark_pairs, landmarks, specimens],
    ".tsv": [landmarks, specimens],
    ".tps": [specimens, landmarks],
    ".pts": [landmarks],
    **dict.fromkeys([".json", ".fcsv", ".pp"], [landmarks]),
    # What the process that started this one must notice.
    ".die": [lambda path: os.abort()],
    ".hang": [lambda path: time.sleep(600)],
    ".grow": [grow],
    ".warn": [lambda path: warnings.warn("of it", stacklevel=1)],
    ".wrong": [lambda path: [][1]],
    ".nameless": [lambda path: int("x")],
    ".unsound": [lambda path: exec("assert path is None")],
    ".print": [lambda path: os.write(2, b"loud ")],
}
OWN = MeshError, MapFileError


def fault(reader, path, sound=False):
    """What is wrong with how a file is read, or None."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            reader(path)
        except Exception as error:
            own = isinstance(error, OWN) or type(error) is ValueError
            if sound or not own or not str(error).startswith(str(path)):
                return f"{type(error).__name__}: {error}"
    return f"warning: {warned[0].message}" if warned else None


def peak():
    """Most memory so far, in MB."""
    try:
        # On Linux the other number may be that of the process that started this one.
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        return int(status.split("VmHWM:")[1].split()[0]) >> 10
    except (OSError, IndexError):
        unit = 20 if sys.platform == "darwin" else 10
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> unit


def main():
    # A runaway ends here, not the machine.
    resource.setrlimit(resource.RLIMIT_DATA, (4 << 30, 4 << 30))
    print("ready", flush=True)
    for line in sys.stdin:
        path = Path(line[1:].rstrip("\n"))
        first, *others = READERS[format_of(path) or path.suffix]
        found = [fault(first, path, line[0] == "!")]
        found += [fault(reader, path) for reader in others]
        if (size := peak()) > MEGABYTES:
            found.append(f"{size} MB")
        print(" ".join(next(filter(None, found), "").split()), flush=True)


main()
