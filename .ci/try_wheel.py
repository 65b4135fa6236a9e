"""What an installation of the wheel, with the core dependencies only, must do.

Run in an empty folder, by the Python of an environment that holds nothing else.
"""

import json
import subprocess
import sys
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter

import jfsf


def run(*command: str) -> subprocess.CompletedProcess[str]:
    """A command that ends, with what it printed."""
    return subprocess.run(command, capture_output=True, text=True)


def check(holds: bool, what: str) -> None:
    """Say what holds, or stop."""
    print("ok  " if holds else "FAIL", what, flush=True)
    if not holds:
        sys.exit(1)


check("site-packages" in str(jfsf.__file__), f"import jfsf, from {jfsf.__file__}")
check(jfsf.__version__ == version("jfsf"), f"version {jfsf.__version__}")
print(f"     Python {sys.version.split()[0]}, jax {version('jax')}")
check(find_spec("matplotlib") is None, "no matplotlib here")
pages = "apps/guide/start.md", "apps/report/page/three.min.js"
kept = ("py.typed", "data/man_walk.npz", *pages)
missing = [name for name in kept if not (files("jfsf") / name).is_file()]
check(not missing, f"the wheel holds {', '.join(kept)} {missing or ''}")

started = perf_counter()
done = run("jfsf", "demo", "--out", "demo")
check(done.returncode == 0, f"jfsf demo {done.stderr}")
print(done.stdout, f"{perf_counter() - started:.0f} s", sep="")
written = sorted(path.name for path in Path("demo").iterdir())
check(written == ["man_walk_man_up.json"], f"it wrote {written}")
rows = json.loads(Path("demo", written[0]).read_text(encoding="utf-8"))["rows"]
error = rows["jfsf.match"]["error"]
check(error < 0.02, f"the error of jfsf.match is {error:.4f}")

for wanted, command in {
    "jfsf[viz]": ("jfsf", "demo", "--report"),
    "jfsf[batch]": ("jfsf", "batch", "pairs.csv", "--out", "maps"),
    "jfsf[docs]": (sys.executable, "-m", "jfsf.apps.guide", "manual"),
}.items():
    Path("pairs.csv").write_text("a.off,b.off\n", encoding="utf-8")
    done = run(*command)
    check(
        done.returncode == 1 and f"pip install '{wanted}'" in done.stderr,
        f"{' '.join(command[-4:])}: {done.stderr.strip().splitlines()[-1]}",
    )
