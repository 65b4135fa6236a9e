"""Images in files, by Pillow."""

import io
from pathlib import Path

import numpy as np

from jfsf.types import ArrayLike


def read_image(path: Path) -> ArrayLike:
    """The pixels of an image.

    Args:
        path: PNG, JPEG or whatever Pillow reads.

    Returns:
        (h, w, 3) uint8, or (h, w, 4) if it has transparency; the first row at the top.

    Raises:
        ImportError: Pillow is not installed.
        ValueError: no image, or one of more than 8 bits a channel.
        OSError: the file cannot be read.
    """
    pillow = _pillow()
    data = Path(path).read_bytes()
    try:
        with pillow.open(io.BytesIO(data)) as image:
            mode = image.mode
            clear = mode in ("RGBA", "LA", "PA") or "transparency" in image.info
            pixels = np.asarray(image.convert("RGBA" if clear else "RGB"))
    except Exception as error:
        # Pillow has errors of its own for each format.
        raise ValueError(
            f"{path}: is not a readable image ({type(error).__name__}); save it as PNG"
        ) from None
    if mode.startswith(("I", "F")):  # which were clipped
        raise ValueError(f"{path}: has more than 8 bits a channel; save it with 8 bits")
    return pixels


def png_of(image: ArrayLike) -> bytes:
    """The PNG file of pixels (h, w, 1, 3 or 4) uint8.

    Raises:
        ImportError: Pillow is not installed.
    """
    pillow, file = _pillow(), io.BytesIO()
    pixels = np.ascontiguousarray(image)
    if pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    pillow.fromarray(pixels).save(file, "png", optimize=False)
    return file.getvalue()


def _pillow():
    try:
        from PIL import Image
    except ImportError:
        raise ImportError("textures need Pillow: pip install 'jfsf[texture]'") from None
    return Image
