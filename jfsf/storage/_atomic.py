"""Write a file completely or not at all: under another name first, then renamed."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4


def write_atomically(
    path: str | os.PathLike[str], write: Callable[[BinaryIO], object]
) -> None:
    """Replace the file at `path`; readers see the old file or the whole new one.

    The bytes go to a temporary file in the same folder, whose name is unique and ends
    in `.tmp`. After any error it is removed, and the old file stays.

    Args:
        path: the file to write, in a folder that exists.
        write: is given the temporary file, open for writing bytes.

    Raises:
        OSError: the folder or the file cannot be written. Other errors of `write` pass
            through too.
    """
    path = Path(path)
    temporary = path.with_name(f".{uuid4().hex}.tmp")
    try:
        with temporary.open("xb") as file:
            write(file)
        # Windows renames only closed files.
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` in UTF-8 with `write_atomically`; line ends stay as they are."""
    write_atomically(path, lambda file: file.write(text.encode()))
