"""Suppression radii from a tree of the points; reference: filters.py."""

from __future__ import annotations

import numpy as np

from rvc_features.kernels.compiler import kernel
from rvc_features.kernels.sorting import order_of_keys, replace_least

_LEAF = 8   # points to a leaf of the tree, at the most


@kernel
def significantly_stronger(responses, robustness):
    """How many of the first ones are significantly stronger; reference: `filters.reference_stronger`."""
    result = np.empty(len(responses), np.int64)
    exceeding, stronger = 0, 0
    for i in range(len(responses)):
        while exceeding < len(responses) and robustness * responses[exceeding] > responses[i]:
            exceeding += 1
        while responses[stronger] > responses[i]:
            stronger += 1
        result[i] = min(exceeding, stronger)
    return result


@kernel
def suppression_radii(points, stronger, count):
    """Suppression radius of each point; reference: `filters.reference_radii`.

    Point i is suppressed by the first stronger[i] points. A balanced tree of bounding boxes over the points knows the
    first point (the lowest index) in each node. A search begins in the point's own leaf, climbs, and leaves out the
    nodes that are too far or hold nothing before stronger[i]. No arrangement of the points unbalances the tree.

    Only the `count` largest radii are sought exactly: a search ends once it is below as many radii as that, and what
    it has found by then stands for the radius.
    """
    size = len(points)
    leaves = 1
    while leaves * _LEAF < size:
        leaves *= 2
    order = _neighbours_together(points)
    starts = np.empty(leaves + 1, np.int64)
    for leaf in range(leaves + 1):
        starts[leaf] = size * leaf // leaves
    sorted_points, leaf_of = np.empty((size, 2), np.float64), np.empty(size, np.int64)
    for leaf in range(leaves):
        for i in range(starts[leaf], starts[leaf + 1]):
            leaf_of[order[i]] = leaf
            sorted_points[i, 0], sorted_points[i, 1] = points[order[i], 0], points[order[i], 1]
    boxes, first = _build_tree(sorted_points, order, starts)

    radii = np.full(size, np.inf)
    count = 0 if count >= size else max(count, 1)
    largest = np.full(max(count, 1), -1.0)   # the `count` largest radii so far: a heap, its least in front
    stack, distances = np.empty(128, np.int64), np.empty(128, np.float64)
    # The strong ones set the mark; the many others follow leaf by leaf, where memory is near and most fall at once.
    leading = min(4 * count, size)
    for i in range(leading):
        if stronger[i] > 0:
            radii[i] = _nearest(points[i, 0], points[i, 1], stronger[i], largest[0], leaf_of[i],
                                order, sorted_points, starts, boxes, first, stack, distances)
        if radii[i] > largest[0]:
            replace_least(largest, radii[i])
    for leaf in range(leaves):
        bound, suppressing = _certainly_suppressed(largest[0], leaves + leaf, boxes, first)
        for at in range(starts[leaf], starts[leaf + 1]):
            i = order[at]
            if i < leading:
                continue
            if stronger[i] > suppressing:
                radii[i] = bound
                continue
            if stronger[i] > 0:
                radii[i] = _nearest(points[i, 0], points[i, 1], stronger[i], largest[0], leaf,
                                    order, sorted_points, starts, boxes, first, stack, distances)
            if count > 0 and radii[i] > largest[0]:
                replace_least(largest, radii[i])
    return radii


@kernel
def _certainly_suppressed(enough, node, boxes, first):
    """A bound below `enough` on the radius of all points of a leaf that the returned index, or a lower one, suppresses.

    The largest node round the leaf that is less than `enough` across decides: wherever in it its first point lies.
    """
    bound, suppressing = 0.0, len(boxes) * _LEAF
    while node > 0:
        dx, dy = boxes[node, 2] - boxes[node, 0], boxes[node, 3] - boxes[node, 1]
        across = np.sqrt(dx * dx + dy * dy)
        if not across < enough:
            break
        bound, suppressing = across, first[node]
        node //= 2
    return bound, suppressing


