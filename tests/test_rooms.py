"""The structure: imports point up, rooms say what they are for, names are reachable."""

import ast
import importlib
import pkgutil
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import jfsf

PACKAGE = Path(jfsf.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
LISTED = re.compile(r"^- `(\w+)`: ", re.MULTILINE)
LINES = 300  # a longer file says why in its docstring


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def listed(package: Path) -> list[str]:
    """The names that the docstring of a package lists, in its order."""
    tree = parsed(package / "__init__.py")
    return LISTED.findall(ast.get_docstring(tree) or "")


def modules(package: Path) -> set[str]:
    """Modules, packages and guides in a folder."""
    files = {p.stem for p in package.glob("*.py")} - {"__init__", "__main__"}
    if package.name == "guide":
        files |= {p.stem for p in package.glob("*.md")}
    return files | {p.parent.name for p in package.glob("*/__init__.py")}


def imported(path: Path) -> list[str]:
    """What a file imports from the package, as dotted names below it."""
    found = []
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found += [n for n in names if n.startswith("jfsf.")]
        elif isinstance(node, ast.Import):
            found += [a.name for a in node.names if a.name.startswith("jfsf.")]
        assert not (isinstance(node, ast.ImportFrom) and node.level), path
    return [name.removeprefix("jfsf.") for name in found]


def place(path: Path) -> list[str]:
    """The folders of a file in the package, then its name, unless it is `__init__`."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return [part for part in parts if part not in ("__init__", "__main__")]


def listed_first(name: list[str], own: list[str]) -> bool:
    """Whether a module stands above another in the lists of their packages."""
    shared = 0
    while name[shared : shared + 1] == own[shared : shared + 1]:
        shared += 1
        if shared == min(len(name), len(own)):
            return len(name) > len(own)  # a package may import what is in it
    order = listed(PACKAGE.joinpath(*own[:shared]))
    return order.index(name[shared]) < order.index(own[shared])


ORDER = listed(PACKAGE)
FOLDERS = sorted(path.parent for path in FILES if path.name == "__init__.py")
ROOMS = [folder for folder in FOLDERS if folder != PACKAGE]


def test_the_package_lists_its_rooms():
    public = lambda names: {name for name in names if not name.startswith("_")}
    assert public(ORDER) == public(modules(PACKAGE))
    assert len([p for p in PACKAGE.iterdir() if p.is_file()]) <= 12


def test_a_room_lists_its_files():
    for room in ROOMS:
        names = listed(room)
        assert set(names) == modules(room) and len(names) == len(set(names)), room
        # What is not private is a room of its own, or a page of the guide.
        public = {name for name in names if not name.startswith("_")}
        assert room.name == "guide" or all((room / name).is_dir() for name in public)


def test_imports_point_up():
    for path in FILES:
        own = place(path)
        for name in imported(path) if own else ():
            module = name.split(".")
            while module and not is_module(module):
                module.pop()  # what is imported from the module
            if name != "__version__":
                assert listed_first(module, own), f"{path} imports {name}"


def is_module(name: list[str]) -> bool:
    path = PACKAGE.joinpath(*name)
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def test_the_library_never_imports_an_application():
    for path in FILES:
        if place(path)[:1] not in ([], ["apps"]):
            apps = [n for n in imported(path) if n.split(".")[0] == "apps"]
            assert not apps, path


def test_public_functions_and_classes_have_docstrings():
    for path in FILES:
        tree = parsed(path)
        assert ast.get_docstring(tree), f"{path} has no docstring"
        for node in tree.body:
            if not isinstance(node, ast.FunctionDef | ast.ClassDef):
                continue
            overload = any(ast.unparse(d) == "overload" for d in node.decorator_list)
            if node.name.startswith("_") or overload:
                continue
            assert ast.get_docstring(node), f"{path}: {node.name} has no docstring"


def test_a_long_file_says_why():
    for path in FILES:
        text = path.read_text()
        if len(text.splitlines()) > LINES:
            head = ast.get_docstring(parsed(path)) or ""
            said = "file is long because" in " ".join(head.split())
            assert said, f"{path}: over {LINES} lines without a reason"


def test_all_public_names_resolve_without_further_imports():
    # In a new process: here tests have imported everything.
    rooms = [room for room in ORDER if not room.startswith("_")]
    code = (
        "import jfsf\n"
        f"for room in {rooms}: getattr(jfsf, room)\n"
        "jfsf.data.load, jfsf.batch.match_spectra, jfsf.convert.sinkhorn\n"
        "jfsf.basis, jfsf.apps.mapfiles.read_map, jfsf.evaluate.evaluate\n"
        "jfsf.apps.plot.draw_pair"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_package_imports_its_parts_on_first_use():
    code = (
        "import sys, jfsf\n"
        "assert not {'numpy', 'jax', 'jfsf.types'} & set(sys.modules)\n"
        "from jfsf import *\n"
        "assert set(jfsf.__all__) <= set(globals()) and match is jfsf.match\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    public = {name for name in ORDER if not name.startswith("_")}
    assert set(jfsf.__all__) | public <= set(dir(jfsf))


def test_no_function_shadows_a_module():
    for room in ROOMS:
        module = importlib.import_module(".".join(["jfsf", *place(room)]))
        for info in pkgutil.iter_modules(module.__path__):
            if info.name != "__main__":
                own = importlib.import_module(f"{module.__name__}.{info.name}")
                assert getattr(module, info.name) is own
        lacks = [n for n in getattr(module, "__all__", ()) if not hasattr(module, n)]
        assert not lacks, room


@pytest.mark.parametrize(
    "package, files",
    [("jaxopt", ["_linear.py"]), ("optimistix", ["solvers.py"]), ("optax", [])],
)
def test_one_file_imports_a_solver(package, files):
    found = [path.name for path in FILES if package in roots_imported(path)]
    assert found == files


def roots_imported(path: Path) -> set[str]:
    """Top-level names of the packages that a file imports."""
    found = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
        elif isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
    return found


def test_text_is_read_and_written_as_utf8():
    for path in FILES:
        # Ruff's PLW1514 sees only objects that it knows to be paths or files. Functions
        # of these names that are not methods are the package's own.
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                if node.func.attr in ("read_text", "write_text"):
                    names = [keyword.arg for keyword in node.keywords]
                    assert "encoding" in names, (
                        f"{path}:{node.lineno}: name the encoding"
                    )


def test_products_are_precise_in_one_place():
    declared = [p.name for p in FILES if "Precision.HIGHEST" in p.read_text()]
    assert declared == ["_precision.py"]
