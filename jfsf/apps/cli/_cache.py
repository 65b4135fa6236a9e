"""jfsf cache: what the cache folder holds, and how to empty it."""

from typing import Annotated

import typer
from rich.console import Console

from jfsf.storage._folder import (
    PROGRAM,
    SPECTRUM,
    limit_bytes,
    programs_folders,
    remove_stored,
    stored_files,
)


def cache(
    clear: Annotated[
        bool, typer.Option("--clear", help="Remove all spectra and programs.")
    ] = False,
) -> None:
    """Show the cache folder: how much it holds, and what it may hold.

    JFSF_CACHE names the folder and JFSF_CACHE_LIMIT its limit in gigabytes; beyond it
    the files that were not used for longest are removed. Other files are left alone.

    Example: jfsf cache --clear
    """
    from jfsf import storage

    limit = limit_bytes()
    files = stored_files()
    lines = [f"folder: {storage.folder()}"]
    lines += [
        f"folder of programs: {place}"
        for place in programs_folders()
        if place.parent != storage.folder()
    ]
    for name, suffix in (("spectra", SPECTRUM), ("programs", PROGRAM)):
        sizes = [file.size for file in files if file.path.suffix == suffix]
        lines.append(f"{name}: {len(sizes)}, {_size(sum(sizes))}")
    lines.append(f"limit: {_size(limit)}")
    if clear:
        freed = [remove_stored(file) for file in files]
        kept = sum(file.path.exists() for file in files)
        lines.append(f"removed: {len(files) - kept} files, {_size(sum(freed))} freed")
        if kept:
            lines.append(f"not removed: {kept} files of another user")
    console = Console()
    for line in lines:
        console.print(line, soft_wrap=True, markup=False, highlight=False)


def _size(num_bytes: float) -> str:
    return (
        f"{num_bytes / 1e6:.1f} MB" if num_bytes < 1e9 else f"{num_bytes / 1e9:.3g} GB"
    )
