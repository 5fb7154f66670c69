"""Opus packets into samples, by the system's libopus. Not for applications."""
from __future__ import annotations

import ctypes
import functools

import numpy as np

from .errors import RustleError
from .types import Floats

_LONGEST_S = 0.12  #: that a packet may last


@functools.cache
def library() -> ctypes.CDLL:
    """libopus. Error: RustleError, where it is not installed."""
    try:
        opus = ctypes.CDLL("libopus.so.0")
    except OSError:
        raise RustleError("unsupported", "Opus is decoded by libopus, which is not here.",
                          "Install it (apt install libopus0), or listen as f32 or s16.", "format") from None
    opus.opus_decoder_create.restype = ctypes.c_void_p
    opus.opus_decoder_create.argtypes = [ctypes.c_int32, ctypes.c_int, ctypes.POINTER(ctypes.c_int)]
    opus.opus_decoder_destroy.restype = None
    opus.opus_decoder_destroy.argtypes = [ctypes.c_void_p]
    opus.opus_decode_float.restype = ctypes.c_int
    opus.opus_decode_float.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int32, ctypes.c_void_p, ctypes.c_int, ctypes.c_int]
    return opus


class Decoder:
    """One stream's packets, in their order."""

    def __init__(self, rate_hz: int, channels: int) -> None:
        """Error: ValueError, for a rate or number of channels that Opus does not have."""
        self.rate_hz, self.channels = rate_hz, channels
        self._library = library()
        problem = ctypes.c_int(0)
        self._decoder = self._library.opus_decoder_create(rate_hz, channels, ctypes.byref(problem))
        if not self._decoder:
            raise ValueError(f"Opus has no {rate_hz} Hz with {channels} channels")

    def __del__(self) -> None:
        if getattr(self, "_decoder", None):
            self._library.opus_decoder_destroy(self._decoder)

    def decode(self, packet: bytes) -> Floats | None:
        """[samples, channels] float32; None where the bytes are no packet."""
        out = np.zeros((round(self.rate_hz * _LONGEST_S), self.channels), np.float32)
        count = self._library.opus_decode_float(self._decoder, packet, len(packet), out.ctypes.data, len(out), 0)
        return out[:count] if count > 0 else None
