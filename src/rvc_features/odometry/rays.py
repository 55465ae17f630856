"""Rays: the direction that each pixel looks in, from the camera's calibration.

A ray is the pair (x, y) of undistorted, normalised coordinates: what lies in the direction (x, y, 1) of the camera's
optical frame (REP 103: z forward, x right, y down) is seen at that pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Sequence

import cv2
import numpy as np

from rvc_features.brief import shown

MODELS = {'plumb_bob': (4, 5), 'rational_polynomial': (8,)}   # and how many coefficients each may have
_FISHEYE = ('equidistant', 'fisheye')


class CalibrationError(ValueError):
    """A calibration that gives no rays; the text says why, and what is accepted."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What turns pixels into rays.

    Attributes
    ----------
    camera_matrix : ndarray, float64, shape (3, 3)
    distortion : ndarray, float64, shape (0,), (4,), (5,) or (8,)
        In OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6.
    width, height : int
        Of the images that it is for, in pixels.
    """

    camera_matrix: np.ndarray
    distortion: np.ndarray
    width: int
    height: int

    def rays(self, positions: np.ndarray) -> np.ndarray:
        """The rays of pixels.

        Parameters
        ----------
        positions : ndarray, shape (N, 2)
            x and y in pixels; (0, 0) is the centre of the top left one.

        Returns
        -------
        ndarray, float64, shape (N, 2)
            As `cv2.undistortPoints` has them.
        """
        if len(positions) == 0:
            return np.empty((0, 2))
        points = np.ascontiguousarray(positions, np.float64)[:, None]
        return cv2.undistortPoints(points, self.camera_matrix, self.distortion)[:, 0]

    def undistorted(self, positions: np.ndarray) -> np.ndarray:
        """Positions in pixels, float64 (N, 2), as a camera of that matrix without distortion would have them."""
        return self.rays(positions) @ self.camera_matrix[:2, :2].T + self.camera_matrix[:2, 2]

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why it is not that of images of that shape; empty if it can be."""
        if shape[:2] == (self.height, self.width):
            return ''
        return (f'no rays: the calibration in camera_info is for {self.width} x {self.height} pixels, and the images '
                f'have {shape[1]} x {shape[0]}; calibrate at the size that is used')


def from_camera_info(width: int, height: int, model: str, matrix: Sequence[float], distortion: Sequence[float],
                     binning: tuple[int, int] = (1, 1), region: Any = None) -> Calibration:
    """The calibration of the fields of a sensor_msgs/CameraInfo.

    Parameters
    ----------
    width, height : int
        Of the full image.
    model : str
        plumb_bob or rational_polynomial; with no coefficients at all, or only zeros, anything.
    matrix : 9 floats
        K, row by row.
    distortion : floats
        D; none, 4 or 5 for plumb_bob, 8 for rational_polynomial.
    binning : (int, int)
        Pixels of the sensor in one of the image; 0 is 1.
    region : with x_offset, y_offset, width and height, optional
        The part of the full image that is sent; a width of 0 is all.

    Raises
    ------
    CalibrationError
        When the camera is not calibrated, a fisheye, or something is missing.
    """
    camera_matrix = np.array(matrix, np.float64)
    coefficients = np.array(distortion, np.float64)
    if camera_matrix.size != 9 or not np.isfinite(camera_matrix).all() or camera_matrix[0] <= 0 \
            or camera_matrix[4] <= 0:
        raise CalibrationError(f'no rays: camera_info is not calibrated, its K is {shown(list(matrix))}')
    camera_matrix = camera_matrix.reshape(3, 3)
    if model in _FISHEYE:
        raise CalibrationError(f'no rays: camera_info is of a fisheye ({model}), of whose points some have no '
                               f'normalised coordinates; accepted are {" and ".join(MODELS)}')
    if coefficients.any():
        if model not in MODELS:
            raise CalibrationError(f'no rays: camera_info has the distortion model {shown(model)}; accepted are '
                                   f'{" and ".join(MODELS)}')
        if coefficients.size not in MODELS[model] or not np.isfinite(coefficients).all():
            raise CalibrationError(f'no rays: D of camera_info is {shown(list(distortion))}, and {model} has '
                                   f'{" or ".join(map(str, MODELS[model]))} numbers')
    else:
        coefficients = np.zeros(0)
    if region is not None and region.width > 0 and region.height > 0:
        camera_matrix[:2, 2] -= region.x_offset, region.y_offset
        width, height = region.width, region.height
    across, down = (max(1, factor) for factor in binning)
    camera_matrix[0] /= across
    camera_matrix[1] /= down
    return Calibration(camera_matrix, coefficients, width // across, height // down)
