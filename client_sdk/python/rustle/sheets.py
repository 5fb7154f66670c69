"""Sheets to begin with: a rectangle, and the rectangle bent. Metres, z up. Pure."""
from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .errors import InvalidArgument
from .types import Floats


def rectangle(width_m: float, height_m: float, columns: int = 16, rows: int = 16) -> tuple[Floats, npt.NDArray[np.uint32]]:
    """Material coordinates [V,2] float32, from (0, 0) to (width, height), and triangles [T,3] uint32, two a cell.

    V = (columns + 1)(rows + 1), T = 2 columns rows.
    """
    if columns < 1 or rows < 1:
        raise InvalidArgument("columns, rows", f"{columns} x {rows} cells make no sheet.", "Give at least one of each.")
    u, v = np.meshgrid(np.linspace(0, width_m, columns + 1), np.linspace(0, height_m, rows + 1))
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack([u.ravel(), v.ravel()], 1).astype(np.float32), triangles.astype(np.uint32)


def bent(material_coordinates: Floats, curvature_per_m: float, height_m: float = 0.0) -> Floats:
    """The flat sheet [V,2] bent along x into a cylinder of this curvature, without stretch: positions [V,3] float32.

    Centred on the z axis; its lowest vertices are at `height_m`. Positive: the middle is the highest.
    """
    s = material_coordinates[:, 0].astype(float) - float(material_coordinates[:, 0].mean())
    y = material_coordinates[:, 1].astype(float) - float(material_coordinates[:, 1].mean())
    k = curvature_per_m if abs(curvature_per_m) > 1e-9 else 1e-9
    z = (np.cos(k * s) - 1) / k
    positions: Floats = np.stack([np.sin(k * s) / k, y, z - z.min() + height_m], 1).astype(np.float32)
    return positions
