"""Homographies between two images: read from a file, checked, applied.

A homography maps pixel positions of the first image to those of the second; (0, 0) is the centre of the top left pixel.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree

import numpy as np

from rvc_features.recordings.regular_files import SourceError, read_text

ACCEPTED = ('a homography file holds three lines of three numbers, or is an OpenCV XML file with one 3x3 matrix; '
            'the matrix must be finite and invertible')


class HomographyError(SourceError):
    """A homography that can't be used; the text names the file."""


def read_homography(path: str) -> np.ndarray:
    """The 3x3 matrix in a text or OpenCV XML file.

    XML is parsed here and not with `cv2.FileStorage`, which in OpenCV 4.11 reads doubles written as integers
    (`1 0 0`) as garbage.

    Raises
    ------
    HomographyError
        When the file is missing or its content is not as `ACCEPTED` says.
    """
    try:
        text = read_text(path)
    except SourceError as error:
        raise HomographyError(f'{error}; {ACCEPTED}') from None
    is_xml = os.path.splitext(path)[1].lower() == '.xml' or text.lstrip().startswith('<')
    try:
        return checked(_from_xml(text) if is_xml else _from_lines(text))
    except ValueError as error:
        raise HomographyError(f'{path}: {error}; {ACCEPTED}') from None


def checked(matrix: np.ndarray) -> np.ndarray:
    """`matrix` as float64 if it is a usable homography; ValueError with the reason otherwise."""
    matrix = np.asarray(matrix, np.float64)
    if matrix.shape != (3, 3):
        raise ValueError(f'the matrix is {"x".join(map(str, matrix.shape))}, not 3x3')
    if not np.isfinite(matrix).all():
        raise ValueError('the matrix holds NaN or infinity')
    # In units of 1000 pixels the entries of a plausible homography are of similar size, so that the ratio of the
    # singular values tells a singular matrix from one that merely shifts by many pixels.
    unit = np.diag([1e-3, 1e-3, 1])
    singular_values = np.linalg.svd(unit @ matrix @ np.linalg.inv(unit), compute_uv=False)
    if singular_values[2] <= 1e-9 * singular_values[0]:
        raise ValueError('the matrix is singular')
    return matrix


def oriented(matrix: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The same homography with the sign that makes w positive at the centre of the first image, of shape (H, W).

    A homography is known up to a factor only; with this sign, w > 0 is what lies before the horizon.
    """
    centre = np.array([(shape[1] - 1) / 2, (shape[0] - 1) / 2, 1])
    return -matrix if matrix[2] @ centre < 0 else matrix


def project(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Positions (N, 2) under the homography; NaN for points on or behind the horizon (w <= 0)."""
    points = np.asarray(points, np.float64).reshape(-1, 2)
    homogeneous = np.column_stack((points, np.ones(len(points)))) @ matrix.T
    w = homogeneous[:, 2]
    projected = np.full((len(points), 2), np.nan)
    before = w > 0
    projected[before] = homogeneous[before, :2] / w[before, None]
    return projected


def turned(matrix: np.ndarray, points: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Directions, in degrees, that short arrows at the points, of these angles in degrees, have under the homography.

    They are those of J (cos, sin)^T with the Jacobian J at the point.
    """
    projected = project(matrix, points)
    # J_ij = (h_ij - p_i h_2j) / w; the positive factor 1 / w does not change the direction.
    j = matrix[None, :2, :2] - projected[:, :, None] * matrix[None, 2:, :2]
    x, y = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    return np.degrees(np.arctan2(j[:, 1, 0] * x + j[:, 1, 1] * y, j[:, 0, 0] * x + j[:, 0, 1] * y))


def moves_nothing(matrix: np.ndarray, shape: tuple[int, ...]) -> bool:
    """Whether no corner of an image of shape (H, W) moves by half a pixel: the identity, to all intents."""
    height, width = shape
    corners = np.array([(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)], np.float64)
    moved = project(oriented(matrix, shape), corners)
    return bool(np.isfinite(moved).all() and np.abs(moved - corners).max() < 0.5)


def _from_lines(text: str) -> np.ndarray:
    rows = [_numbers(line) for line in text.splitlines() if line.strip()]
    if not rows:
        raise ValueError('the file is empty')
    if len({len(row) for row in rows}) > 1:
        raise ValueError(f'its lines hold {", ".join(str(len(row)) for row in rows)} numbers')
    return np.array(rows)


def _from_xml(text: str) -> np.ndarray:
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f'not well-formed XML ({error})') from None
    matrices = [node for node in root.iter() if node.find('data') is not None and node.find('rows') is not None]
    if len(matrices) != 1:
        raise ValueError(f'it holds {len(matrices)} matrices')
    rows, columns = (_numbers(matrices[0].findtext(name) or '') for name in ('rows', 'cols'))
    values = _numbers(matrices[0].findtext('data') or '')
    if len(rows) != 1 or len(columns) != 1 or rows[0] * columns[0] != len(values):
        raise ValueError(f'its rows and cols do not fit its {len(values)} numbers')
    return np.array(values).reshape(int(rows[0]), int(columns[0]))


def _numbers(text: str) -> list[float]:
    numbers = []
    for word in text.split():
        try:
            numbers.append(float(word))
        except ValueError:
            raise ValueError(f'{word[:40]!r} is not a number') from None
    return numbers
