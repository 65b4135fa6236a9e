"""Many matches as one page: a row for each pair, linked to the page of the pair."""

import os
from collections.abc import Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

from jfsf.apps.report._html import page
from jfsf.apps.report._words import level, verdict
from jfsf.storage._atomic import write_text


class Row(NamedTuple):
    """A pair, or a shape of a collection, in a list.

    name: of the pair or the shape.
    page: path of its own page relative to the list, with "/"; None if there is none.
    picture: path of its picture relative to the list; None if there is none.
    confidence: of its certificate; nan if it is not known.
    lines: what to say of it, such as its warnings.
    failed: there is no match; the lines say why.
    """

    name: str
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
    """Write a page with a row for each pair, failed and least confident ones first.

    Args:
        path: the page, written completely or not at all.
        rows: the pairs, in any order.
        title: above all.
    """
    failed = sum(row.failed for row in rows)
    counts = f"{len(rows)} pairs, {len(rows) - failed} matched"
    if failed:
        counts += f", {failed} failed"
    record = {"title": title, "counts": counts, "rows": listed(rows)}
    write_text(path, page("index", record))


def listed(rows: Sequence[Row], failed: str = "failed") -> list[dict[str, Any]]:
    """Rows as plain values for JSON, in the order in which to look at them.

    Failed ones come first, then the least confident, at last those without confidence.

    Args:
        rows: in any order.
        failed: what to call those that failed.
    """

    def place(row: Row):
        unknown = row.confidence != row.confidence
        return not row.failed, unknown, 0 if unknown else row.confidence

    def verdict_of(row: Row) -> str:
        if row.failed or row.confidence != row.confidence:
            return failed if row.failed else "unknown"
        return f"{verdict(row.confidence)}, {row.confidence:.0%}"

    return [
        {
            "name": row.name,
            "page": _address(row.page),
            "picture": _address(row.picture),
            "lines": list(row.lines),
            "verdict": verdict_of(row),
            "level": "failed" if row.failed else level(row.confidence),
        }
        for row in sorted(rows, key=place)
    ]


def _address(path: str | None) -> str | None:
    """A path as an address, where #, ? and % mean something else."""
    return path and quote(path, errors="surrogateescape")
