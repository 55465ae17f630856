"""Compile the kernels before the first frame, which would wait for them otherwise.

    python3 -m rvc_features.kernels.warm_up

is what the build calls, so that not even the first start on a machine has to.
"""

from __future__ import annotations

import time

import numpy as np

from rvc_features.kernels import (
    compiler,
    contrast,
    corners,
    drawing,
    grey,
    key_points,
    maxima,
    orientation,
    oriented_corners,
    ranked_corners,
    response,
    sorting,
    spread,
    suppression,
    two_scales,
)


def compile_all() -> float:
    """Compile what a detector needs for images of a camera, or load it from the cache; the seconds it took.

    Without this the first frame waits for it: a minute or two where the build has not compiled for this machine,
    half a second otherwise.
    """
    start = time.perf_counter()
    if compiler.available():
        image = np.zeros((40, 40), np.uint8)
        image[10:, 10:] = 255
        grey.grey_of_colour(np.dstack([image] * 3))
        response.response(image, 3, 'box', 0.04)
        response.response(image, 5, 'box', 0.0)
        for window_size in (3, 31):
            response.response(image, window_size, 'gaussian', 0.04)
        corners.corners(np.tile(image, (6, 1)), 0.04, 10.0, number=1)
        for window in ('box', 'gaussian'):
            for derivative_sigma in (1.0, 0.0):
                values, _ = response.response(image, 5, window, 0.04, derivative_sigma)
        ones = np.ones(5)   # as many as the detector's own weights: two_scales compiles for their number
        of_octave = image.astype(np.float32)   # what smaller ones have at two scales
        for each in (image, of_octave):
            for count in (4, 5):   # the usual window, and all others
                scale = ones[:count], ones[:4], 1.0
                two_scales.strength(each, two_scales.Weights.of(ones, scale, scale, each.dtype))
        contrast.noise_of_runs(image, 16)
        for each in (of_octave, image):
            sums = contrast.energy_of_cells(each, 8)
        weights = np.ones(9, np.float32)
        averages = [contrast.averages(sums, *image.shape, 8, factor, weights) for factor in (1, 4)]
        lowest = np.ones((2, 2), np.float32)
        ranked_corners.ranked_corners(values, 10.0, 0, None, averages, (8, 32), lowest, 0.5, 0.0, 0.0)
        contrast.bilinear(np.ones((2, 2), np.float32), np.ones(1, np.float32), np.ones(1, np.float32))
        x, y = maxima.refine(values, *maxima.local_maxima(values, 10.0))
        table = np.ones((2, orientation.COLUMNS), np.float32)
        orientation.directions(*orientation.smoothed_gradients(image, x, y, 11, table, table))
        orientation.products_of_cells(image, 8)
        points, responses = np.column_stack((x, y)), np.ones(len(x))
        found = key_points.of_corners(x, y, responses, 3, 0).view([('numbers', np.float32, 6)])
        found = key_points.strongest(found, len(found))
        orientation.orient_along_gradient(found, image, 0, 11, table, table)
        key_points.sound_and_strongest_first(found, 40, 40)
        oriented_corners.strongest_oriented(np.tile(image, (6, 1)), 0.04, 10.0, 0, None, 1, 3, 11, table, table)
        sorting.strongest_first(responses)
        sorting.strongest_first(responses.astype(np.float32))
        ring = x.astype(np.int64), y.astype(np.int64)
        drawing.stamp(np.zeros((40, 40, 3), np.uint8), x, y, responses, *ring, 2.0, (0, 0, 0))
        spread.reach_largest_radius(np.repeat(points, 8, axis=0), np.repeat(responses, 8), 0.9, 1)
        suppression.suppression_radii(points, suppression.significantly_stronger(responses, 0.9), 1)
    return time.perf_counter() - start


if __name__ == '__main__':
    print(f'kernels compiled in {compile_all():.1f} s' if compiler.available() else 'no Numba: no kernels compiled')
