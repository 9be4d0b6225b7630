"""Pictures decoded within bounds: JPEG and PNG only, no more pixels than their bytes can be worth."""

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from trihedral.guarded import allowed_memory

# Formats that are tried: Pillow has decoders of many more, and runs programs for some of them.
_FORMATS = ("JPEG", "PNG")
# A decoded pixel, and its share of the copy in hand.
_BYTES_PER_PIXEL = 6


def picture_size(data: bytes) -> tuple[tuple[int, int], str]:
    """Columns and rows of an encoded picture, and "jpeg" or "png"; pixels are not decoded.

    Raises
    ------
    ValueError
        It is neither, is damaged, or has more pixels than its bytes can be worth.
    """
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            size, kind = image.size, str(image.format)
    except Exception as error:
        # Whatever Pillow raises on damaged pictures, there are many kinds of it.
        raise ValueError(str(error) or type(error).__name__) from error
    if size[0] * size[1] * _BYTES_PER_PIXEL > allowed_memory(len(data)):
        raise ValueError(f"{len(data):,} bytes cannot be worth its {size[0]} x {size[1]} pixels")
    return size, kind.lower()


def decoded(data: bytes, mode: str) -> NDArray[np.uint8]:
    """Decode a picture: mode "RGB" gives (H, W, 3), "L" gives brightness (H, W); errors as of `picture_size`."""
    picture_size(data)
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            return np.asarray(image if image.mode == mode else image.convert(mode), np.uint8)
    except Exception as error:
        raise ValueError(str(error) or type(error).__name__) from error
