"""One version everywhere, and a citation that follows its schema's rules."""

import re
import subprocess
import sys
import tomllib

from documents import ROOT

import jfsf

CITATION = (ROOT / "CITATION.cff").read_text()
# Of Citation File Format 1.2.0.
KEYS = {
    *("cff-version", "message", "title", "abstract", "type", "authors", "version"),
    *("date-released", "license", "keywords", "preferred-citation"),
}


def of_citation(key):
    (value,) = re.findall(rf'^{key}: "?([^"\n]+)"?$', CITATION, re.MULTILINE)
    return value


def test_one_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    changes = (ROOT / "CHANGELOG.md").read_text()
    released = re.findall(r"^## \[(\d[\d.]*)\] - ([\d-]+)$", changes, re.MULTILINE)
    assert project["version"] == jfsf.__version__ == of_citation("version")
    assert released[0] == (jfsf.__version__, of_citation("date-released"))


def test_the_citation_has_known_keys():
    found = re.findall(r"^([\w-]+):", CITATION, re.MULTILINE)
    assert set(found) == KEYS and len(found) == len(set(found))
    assert of_citation("cff-version") == "1.2.0" and of_citation("license") == "MIT"


def test_importing_the_package_loads_none_of_the_optional_ones():
    heavy = {"matplotlib", "torch", "meshio", "pyFM", "ott", "distributed", "pdoc"}
    code = (
        "import sys, jfsf\n"
        "from jfsf.apps import cli, export, guide, interop, report\n"
        "jfsf.match\n"
        f"print({heavy} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout.strip() == "set()", run.stdout + run.stderr
