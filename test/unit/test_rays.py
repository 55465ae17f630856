"""Rays: as OpenCV undistorts them, for the calibrations that are taken, and a sentence for those that are not."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rvc_features.odometry.rays import CalibrationError, from_camera_info

K = [520.0, 0, 318.5, 0, 515.0, 242.25, 0, 0, 1]
DISTORTIONS = {'plumb_bob': [-0.31, 0.12, 0.001, -0.002, -0.02],
               'rational_polynomial': [0.4, -0.1, 0.0005, 0.001, 0.01, 0.7, -0.2, 0.03]}


def calibration(model='plumb_bob', distortion=None, **changes):
    return from_camera_info(640, 480, model, K, DISTORTIONS[model] if distortion is None else distortion, **changes)


@pytest.fixture
def pixels():
    return np.random.default_rng(1).uniform((0, 0), (639, 479), (500, 2))


@pytest.mark.parametrize('model', DISTORTIONS)
def test_rays_agree_with_opencv_and_lead_back_to_the_pixel(model, pixels):
    rays = calibration(model).rays(pixels)
    matrix, distortion = np.reshape(K, (3, 3)), np.array(DISTORTIONS[model])
    np.testing.assert_allclose(rays, cv2.undistortPoints(pixels[:, None], matrix, distortion)[:, 0], atol=1e-6)
    back = cv2.projectPoints(np.column_stack((rays, np.ones(500))), np.zeros(3), np.zeros(3), matrix, distortion)[0]
    assert np.median(np.hypot(*(back[:, 0] - pixels).T)) < 0.05   # OpenCV stops after five iterations


@pytest.mark.parametrize('distortion', [[], [0.0] * 5])
@pytest.mark.parametrize('model', ['', 'plumb_bob', 'none'])
def test_without_distortion_rays_are_a_division(model, distortion, pixels):
    rays = from_camera_info(640, 480, model, K, distortion).rays(pixels)
    np.testing.assert_allclose(rays, (pixels - (318.5, 242.25)) / (520, 515), atol=1e-12)


def test_no_pixels_have_no_rays():
    assert calibration().rays(np.empty((0, 2))).shape == (0, 2)


def test_binning_and_region_are_those_of_the_image():
    region = SimpleNamespace(x_offset=100, y_offset=40, width=400, height=200)
    part = calibration(binning=(2, 2), region=region)
    assert (part.width, part.height) == (200, 100)
    np.testing.assert_allclose(part.rays(np.array([[50.0, 20.0]])), calibration().rays(np.array([[200.0, 80.0]])))
    assert part.misfit((100, 200, 3)) == ''
    whole = calibration(binning=(0, 0), region=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0))
    assert whole.misfit((480, 640)) == ''


def test_a_calibration_of_another_size_is_told():
    assert calibration().misfit((240, 320)) == (
        'no rays: the calibration in camera_info is for 640 x 480 pixels, and the images have 320 x 240; calibrate at '
        'the size that is used')


@pytest.mark.parametrize(('changes', 'text'), [
    ({'model': 'equidistant', 'distortion': [0.1, 0, 0, 0]}, 'is of a fisheye .equidistant.'),
    ({'model': 'fisheye', 'distortion': [0.0] * 4}, 'is of a fisheye'),
    ({'model': 'division', 'distortion': [0.1]}, "has the distortion model 'division'; accepted are plumb_bob and rat"),
    ({'model': 'plumb_bob', 'distortion': [0.1] * 8}, 'plumb_bob has 4 or 5 numbers'),
    ({'model': 'rational_polynomial', 'distortion': [0.1] * 5}, 'rational_polynomial has 8 numbers'),
    ({'model': 'plumb_bob', 'distortion': [float('nan')] * 5}, 'plumb_bob has 4 or 5 numbers'),
    ({'matrix': [0.0] * 9}, 'is not calibrated'),
    ({'matrix': [float('inf')] * 9}, 'is not calibrated'),
])
def test_what_gives_no_rays_is_said(changes, text):
    values = {'model': 'plumb_bob', 'matrix': K, 'distortion': [], **changes}
    with pytest.raises(CalibrationError, match=f'no rays: .*{text}'):
        from_camera_info(640, 480, values['model'], values['matrix'], values['distortion'])
