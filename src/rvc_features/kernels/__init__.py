"""The compiled twins: one file for each module at the top whose loops Numba compiles.

    response, two_scales, contrast, maxima, orientation, key_points, drawing: twins of the modules of that name;
    sorting, spread, suppression: of filters; grey: of feature_detector
    smallest_box, large_box: the shortest ways to the response with the box of 3x3, and with larger ones; gaussian: to
    that with a Gaussian window
    corners, blocks: the way from there to the strongest corners that leaves most of an image out
    compiler: the decorator, and what all share; rows, resampling, smoothing, vectors, instructions: what kernels
    over whole images are made of
    cache, cache_folder: what was compiled, kept on disk
    warm_up: compiles all of them before the first frame

Nothing here is needed: where Numba is missing or does not work, `compiler.available()` is False, one line in the log
says so, and the modules at the top take their reference path. Each public kernel names its reference, and a test
compares the two.

Whole images are gone over row by row, so that everything but the image stays in the nearest caches, and along a row by
vectors of sixteen numbers. Rows that are read beyond their ends lie in buffers with room for that; in an image the
last vector of a row ends where the row does, and does some of the work of the one before it again.
"""
