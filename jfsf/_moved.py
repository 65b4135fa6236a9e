"""Old names: an import of one raises an error that says what to use since 0.3.0."""

import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from typing import Any, NoReturn

SINCE = "since jfsf 0.3.0, see CHANGELOG.md"
# Modules: the new module of each old one, both below `jfsf`.
MODULES = {
    "arguments": "matching",
    "attempt": "matching",
    "coarse": "matching",
    "evidence": "matching",
    "policy": "matching",
    "settings": "matching",
    "stages": "matching",
    "parts": "matching.parts",
    "joint": "apps.collections",
    **{
        name: f"apps.{name}"
        for name in (
            "cli export guide interop landmarks mapfiles pieces plot registration "
            "report transfer"
        ).split()
    },
}
# Modules that left the package.
GONE = {"baselines": "the paper's baselines are in experiments/paper/baselines"}
# Names that stood at the top too.
INSIDE = {
    "ArapSettings": "refine",
    "Collection": "apps.collections",
    "CollectionSettings": "apps.collections",
    "MatchedComponents": "apps.pieces",
}
# Names of modules that are still there: what to use instead of each.
NAMES: dict[str, dict[str, str]] = {
    "convert": {
        "unbalanced_sinkhorn": "jfsf.convert.sinkhorn with `reach`",
        "Unbalanced": "jfsf.types.Filtered, its membership_x and membership_y",
    },
    "initial": {
        "best_start": "jfsf.initial.search_starts, the first of the two",
        "Orientation": "the words themselves: preserve, reverse, any",
    },
    "mesh": {
        "outliers": "Open3D's remove_statistical_outlier",
        "floor_points": "Open3D's segment_plane",
        "mirror_image": "jfsf.testing.mirror",
        "vertex_normals": "trimesh.Trimesh(*mesh).vertex_normals",
        "face_normals": "trimesh.Trimesh(*mesh).face_normals",
    },
    "apps.collections": {
        "synchronise": "the maps of jfsf.apps.collections.Collection",
        "PairSettings": "jfsf.apps.collections.CollectionSettings, its pairs_a_shape",
        "mirrored": "jfsf.apps.collections.reason",
    },
    "refine": {"ZoomOutSettings": "the constants of jfsf.refine._zoomout"},
    "neighbours": {"mutual_neighbours": "jfsf.neighbours.neighbours, each way"},
}


def error_of(name: str) -> str | None:
    """What is said of an old module, by its name below jfsf; None if it is not one."""
    first, _, rest = name.partition(".")
    if first in GONE:
        return f"jfsf.{name} is gone: {GONE[first]} ({SINCE})"
    if name in INSIDE:
        return f"jfsf.{name} is now jfsf.{INSIDE[name]}.{name} ({SINCE})"
    if name in ("EvidenceSettings", "ZoomOutSettings"):
        return f"jfsf.{name} is gone: its numbers are constants ({SINCE})"
    if first in MODULES:
        return f"jfsf.{name} is now in jfsf.{MODULES[first]} ({SINCE})"
    return None


class MovedModules:
    """The last of `sys.meta_path`: asked for modules that nothing else finds."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """None, or a ModuleNotFoundError for a module that has moved."""
        said = name.startswith("jfsf.") and error_of(name.removeprefix("jfsf."))
        if said:
            raise ModuleNotFoundError(said, name=name)
        return None


def names_of(module: str) -> Callable[[str], NoReturn]:
    """The `__getattr__` of a module with old names. Import errors, so that
    `from module import name` says the same as `module.name`.
    """
    old = NAMES[module.removeprefix("jfsf.")]

    def getattr_(name: str) -> NoReturn:
        if name in old:
            raise ImportError(f"{module}.{name} is gone: use {old[name]} ({SINCE})")
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    return getattr_


def install() -> None:
    """Called once, when `jfsf` is imported."""
    if MovedModules not in sys.meta_path:
        sys.meta_path.append(MovedModules)  # type: ignore[arg-type]
