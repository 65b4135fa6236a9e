"""Every Python block of README, guides and docstrings runs, as it stands.

A page is one program, in a process of its own and a folder with the files that its
blocks name. Pages that match shapes take long; but for the README, the fast tests read
the imports and names of these only.
"""

import ast
import os
import re
import subprocess
import sys
from importlib import import_module

import jax
import numpy as np
import pytest
from documents import PAGES, SOURCES, blocks, docstrings, name
from shapes import manifold, write_off

from jfsf.apps.mapfiles import write_map
from jfsf.testing import blob_spectrum

PAIR = "man_walk", "man_up"
SLOW = re.compile(
    r"\b(?:match|match_spectra|alternatives|collection|fit|fit_model|least_squares)\("
)
PROGRAMS = {name(page): "\n".join(blocks(page.read_text(), "python")) for page in PAGES}
PROGRAMS = {page: code for page, code in PROGRAMS.items() if code}
# Programs that run once compile in less time, as with the fixture `run_once`.
QUICK = """\
from jfsf.runtime import _programs
_programs.CPU_OPTIONS["xla_backend_optimization_level"] = 0
del _programs
"""


def of_speed(page):
    # What people see first is never left out.
    slow = page != "README.md" and bool(SLOW.search(PROGRAMS[page]))
    return pytest.param(page, marks=[pytest.mark.slow] * slow)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files of the README's block, and a cache that all pages share."""
    folder = tmp_path_factory.mktemp("pages")
    for shape in PAIR:
        sample = manifold(shape)
        write_off(folder / f"{shape}.off", sample.mesh)
        write_map(folder / f"{shape}.vts", sample.template_to_vertex)
    return folder


@pytest.mark.parametrize("page", [of_speed(page) for page in PROGRAMS])
def test_a_page_runs(page, folder):
    done = subprocess.run(
        [sys.executable, "-c", QUICK + PROGRAMS[page]],
        cwd=folder,
        env=os.environ | {"JFSF_CACHE": str(folder / "cache"), "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    if page == "README.md":
        assert float(done.stdout) < 0.06


@pytest.mark.filterwarnings("ignore:JAXopt is no longer")  # ott imports it
@pytest.mark.parametrize("page", PROGRAMS)
def test_what_a_page_imports_is_there(page):
    for node in ast.walk(ast.parse(PROGRAMS[page])):
        if isinstance(node, ast.ImportFrom):
            module = import_module(node.module)
            assert all(hasattr(module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                import_module(alias.name)
        elif isinstance(node, ast.Attribute) and (path := dotted(node)):
            if path[0] == "jfsf":
                found = import_module("jfsf")
                for part in path[1:]:
                    found = getattr(found, part)


def dotted(node):
    """The names of a.b.c; None for what begins with a call or an index."""
    if isinstance(node, ast.Name):
        return [node.id]
    if isinstance(node, ast.Attribute) and (before := dotted(node.value)):
        return [*before, node.attr]
    return None


def test_blocks_of_docstrings_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = 0
    for path in SOURCES:
        codes = [blocks(docstring, "python") for docstring in docstrings(path)]
        for code in sum(codes, []):
            exec(compile(code, str(path), "exec"), scope_of(path))
            found += 1
    assert found >= 1


def scope_of(path):
    """The names of the module, and a small pair."""
    parts = path.with_suffix("").parts
    module = import_module(".".join(parts[parts.index("jfsf") :]))
    spec_x, spec_y = blob_spectrum(0, 12), blob_spectrum(1, 12)
    return vars(module) | {
        "spec_x": jax.tree.map(np.asarray, spec_x),
        "spec_y": jax.tree.map(np.asarray, spec_y),
        "C_yx": np.eye(12),
    }
