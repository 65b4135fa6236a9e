"""Files that people bring: their text, what stands between the cells of a table, and
what some of them are instead.

Spreadsheets and editors on Windows write byte order marks and UTF-16, and semicolons
where numbers have decimal commas.
"""

import codecs
import re
from collections.abc import Sequence
from pathlib import Path

# UTF-32 first: its mark begins with that of UTF-16.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
# As Visual C++ writes numbers: until 2015 with zeros behind, or cut to fewer places, as
# 1.#J for 1.#INF; since then -nan(ind).
_NOT_FINITE = re.compile(
    r"(?<![\w.#])([-+]?)(?:1\.#(?:(INF|J)|IND|QNAN|SNAN|IO|QO|SO|R)0*\b"
    r"|nan\((?:ind|snan)\))",
    re.IGNORECASE,
)
_DECLARED = re.compile(r'"?sep=([,;|\t])"?', re.IGNORECASE)
_QUOTED = re.compile(r'"(?:[^"]|"")*"')


def in_utf8(data: bytes) -> bytes:
    """A file of text without its byte order mark, in UTF-8 if that says UTF-16 or 32.

    Without a mark, or where it is no text, the data as it is.
    """
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            rest = data[len(mark) :]
            if encoding == "utf-8":
                return rest
            try:
                text = rest.decode(encoding)
            except UnicodeDecodeError:
                return data
            return data if "\0" in text else text.encode()
    return data


def read_text(path: Path) -> str:
    """The text of a file in UTF-8, or in UTF-16 with a byte order mark.

    Raises:
        ValueError: it is in another encoding, or a stand-in (`instead_of_data`).
        OSError: it cannot be read.
    """
    data = path.read_bytes()
    if found := instead_of_data(data):
        raise ValueError(f"{path}: {'; '.join(found)}")
    try:
        return in_utf8(data).decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not UTF-8 ({error}); save it as that") from None


def instead_of_data(data: bytes) -> tuple[str, str] | None:
    """What a file is in place of data, and what to do; None if it may hold data.

    A pointer of Git LFS, as a clone without LFS has, or the page of a web site about
    the file.
    """
    head = in_utf8(data[:1024]).lstrip().lower()
    if head.startswith(b"version https://git-lfs.github.com/"):
        return "it is a pointer of Git LFS, not the file itself", "run git lfs pull"
    if head.startswith((b"<!doctype html", b"<html")):
        return "it is a web page, not the file itself", "download the file itself"
    return None


def find_separator(lines: Sequence[str], marks: str) -> tuple[str, int]:
    """What stands between the cells of a table, and how many lines say only that.

    Args:
        lines: of the table; those without a cell are left out.
        marks: characters to look for in the first line, outside of quotes, in order.

    Returns:
        That of a first line `sep=;`, as Excel writes, and 1; or the first of the marks
        that the first line has and 0; "" if it has none.
    """
    if not lines:
        return "", 0
    if declared := _DECLARED.fullmatch(lines[0].strip(" \r\n")):
        return declared[1], 1
    first = _QUOTED.sub('""', lines[0])
    return next((mark for mark in marks if mark in first), ""), 0


def plain_numbers(text: str) -> str:
    """The text with 1.#QNAN, -nan(ind) and 1.#INF of Windows as nan and inf."""
    if not any(mark in text for mark in ("1.#", "nan(", "NAN(")):
        return text
    return _NOT_FINITE.sub(lambda m: f"{m[1]}inf" if m[2] else "nan", text)
