"""Build the manual: these guides, and the pages of the whole package, as HTML.

    python -m jfsf.apps.guide FOLDER

It needs pdoc (the extra `docs`). Open FOLDER/index.html. Formulas are drawn by MathJax,
which a browser fetches when it opens a page that has some.
"""

import re
import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jfsf

# A record's fields, `name: what it is`, with more indented lines below.
_FIELD = re.compile(r"^(\w+(?:, \w+)*): (?=\S)", re.MULTILINE)
_PART = re.compile(r"^- `(\w+)`: ", re.MULTILINE)
_GUIDE_LINK = re.compile(r"\]\((\w+)\.md(#[\w-]+)?\)")


def build(folder: Path) -> None:
    """Write the manual into a folder.

    Args:
        folder: is made if need be; pages in it are replaced.

    Raises:
        ImportError: pdoc is not installed.
    """
    try:
        from pdoc import pdoc, render
        from pdoc.render_helpers import to_markdown_with_context
    except ImportError:
        raise ImportError("the manual needs pdoc: pip install 'jfsf[docs]'") from None
    from jinja2 import pass_context

    @pass_context
    def to_markdown(context: Any, docstring: str) -> str:
        text = linked(docstring, context["module"].modulename)
        text = to_markdown_with_context(context, text)
        # What an include brings in is there by now.
        return _GUIDE_LINK.sub(r"](\1.html\2)", text)

    env: Any = render.env
    env.filters["to_markdown"] = to_markdown
    render.configure(docformat="google", math=True)
    guide = import_module("jfsf.apps.guide")
    names = _PART.findall(guide.__doc__ or "")
    with TemporaryDirectory() as stubs:
        # pdoc has a page for each module: one that includes the file.
        for name in names:
            page = Path(__file__).with_name(f"{name}.md").as_posix()
            stub = Path(stubs, f"{name}.py")
            stub.write_text(f'""".. include:: {page}"""\n', encoding="utf-8")
        guide.__path__.append(stubs)
        vars(guide)["__all__"] = names  # in this order
        pdoc("jfsf", *modules(), output_directory=folder)


def modules() -> list[str]:
    """Dotted names of the parts of the package that can be imported here."""
    names: list[str] = []
    for name in _PART.findall(jfsf.__doc__ or ""):
        try:
            import_module(f"jfsf.{name}")
        except ImportError:  # `jfsf.testing` needs an extra
            continue
        names.append(f"jfsf.{name}")
    return names


def linked(docstring: str, module: str) -> str:
    """A docstring whose parts are full names, which pdoc links, and fields a list."""
    if module in ("jfsf", "jfsf.apps", "jfsf.apps.guide"):
        docstring = _PART.sub(rf"- `{module}.\1`: ", docstring)
    return _FIELD.sub(r"- **`\1`**: ", docstring)


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit("usage: python -m jfsf.apps.guide FOLDER")
    try:
        build(Path(sys.argv[1]))
    except (ImportError, OSError) as error:
        sys.exit(f"jfsf.apps.guide: {error}")
