"""The pages that people read: their code blocks, commands, names and links."""

import ast
import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
GALLERY = ROOT / "experiments" / "README.md"
GUIDES = sorted((ROOT / "jfsf" / "apps" / "guide").glob("*.md"))
PAGES = [README, GALLERY, *GUIDES]
SOURCES = sorted((ROOT / "jfsf").rglob("*.py"))

_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_SPAN = re.compile(r"`([^`]+)`")
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)


class Block(NamedTuple):
    """A fenced block: its language, and the text inside."""

    language: str
    text: str


def name(path: Path) -> str:
    """A page's path in the repository."""
    return str(path.relative_to(ROOT))


def blocks(text: str, language: str) -> list[str]:
    """The fenced blocks of one language."""
    found = (_block(match) for match in _FENCED.finditer(text))
    return [block.text for block in found if block.language == language]


def _block(found: re.Match) -> Block:
    return Block(found[1], found[2])


def prose(text: str) -> str:
    """A page without its fenced blocks."""
    return _FENCED.sub("", text)


def spans(text: str) -> list[str]:
    """What stands in backticks, outside of fenced blocks, on one line each."""
    return [" ".join(span.split()) for span in _SPAN.findall(prose(text))]


def links(text: str) -> list[str]:
    """Targets of links and pictures."""
    return _LINK.findall(prose(text))


def anchors(text: str) -> set[str]:
    """What `#...` may name on a page: its headings, as GitHub writes them."""
    plain = [re.sub(r"[^\w\- ]", "", h.lower()) for h in _HEADING.findall(prose(text))]
    return {heading.replace(" ", "-") for heading in plain}


def docstrings(path: Path) -> list[str]:
    """Those of a module, its classes and its functions."""
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = [n for n in ast.walk(tree) if isinstance(n, kinds)]
    return [text for text in map(ast.get_docstring, nodes) if text]
