"""Files that only this user can have written: to load a compiled program is to run it.

Folder and file must belong to this user, or to root, who can write this package too. No
other user may write them, and neither may be a symbolic link. What is checked is what
was opened, not what has the name now: what is put in its place between check and read
is not read. Hard links need no check: who makes one there can write the folder, and who
changes it can write the file.
"""

import os
import stat
from pathlib import Path

from jfsf.storage._atomic import write_atomically


class NotPrivateError(OSError):
    """Another user can write this, or could; the message says how, and what to do."""


ROOT = 0  # its number as a user


def has_owners() -> bool:
    """Whether the system tells whose a file is; Windows does not."""
    return hasattr(os, "getuid")


def make_private(folder: Path) -> None:
    """Make the folder if it is missing; only this user can write it.

    Raises:
        NotPrivateError: it is there, and others can write it.
        OSError: it cannot be made.
    """
    folder.mkdir(mode=0o755, parents=True, exist_ok=True)
    if has_owners():
        os.close(_open_folder(folder))


def read_private(path: Path) -> bytes:
    """The bytes of a file that only this user can have written.

    Raises:
        NotPrivateError: others can write the file or its folder.
        OSError: there is none, or it cannot be read.
    """
    if not has_owners():
        with path.open("rb") as file:
            return file.read()
    folder = _open_folder(path.parent)
    try:
        # A pipe without a writer would block.
        flags = os.O_RDONLY | os.O_NONBLOCK
        opener = lambda *_: _open(path, flags, dir_fd=folder)
        with open(path, "rb", opener=opener) as file:
            return file.read()
    finally:
        os.close(folder)


def write_private(path: Path, data: bytes) -> None:
    """Write with `write_atomically` what `read_private` reads; makes its folder.

    Raises:
        NotPrivateError: others can write the folder.
        OSError: it cannot be written.
    """
    make_private(path.parent)
    write_atomically(path, lambda file: file.write(data), mode=0o644)


def _open_folder(path: Path) -> int:
    return _open(path, os.O_RDONLY | os.O_DIRECTORY)


def _open(path: Path, flags: int, dir_fd: int | None = None) -> int:
    name = path if dir_fd is None else path.name
    try:
        opened = os.open(name, flags | os.O_NOFOLLOW, dir_fd=dir_fd)
    except OSError:
        if path.is_symlink():  # systems have several errors for that
            raise NotPrivateError(
                f"{path} is a symbolic link; remove it, or let JFSF_CACHE name another "
                "folder"
            ) from None
        raise
    found = os.fstat(opened)
    if found.st_uid not in (os.getuid(), ROOT):
        problem = (
            f"{path} belongs to user {found.st_uid}, and this is user {os.getuid()}; "
            "let JFSF_CACHE name a folder of your own"
        )
    elif found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        mode = 700 if stat.S_ISDIR(found.st_mode) else 600
        problem = (
            f"other users can write {path} (mode {stat.S_IMODE(found.st_mode):04o}); "
            f"remove it, or `chmod {mode}` it if nobody did, or let JFSF_CACHE name "
            "another folder"
        )
    else:
        return opened
    os.close(opened)
    raise NotPrivateError(problem)
