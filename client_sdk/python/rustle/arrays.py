"""NumPy arrays checked before anything is sent, and turned into the wire's little-endian bytes. Pure.

Real numbers must already be float32 in one contiguous block: a conversion here would hide a copy for every frame and the
loss of digits in coordinates far from the origin. Indices may have any integer type; they are checked against what they index.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from .errors import InvalidArgument
from .types import Array

NO_REGION = 0xFFFFFFFF


def _shape_text(shape: tuple[int | None, ...], letter: str) -> str:
    return "[" + ",".join(letter if n is None else str(n) for n in shape) + "]"


def _expect_array(array: Any, field: str) -> Array:
    if not isinstance(array, np.ndarray):
        raise InvalidArgument(field, f"{type(array).__name__} is given where a NumPy array is expected.",
                              "Make one of it with np.asarray(..., np.float32).")
    return array


def _expect_shape(array: Array, shape: tuple[int | None, ...], field: str, letter: str, counted: str) -> None:
    fits = array.ndim == len(shape) and all(want is None or have == want for have, want in zip(array.shape, shape))
    if not fits:
        given = "[" + ",".join(map(str, array.shape)) + "]"
        raise InvalidArgument(field, f"The array has the shape {given}; {_shape_text(shape, letter)} is expected{counted}.",
                              "Give one row for each, the components side by side.")


def floats(array: Any, shape: tuple[int | None, ...], field: str, letter: str = "N", counted: str = "") -> bytes:
    """float32 of this shape, C-contiguous and finite.

    Error: InvalidArgument that names the first value at fault.
    """
    array = _expect_array(array, field)
    if array.dtype != np.dtype("<f4"):
        raise InvalidArgument(field, f"The array holds {array.dtype}; float32 is expected.",
                              "Convert it with .astype(np.float32); subtract a far origin before, for float32 has 7 digits.")
    _expect_shape(array, shape, field, letter, counted)
    if not array.flags.c_contiguous:
        raise InvalidArgument(field, "The array is not contiguous, row after row, in memory.",
                              "Pass np.ascontiguousarray(...) of it.")
    finite = np.isfinite(array)
    if not finite.all():
        at = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise InvalidArgument(field, f"Entry {list(at)} is {array[at]}.",
                              "Stop the simulation where it becomes unstable, or leave this frame out.")
    data: bytes = array.tobytes()
    return data


def indices(array: Any, shape: tuple[int | None, ...], limit: int, field: str, counted: str, letter: str = "N",
            none: int | None = None) -> bytes:
    """Whole numbers of this shape, from 0 to below `limit` (or equal to `none`), as u32.

    Any integer type and layout; a list serves as well. Error: InvalidArgument that names the first index at fault.
    """
    array = np.asarray(array)
    if array.size == 0 and array.dtype.kind == "f":
        array = array.astype(np.uint32)
    if array.dtype.kind not in "iu":
        raise InvalidArgument(field, f"The array holds {array.dtype}; whole numbers are expected.",
                              "Give indices from 0 as np.uint32.")
    _expect_shape(array, shape, field, letter, "")
    bad = (array < 0) | (array >= limit)
    if none is not None:
        bad &= array != none
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InvalidArgument(field, f"Entry {list(at)} is {array[at]}; there are {limit} {counted}.",
                              f"Indices count from 0 to {limit - 1}." if limit > 0 else "Give what it points to.")
    data: bytes = array.astype("<u4").tobytes()
    return data


def mask(array: Any, shape: tuple[int | None, ...], field: str, letter: str = "N", counted: str = "") -> bytes:
    """bool, or uint8 with 0 for no, of this shape, as u8 0 or 1."""
    array = _expect_array(array, field)
    if array.dtype not in (np.dtype(np.bool_), np.dtype(np.uint8)):
        raise InvalidArgument(field, f"The array holds {array.dtype}; bool or uint8 is expected.",
                              "Convert it with .astype(bool).")
    _expect_shape(array, shape, field, letter, counted)
    data: bytes = (array != 0).astype(np.uint8).tobytes()
    return data


def number(value: Any, field: str) -> float:
    """A finite real number."""
    try:
        real = float(value)
    except (TypeError, ValueError):
        raise InvalidArgument(field, f"{value!r} is no number.", "Give a real number.") from None
    if not np.isfinite(real):
        raise InvalidArgument(field, f"The value is {real}.", "Give a finite number.")
    return real


def vector(value: Any, length: int, field: str) -> tuple[float, ...]:
    """So many finite real numbers, of any sequence."""
    try:
        given = tuple(value)
    except TypeError:
        raise InvalidArgument(field, f"{value!r} is no row of numbers.", f"Give {length} numbers.") from None
    if len(given) != length:
        raise InvalidArgument(field, f"{len(given)} numbers are given; {length} are expected.", f"Give {length} numbers.")
    return tuple(number(part, f"{field}[{k}]") for k, part in enumerate(given))


def identifier(value: Any, field: str, bits: int = 32) -> int:
    """A whole number from 0 that fits the wire."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InvalidArgument(field, f"{value!r} is no whole number.", "Give a whole number from 0.")
    if not 0 <= int(value) < 1 << bits:
        raise InvalidArgument(field, f"{value} does not fit.", f"Give a whole number from 0 to {(1 << bits) - 1}.")
    return int(value)