@kernel
def _nearest(x, y, before, enough, leaf, order, points, starts, boxes, first, stack, distances):
    """Distance to the nearest of the points before `before`; any distance to one that is less than `enough` will do."""
    leaves = len(starts) - 1
    best = np.inf
    climbing = leaves + leaf   # the subtree of this node has been searched, or lies on the stack
    node, depth = climbing, 0
    while True:
        if node >= leaves:
            for i in range(starts[node - leaves], starts[node - leaves + 1]):
                if order[i] < before:
                    dx, dy = points[i, 0] - x, points[i, 1] - y
                    best = min(best, dx * dx + dy * dy)
            if np.sqrt(best) < enough:
                break
            node = 0
        else:
            near, far = 2 * node, 2 * node + 1
            to_near = _squared_distance(x, y, boxes, near) if first[near] < before else np.inf
            to_far = _squared_distance(x, y, boxes, far) if first[far] < before else np.inf
            if to_far < to_near:
                near, far, to_near, to_far = far, near, to_far, to_near
            if to_far < best:
                stack[depth], distances[depth] = far, to_far
                depth += 1
            node = near if to_near < best else 0
        while node == 0 and depth > 0:
            depth -= 1
            if distances[depth] < best:
                node = stack[depth]
        while node == 0 and climbing > 1:
            sibling = climbing ^ 1
            if first[sibling] < before and _squared_distance(x, y, boxes, sibling) < best:
                node = sibling
            climbing >>= 1
        if node == 0:
            break
    return np.sqrt(best)


@kernel
def _squared_distance(x, y, boxes, node):
    dx = max(boxes[node, 0] - x, x - boxes[node, 2], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 3], 0.0)
    return dx * dx + dy * dy


@kernel
def _build_tree(points, order, starts):
    """Bounding box (x, y, x, y) and lowest index of each node; the points come in the order of the leaves.

    Node 1 is the root, node k has the children 2 k and 2 k + 1, and the last `leaves` nodes are the leaves.
    """
    size, leaves = len(points), len(starts) - 1
    boxes = np.empty((2 * leaves, 4), np.float64)
    first = np.full(2 * leaves, size)
    for leaf in range(leaves):
        node = leaves + leaf
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for i in range(starts[leaf], starts[leaf + 1]):
            x, y = points[i, 0], points[i, 1]
            left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
            first[node] = min(first[node], order[i])
        boxes[node, 0], boxes[node, 1], boxes[node, 2], boxes[node, 3] = left, top, right, bottom
    for node in range(leaves - 1, 0, -1):
        a, b = 2 * node, 2 * node + 1
        first[node] = min(first[a], first[b])
        boxes[node, 0], boxes[node, 1] = min(boxes[a, 0], boxes[b, 0]), min(boxes[a, 1], boxes[b, 1])
        boxes[node, 2], boxes[node, 3] = max(boxes[a, 2], boxes[b, 2]), max(boxes[a, 3], boxes[b, 3])
    return boxes, first


@kernel
def _neighbours_together(points):
    """An order of the points in which neighbours mostly follow each other: along a Z curve, fine as needed.

    The curve has 2^16 steps to a side. Where more than a leaf of points fall into one cell, as in tight clusters,
    they are ordered along a curve of their own, and so on.
    """
    size = len(points)
    order = np.arange(size)
    pending = np.empty((size // _LEAF + 2, 2), np.int64)
    pending[0, 0], pending[0, 1] = 0, size
    count = 1
    while count > 0:
        count -= 1
        low, high = pending[count, 0], pending[count, 1]
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for i in range(low, high):
            x, y = points[order[i], 0], points[order[i], 1]
            left, top, right, bottom = min(left, x), min(top, y), max(right, x), max(bottom, y)
        extent = max(right - left, bottom - top)
        if not 1e-290 < extent < 1e300:
            continue   # all in one place, or out of any scale
        scale = 65535 / extent
        keys = np.empty(high - low, np.uint64)
        for i in range(low, high):
            x, y = points[order[i], 0], points[order[i], 1]
            keys[i - low] = (_with_gaps(np.uint64((x - left) * scale))
                             | (_with_gaps(np.uint64((y - top) * scale)) << np.uint64(1)))
        along = order_of_keys(keys)
        order[low:high] = order[low:high][along]
        start = 0
        for i in range(1, high - low + 1):
            if i == high - low or keys[along[i]] != keys[along[start]]:
                if i - start > _LEAF:
                    pending[count, 0], pending[count, 1] = low + start, low + i
                    count += 1
                start = i
    return order


@kernel
def _with_gaps(value):
    """The 16 bits of a number with a zero before each."""
    value = (value | (value << np.uint64(8))) & np.uint64(0x00FF00FF)
    value = (value | (value << np.uint64(4))) & np.uint64(0x0F0F0F0F)
    value = (value | (value << np.uint64(2))) & np.uint64(0x33333333)
    return (value | (value << np.uint64(1))) & np.uint64(0x55555555)
