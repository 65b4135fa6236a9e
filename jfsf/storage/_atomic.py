"""Files written completely or not at all, and arrays read to their end.

A file is written under another name first, then renamed.
"""

import errno
import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4
from zipfile import ZipFile

import numpy as np

_unfinished: set[Path] = set()
_TEMPORARY = re.compile(r"\.[0-9a-f]{32}\.tmp")


def write_atomically(
    path: str | os.PathLike[str],
    write: Callable[[BinaryIO], object],
    mode: int = 0o666,
) -> None:
    """Replace the file at `path`; readers see the old file or the whole new one.

    The bytes go to a temporary file in the same folder, whose name is unique and ends
    in `.tmp`. After any error it is removed, and the old file stays.

    Args:
        path: the file to write, in a folder that exists.
        write: is given the temporary file, open for writing bytes.
        mode: who may read and write the file, less what the process's umask forbids.

    Raises:
        OSError: the folder or the file cannot be written; it names `path`. Other
            errors of `write` pass through too.
    """
    path = Path(path)
    temporary = _temporary(path)
    _unfinished.add(temporary)
    try:
        opener = lambda name, flags: os.open(name, flags, mode)
        with open(temporary, "xb", opener=opener) as file:
            write(file)
        # Windows renames only closed files.
        os.replace(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):
            raise _about(path, temporary, error) from None
        raise
    finally:
        _unfinished.discard(temporary)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` as `utf8` with `write_atomically`; line ends stay as they are."""
    write_atomically(path, lambda file: file.write(utf8(text)))


def utf8(text: str) -> bytes:
    """Text in UTF-8, and in it the names of files with the letters that they have.

    Where the locale is not UTF-8, Python holds the bytes of other letters in a name as
    single surrogates (PEP 383), which no encoding writes. The bytes are put back; those
    that are not UTF-8, as of a name from an older system, become escapes.
    """
    try:
        data = text.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:  # a surrogate that stands for no byte
        return text.encode("utf-8", "backslashreplace")
    return data.decode("utf-8", "backslashreplace").encode()


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise OSError unless `write_atomically` could write a file at `path` now.

    For checks before long work. An empty file is made beside it and removed, because
    permissions do not tell: the system may be read-only, or root ask.

    Raises:
        OSError: it names `path`, which may also be a folder.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    temporary = _temporary(path)
    try:
        temporary.open("xb").close()
        temporary.unlink()
    except OSError as error:
        raise _about(path, temporary, error) from None


def remove_unfinished() -> None:
    """Remove what is being written, in all threads, before the process is ended."""
    for temporary in list(_unfinished):
        with suppress(OSError):
            temporary.unlink()


def remove_left_over(folder: Path) -> None:
    """Remove what a process that was killed left unfinished in a folder or below."""
    for path in folder.rglob(".*.tmp"):
        if _TEMPORARY.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def _temporary(path):
    return path.with_name(f".{uuid4().hex}.tmp")


def _about(path, temporary, error):
    """The error with the name of the file that was asked for."""
    if error.errno is None or error.filename not in (None, str(temporary)):
        return error
    return OSError(error.errno, error.strerror, str(path))


def read_npz_array(file: ZipFile, name: str) -> np.ndarray:
    """The array of that name in an open .npz.

    numpy's own reader stops where the header says that the array ends. So a damaged
    shape gives fewer numbers, and nothing is noticed.

    Args:
        file: opened for reading.
        name: without the suffix .npy.

    Raises:
        Exception: nearly any, if the file is damaged; ValueError for an array of
            objects.
    """
    with file.open(f"{name}.npy") as part:
        values = np.lib.format.read_array(part, allow_pickle=False)
        if part.read(1):
            raise ValueError(f"{name} is longer than its shape {values.shape}")
    return values
