"""The cache on disk: its folder, its limit, and records under a digest of their inputs.

It is the user's cache folder, or the one that JFSF_CACHE names. Spectra are in it, that
several users may share, and compiled programs in its folder `programs`, which they may
not. Its files can be deleted at any time. Once all of them take more than
JFSF_CACHE_LIMIT, in gigabytes, those that were not used for longest are removed.

Files that only this user can have written: to load a compiled program is to run it.

Folder and file must belong to this user, or to root, who can write this package too. No
other user may write them, and neither may be a symbolic link. What is checked is what
was opened, not what has the name now: what is put in its place between check and read
is not read. Hard links need no check: who makes one there can write the folder, and who
changes it can write the file.
"""

import hashlib
import os
import re
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import numpy as np
import platformdirs

from jfsf.storage._atomic import read_npz_array, write_atomically


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


# Some 2000 spectra of 5000 vertices, or ten of a million.
LIMIT_GIGABYTES = 10
SPECTRUM, PROGRAM = ".npz", ".program"
PROGRAMS = "programs"
_OWN = re.compile(rf"[0-9a-f]{{64}}({re.escape(SPECTRUM)}|{re.escape(PROGRAM)})")


class StoredFile(NamedTuple):
    """A file of the cache; `used` is when it was last read or written, in ns."""

    used: int
    size: int
    path: Path


def folder() -> Path:
    """The folder of the cache: $JFSF_CACHE, or the platform's cache folder.

    Raises:
        ValueError: JFSF_CACHE is not set, and the user has no home directory.
    """
    return Path(os.environ.get("JFSF_CACHE") or _platform_folder())


def programs_folders() -> tuple[Path, ...]:
    """The folders that compiled programs are read from; to the first they are written.

    Where a file's owner is not known, only the platform's own folder is surely private.
    What root has made, as when the image of a container is built, is read, and the
    platform's own folder is written to.
    """
    if not has_owners():
        return (_platform_folder() / PROGRAMS,)
    usual = folder() / PROGRAMS
    # Without a home directory there is no other.
    with suppress(OSError, ValueError):
        if os.getuid() != 0 and usual.stat().st_uid == 0:
            return _platform_folder() / PROGRAMS, usual
    return (usual,)


def limit_bytes() -> float:
    """What all files of the cache may take.

    Raises:
        ValueError: JFSF_CACHE_LIMIT is no number above 0.
    """
    text = os.environ.get("JFSF_CACHE_LIMIT") or str(LIMIT_GIGABYTES)
    with suppress(ValueError):
        if (gigabytes := float(text)) > 0:
            return gigabytes * 1e9
    raise ValueError(
        f"JFSF_CACHE_LIMIT is {text!r}; give gigabytes above 0, as 2.5, or inf for no "
        "limit"
    )


def stored_files() -> list[StoredFile]:
    """The files that the cache itself has named, the least recently used first."""
    places = [folder()]
    places += [place for place in programs_folders() if not place.is_symlink()]
    found = []
    for place in places:
        # Other processes remove files at the same time.
        with suppress(OSError), os.scandir(place) as entries:
            own = [entry for entry in entries if _OWN.fullmatch(entry.name)]
            for entry in own:
                with suppress(OSError):
                    about = entry.stat(follow_symlinks=False)
                    row = about.st_mtime_ns, about.st_size, Path(entry.path)
                    if stat.S_ISREG(about.st_mode):
                        found.append(StoredFile(*row))
    return sorted(found)


def remove_stored(file: StoredFile) -> int:
    """Remove it; returns the bytes that are freed."""
    try:
        file.path.unlink(missing_ok=True)
    except OSError:
        return 0
    return file.size


def make_room() -> None:
    """Remove the least recently used files until the others are within the limit."""
    files = stored_files()
    excess = sum(file.size for file in files) - limit_bytes()
    for file in files:
        if excess <= 0:
            return
        excess -= remove_stored(file)


def mark_used(path: Path) -> None:
    """Let the file be one of the last to be removed, if this user may."""
    with suppress(OSError):
        os.utime(path)


def _platform_folder() -> Path:
    try:
        return Path(platformdirs.user_cache_dir("jfsf"))
    except RuntimeError:
        raise ValueError(
            "there is no home directory for the cache of spectra and programs; let "
            "JFSF_CACHE name a folder that this user can write"
        ) from None


def key(*parts: Any) -> str:
    """A digest of arrays (shape, dtype, bytes) and plain values, in their order."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            text, data = f"array {part.shape} {part.dtype.str}", part.tobytes()
        else:
            text, data = repr(part), b""
        # The length of each text keeps the parts apart: (1, 23) is not (12, 3).
        digest.update(f"{len(text)} {text}".encode() + data)
    return digest.hexdigest()


def fetch(key: str, record: Any, compute: Callable[[], Any]) -> Any:
    """The NamedTuple `record` stored under `key`, computed and stored if need be.

    A file that cannot be read is computed again and replaced. If the folder cannot be
    written, the result is returned all the same, without being stored.

    Args:
        key: names the file; see `key`.
        record: class of NamedTuple, all its fields arrays.
        compute: gives the record; its errors pass through, and nothing is stored then.

    Raises:
        ValueError: JFSF_CACHE_LIMIT is no number above 0.
    """
    limit_bytes()  # a wrong limit is found before the work
    path = folder() / f"{key}{SPECTRUM}"
    try:
        with ZipFile(path) as file:
            found = record(*(read_npz_array(file, name) for name in record._fields))
        mark_used(path)
        return found
    except Exception:  # a damaged file makes numpy and zipfile raise nearly anything
        pass
    value = compute()
    try:
        store(path, **value._asdict())
        make_room()
    except OSError:
        pass
    return value


def store(path: Path, **arrays: Any) -> None:
    """Write an .npz with `write_atomically`, in a folder that is made if need be.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda file: np.savez(file, **arrays))
