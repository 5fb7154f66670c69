"""WAV files of 32-bit float samples, which Python's own `wave` does not write."""
from __future__ import annotations

import os
import struct

import numpy as np

from .errors import InvalidArgument
from .types import Floats

_FLOAT = 3  #: WAVE_FORMAT_IEEE_FLOAT
_HEAD_BYTES = 58
_MOST_BYTES = 0xFFFFFFFF - _HEAD_BYTES


def write(path: str | os.PathLike[str], samples: Floats, rate_hz: int) -> None:
    """samples   [samples, channels], written bit for bit as float32

    Errors: InvalidArgument (more than a WAV file holds: 4 GiB), OSError.
    """
    data = np.ascontiguousarray(samples, "<f4")
    if data.nbytes > _MOST_BYTES:
        raise InvalidArgument("samples", f"{data.nbytes} bytes are more than a WAV file holds.", "Write several files.")
    channels = data.shape[1]
    form = struct.pack("<HHIIHHH", _FLOAT, channels, rate_hz, 4 * channels * rate_hz, 4 * channels, 32, 0)
    head = [b"RIFF", struct.pack("<I", _HEAD_BYTES - 8 + data.nbytes), b"WAVE", b"fmt ", struct.pack("<I", len(form)), form,
            b"fact", struct.pack("<II", 4, len(data)), b"data", struct.pack("<I", data.nbytes)]
    with open(path, "wb") as out:
        out.write(b"".join(head))
        out.write(data.tobytes())
