"""Ground truth: reading it, refusing what is none, and applying it."""

import numpy as np
import pytest
from conftest import texture  # noqa: F401 (puts src on the path)

from rvc_features.comparison import homographies
from rvc_features.comparison.homographies import HomographyError, oriented, project, read_homography, turned

XML = '''<?xml version="1.0"?>
<opencv_storage>
<H type_id="opencv-matrix"><rows>{rows}</rows><cols>{columns}</cols><dt>d</dt><data>{data}</data></H>
</opencv_storage>
'''


def write(path, text):
    path.write_text(text)
    return str(path)


def test_plain_text_and_opencv_xml_say_the_same(tmp_path):
    expected = [[1, 0.5, 10], [0, 2, -3], [1e-4, 0, 1]]
    plain = write(tmp_path / 'H1to2p', '1 0.5 10\n0 2 -3\n\n1e-4 0 1\n')
    # Integers among the doubles: OpenCV 4.11's FileStorage makes garbage of them.
    xml = write(tmp_path / 'H1to2p.xml', XML.format(rows=3, columns=3, data='1 0.5 10 0 2 -3 1e-4 0 1'))
    assert read_homography(plain).tolist() == expected
    assert read_homography(xml).tolist() == expected


def test_opencv_reads_what_we_read_where_it_reads_rightly(tmp_path):
    cv2 = pytest.importorskip('cv2')
    matrix = np.array([[0.5, 0.25, 1.5], [0.125, 0.75, -2.5], [0.001, 0.002, 1.25]])
    path = tmp_path / 'H.xml'
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write('H', matrix)
    storage.release()
    np.testing.assert_allclose(read_homography(str(path)), matrix, rtol=1e-15)


@pytest.mark.parametrize(('name', 'text', 'reason'), [
    ('H', '1 0 0\n0 1 0\n', 'the matrix is 2x3, not 3x3'),
    ('H', '1 0 0 0 1 0 0 0 1\n', 'the matrix is 1x9, not 3x3'),
    ('H', '1 0 0\n0 1\n0 0 1\n', 'its lines hold 3, 2, 3 numbers'),
    ('H', '', 'the file is empty'),
    ('H', '1 0 0\n0 one 0\n0 0 1', "'one' is not a number"),
    ('H', '1 0 0\n0 nan 0\n0 0 1', 'NaN or infinity'),
    ('H', '1 0 0\n0 1 inf\n0 0 1', 'NaN or infinity'),
    ('H', '1 2 3\n2 4 6\n0 0 1', 'the matrix is singular'),
    ('H', '0 0 0\n0 0 0\n0 0 0', 'the matrix is singular'),
    ('H.xml', '<opencv_storage><H>', 'not well-formed XML'),
    ('H.xml', '<opencv_storage></opencv_storage>', 'it holds 0 matrices'),
    ('H.xml', XML.format(rows=3, columns=3, data='1 0 0 0 1 0'), 'do not fit its 6 numbers'),
    ('H.xml', XML.format(rows=2, columns=3, data='1 0 0 0 1 0'), 'the matrix is 2x3, not 3x3'),
    ('H.xml', XML.format(rows='x', columns=3, data='1'), "'x' is not a number"),
])
def test_what_is_no_homography_is_refused_with_file_reason_and_what_is_accepted(tmp_path, name, text, reason):
    path = write(tmp_path / name, text)
    with pytest.raises(HomographyError) as error:
        read_homography(path)
    assert str(error.value).startswith(f'{path}: ')
    assert reason in str(error.value)
    assert homographies.ACCEPTED in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(HomographyError, match='H1to2p: no such file'):
        read_homography(str(tmp_path / 'H1to2p'))


def test_a_large_shift_is_not_singular():
    homographies.checked(np.array([[1, 0, 5000], [0, 1, -8000], [0, 0, 1.0]]))


def test_projection_and_the_horizon():
    matrix = np.array([[1, 0, 2], [0, 1, 3], [0, -0.01, 1.0]])
    projected = project(matrix, np.array([[10, 50], [10, 100], [10, 200]]))
    np.testing.assert_allclose(projected[0], (24, 106))
    assert np.isnan(projected[1:]).all()


def test_a_factor_of_either_sign_changes_nothing():
    matrix = np.array([[0.9, 0.1, 5], [-0.1, 1.1, 2], [1e-4, 2e-4, 1]])
    points = np.array([[3, 4], [90, 50.0]])
    for factor in (1, -1, -0.01, 50):
        np.testing.assert_allclose(project(oriented(factor * matrix, (60, 100)), points), project(matrix, points))


def test_arrows_turn_as_small_neighbourhoods_do():
    angle = np.radians(30)
    rotation = np.array([[np.cos(angle), -np.sin(angle), 7], [np.sin(angle), np.cos(angle), -2], [0, 0, 1]])
    np.testing.assert_allclose(turned(3 * rotation, np.array([[0, 0], [50, 20.0]]), np.array([0, 100.0])), [30, 130])

    # A perspective one: against the ends of a short arrow.
    matrix = rotation @ np.array([[1, 0.2, 0], [0, 0.8, 0], [1e-3, 5e-4, 1]])
    point, arrow = np.array([[40, 30.0]]), 1e-4 * np.array([[np.cos(1.0), np.sin(1.0)]])
    x, y = (project(matrix, point + arrow) - project(matrix, point - arrow))[0]
    np.testing.assert_allclose(turned(matrix, point, np.degrees([1.0])), np.degrees(np.arctan2(y, x)), atol=1e-6)


def test_the_identity_is_recognised_up_to_a_factor_and_half_a_pixel():
    assert homographies.moves_nothing(-2 * np.eye(3), (480, 640))
    assert homographies.moves_nothing(np.array([[1, 0, 0.4], [0, 1, 0], [0, 0, 1]]), (480, 640))
    assert not homographies.moves_nothing(np.array([[1, 0, 0.6], [0, 1, 0], [0, 0, 1]]), (480, 640))
    assert not homographies.moves_nothing(np.diag([1.01, 1, 1]), (480, 640))
