"""Read an array of a .npz file to its end, so that its checksum is compared."""

from zipfile import ZipFile

import numpy as np


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
