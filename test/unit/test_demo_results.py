"""The demo's sheet and table, from phases made by hand. (Scenes come from bags: this needs rosbag, but no master.)"""

import numpy as np
import pytest

pytest.importorskip('rosbag', reason='ROS is not installed')

from pathlib import Path

from rvc_features import key_points
from rvc_features.demo import command
from rvc_features.demo.results import contact_sheet, lost, summary
from rvc_features.demo.scenes import SETTINGS, Scene, phases_of


def phases(shape=(240, 320, 3), frames=13):
    return phases_of(Scene('street', Path('street.bag'), frames, np.full(shape, 90, np.uint8)))


def test_every_setting_has_its_share_of_the_frames():
    assert [phase.frames for phase in phases()] == [2, 2, 2, 2, 2, 3]
    assert [phase.setting for phase in phases(frames=1)] == [name for name, _ in SETTINGS]     # shown under each


def test_frames_that_do_not_come_out_are_told():
    made = phases()
    for phase in made:
        phase.frames_in = phase.frames_out = phase.frames
    assert lost(made) == ''
    made[3].frames_out = 0
    assert lost(made).startswith('of 13 frames 13 were received and 11 came out of the node; the others were lost')


def test_few_points_have_large_rings():
    made = phases()[:2]
    for phase, count in zip(made, (400, 1)):
        phase.shown_points = key_points.empty(count)
        phase.shown_points['x'], phase.shown_points['y'], phase.shown_points['size'] = 160, 120, 3
    sheet = contact_sheet(made, columns=2)
    many, one = (np.argwhere((tile[60:360] != 90).any(axis=2)) for tile in (sheet[:, 4:480], sheet[:, 492:968]))
    assert 5 <= np.ptp(many[:, 0]) <= 8
    assert 15 <= np.ptp(one[:, 0]) <= 18
    assert np.abs(one.mean(axis=0) - (120.5 * 1.5 - 26.5, 239.5)).max() < 2


@pytest.mark.parametrize('shape', [(2, 2, 3), (3000, 4, 3), (4, 3000, 3)])
def test_frames_of_any_shape(shape):
    sheet = contact_sheet(phases(shape))
    assert sheet.shape[1] == 3 * 488
    assert sheet.shape[0] <= 2 * (2 * 480 + 38)


def test_what_did_not_come_is_a_dash():
    assert summary(phases()).splitlines()[2].split() == ['street', 'strongest', '150', '0', '0', '-', '-']


def test_what_it_is_given_wrong_is_one_sentence(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert command.main(['--output', str(tmp_path / 'file')]) == 2
    assert capsys.readouterr().err == (f"demo: {tmp_path / 'file'}: results can't be written there (File exists); give "
                                       'another folder with --output\n')
    with pytest.raises(SystemExit, match='2'):
        command.main(['--topic', '/camera'])
    assert 'demo: error: --topic names a topic of the bag, so --bag is needed, too' in capsys.readouterr().err
