"""Memory: what a match takes is what the command line says beforehand."""

import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from jfsf import data
from jfsf.apps.cli import _memory
from jfsf.apps.export import export_mesh
from jfsf.types import Mesh


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Writes what a machine says of its memory."""
    monkeypatch.setattr(_memory, "_MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(_memory, "_CGROUP", tmp_path)

    def says(free_kb, limit="max", used=0):
        lines = f"MemTotal: 99 kB\nMemAvailable: {free_kb} kB\n"
        (tmp_path / "meminfo").write_text(lines)
        (tmp_path / "memory.max").write_text(f"{limit}\n")
        (tmp_path / "memory.current").write_text(f"{used}\n")

    return says


def test_free_memory_is_the_least_of_machine_and_container(machine):
    machine(4_000_000)
    assert _memory.free_bytes() == 4_000_000 * 1024
    machine(4_000_000, limit=2 * 10**9, used=10**9)
    assert _memory.free_bytes() == 10**9


def test_a_pair_that_does_not_fit_is_said(machine):
    machine(4_000_000)
    assert _memory.memory_doubt(10_000) == ""
    said = _memory.memory_doubt(2_000_000)
    assert "8.1 GB" in said and "4.1 GB are free" in said


def test_what_is_measured_fits():
    # In GB, of two shapes of so many vertices: experiments/bench/bench_files.py.
    for vertices, measured in (5076, 0.72), (100_000, 1.31), (1_000_000, 7.9):
        needs = _memory.needed_bytes(2 * vertices) / 1e9
        assert measured < needs < 1.2 * measured


def test_what_is_not_known_is_no_doubt(machine, monkeypatch):
    def unknown(name):
        raise ValueError(name)

    monkeypatch.setattr(os, "sysconf", unknown, raising=False)
    assert _memory.free_bytes() is None  # nothing was written
    assert _memory.memory_doubt(10**9) == ""


# The peak of a command. On Linux that of a process begins with what its parent takes,
# and tests before may have made this one large, so a small process starts it.
PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the peak is not known here")
@pytest.mark.parametrize("splits", [0, 1])
def test_a_match_takes_no_more(tmp_path, splits):
    """5000 and 20 000 vertices; bench_files.py measures more."""
    paths, count = [], 0
    for name in ("man_walk", "man_up"):
        points, faces = data.load(name).mesh
        for _ in range(splits):
            points, faces = trimesh.remesh.subdivide(points, faces)
        count += len(points)
        paths.append(tmp_path / f"{name}.ply")
        export_mesh(paths[-1], Mesh(np.asarray(points), np.asarray(faces, np.int32)))
    command = ["match", *map(str, paths), "--out", str(tmp_path / "map.npz")]
    run = subprocess.run(
        [sys.executable, "-c", PEAK, sys.executable, "-m", "jfsf", *command],
        env={**os.environ, "JFSF_CACHE": str(tmp_path / "cache"), "XLA_FLAGS": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    peak = int(run.stdout.split()[-1]) * (1 if sys.platform == "darwin" else 1024)
    # Less than half of it would be as wrong: people would buy memory for nothing.
    assert 0.5 * _memory.needed_bytes(count) < peak < 1.4 * _memory.needed_bytes(count)
