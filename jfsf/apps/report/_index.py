"""Many matches as one page: a row a pair, linked to the page of the pair."""

import os
from collections.abc import Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

from jfsf.apps.report._html import level, page
from jfsf.apps.report._words import verdict
from jfsf.storage._atomic import write_text


class Row(NamedTuple):
    """A pair in the index.

    x, y: names of the shapes.
    page, picture: paths relative to the index, with "/"; None if there are none.
    confidence: of its certificate; nan if it is not known.
    lines: what to say of it, such as its warnings.
    failed: there is no match; the lines say why.
    """

    x: str
    y: str
    page: str | None
    picture: str | None
    confidence: float
    lines: Sequence[str]
    failed: bool = False


def write_index(
    path: str | os.PathLike[str],
    rows: Sequence[Row],
    *,
    title: str = "Pairs by confidence",
) -> None:
    """Write a page with a row a pair: failed ones, then the least confident first.

    Args:
        path: the page, written completely or not at all.
        rows: the pairs, in any order.
        title: above all.
    """
    failed = sum(row.failed for row in rows)
    counts = f"{len(rows)} pairs, {len(rows) - failed} matched"
    if failed:
        counts += f", {failed} failed"
    record = {"title": title, "counts": counts, "pairs": [*map(plain, in_order(rows))]}
    write_text(path, page("index", record))


def in_order(rows: Sequence[Row]) -> list[Row]:
    """Failed ones, then the least confident first, then those without a confidence."""

    def place(row: Row):
        unknown = row.confidence != row.confidence
        return not row.failed, unknown, 0 if unknown else row.confidence

    return sorted(rows, key=place)


def plain(row: Row) -> dict[str, Any]:
    """A row as plain values for JSON."""
    likely = row.confidence
    if row.failed:
        words = "failed"
    elif likely != likely:
        words = "unknown"
    else:
        words = f"{verdict(likely)}, {likely:.0%}"
    return {
        "x": row.x,
        "y": row.y,
        "page": _address(row.page),
        "picture": _address(row.picture),
        "lines": list(row.lines),
        "verdict": words,
        "level": "failed" if row.failed else level(likely),
    }


def _address(path: str | None) -> str | None:
    """A path as an address, where #, ? and % mean something else."""
    return path and quote(path, errors="surrogateescape")
