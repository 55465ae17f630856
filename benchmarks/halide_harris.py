"""Halide's own way of the Harris response (its apps/harris), for grey uint8 images and the borders of ours: a peer.

Gradients row by row in strips that stay in the cache, everything else inlined into the response: that is the published
schedule. How high a strip is, how many pixels a vector has and whether gradients are integers is left to the machine:
the bench takes the best of a few.
"""

from __future__ import annotations

import itertools
from typing import Any, Callable

import numpy as np

_STRIPS, _VECTORS = (16, 32, 128), (8, 16)


def variants() -> dict[str, Callable[[np.ndarray, np.ndarray], None]]:
    """Compiled functions of image and result by name; ImportError where there is no Halide."""
    return {f'Halide, strips of {strip}, {vector} lanes, {"int16" if integers else "float32"}':
            _compiled(strip, vector, integers)
            for strip, vector, integers in itertools.product(_STRIPS, _VECTORS, (False, True))}


def _compiled(strip: int, vector: int, integers: bool) -> Callable[[np.ndarray, np.ndarray], None]:
    import halide as hl
    x, y, outer, inner = (hl.Var(name) for name in ('x', 'y', 'outer', 'inner'))
    image = hl.ImageParam(hl.UInt(8), 2)
    grey, across, down, response = (hl.Func(name) for name in ('grey', 'across', 'down', 'response'))
    grey[x, y] = hl.cast(hl.Int(16) if integers else hl.Float(32), hl.BoundaryConditions.mirror_interior(image)[x, y])
    down[x, y] = (grey[x - 1, y + 1] - grey[x - 1, y - 1] + 2 * (grey[x, y + 1] - grey[x, y - 1])
                  + grey[x + 1, y + 1] - grey[x + 1, y - 1])
    across[x, y] = (grey[x + 1, y - 1] - grey[x - 1, y - 1] + 2 * (grey[x + 1, y] - grey[x - 1, y])
                    + grey[x + 1, y + 1] - grey[x - 1, y + 1])

    def windowed(a: Any, b: Any) -> Any:
        product, total = hl.Func(), hl.f32(0)
        product[x, y] = hl.cast(hl.Float(32), a[x, y]) * hl.cast(hl.Float(32), b[x, y])
        for v, u in itertools.product((-1, 0, 1), repeat=2):
            total = total + product[x + u, y + v]
        result = hl.Func()
        result[x, y] = total
        return result[x, y]

    a, b, c = windowed(across, across), windowed(across, down), windowed(down, down)
    response[x, y] = (a * c - b * b - hl.f32(0.04) * (a + c) * (a + c)) * hl.f32(1 / 81)
    response.split(y, outer, inner, strip).vectorize(x, vector)
    for stage in (grey, across, down):
        stage.store_at(response, outer).compute_at(response, inner).vectorize(x, vector)
    across.compute_with(down, x)
    function = response.compile_to_callable([image], hl.get_host_target())
    return lambda picture, result: function(hl.Buffer(picture), hl.Buffer(result))
