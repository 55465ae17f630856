"""Measures of tracks on histories whose answers are known, and the command that prints them."""

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features.comparison import track_command, track_measures
from rvc_features.odometry.tracks import DTYPE


def tracks(**fields):
    made = np.zeros(len(next(iter(fields.values()))), DTYPE)
    for name, values in fields.items():
        made[name] = values
    return made


def test_lengths_and_survival():
    history = [tracks(id=[0, 1], age=[0, 0]), tracks(id=[0, 2], age=[1, 0]), tracks(id=[0, 2], age=[2, 1])]
    assert track_measures.lengths(history).tolist() == [3, 1, 2]
    assert track_measures.survival(history, 1) == pytest.approx(2 / 3)   # 0 and 2 of 0, 1, 2
    assert track_measures.survival(history, 2) == pytest.approx(1 / 2)   # 0 of 0, 1
    assert track_measures.survival(history, 3) is None
    assert track_measures.lengths([]).tolist() == []


def test_drift_is_the_distance_from_where_the_homography_leads():
    found = tracks(id=[0, 1, 2], age=[30, 30, 7], start_x=[10, 20, 0], start_y=[5, 5, 0], x=[23, 40, 99], y=[14, 10, 0])
    double = np.diag([2.0, 2.0, 1.0])
    assert track_measures.drift(found, double).tolist() == [5.0, 0.0]


def test_the_rigid_share_leaves_out_what_moves_by_itself():
    generator = np.random.default_rng(0)
    points = np.column_stack((generator.uniform(-1, 1, (60, 2)), generator.uniform(4, 8, 60)))
    views = []
    for offset in (0.0, 0.3):
        pixels = 500 * (points[:, :2] - (offset, 0.02 * offset)) / points[:, 2:] + (320, 240)
        pixels[:12] += (0, 40 * offset)   # these move by themselves
        views.append(tracks(id=np.arange(60), x=pixels[:, 0], y=pixels[:, 1]))
    assert track_measures.rigid_share(views, 1) == pytest.approx(0.8, abs=0.04)
    assert track_measures.rigid_share([view[:5] for view in views], 1) is None


def test_the_command_tells_of_motion_and_files(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(track_command, 'MOTIONS', {'moved': track_command.MOTIONS['moved']})
    frames = tmp_path / 'frames'
    frames.mkdir()
    scene = texture((260, 340), 2)
    cv2.imwrite(str(tmp_path / 'photograph.png'), scene)
    for number in range(3):
        cv2.imwrite(str(frames / f'frame{number}.png'), scene[10:250, 4 * number:4 * number + 320])
    assert track_command.main([str(frames), '-d', 'fast', '--tracks', '40',
                               '--photograph', str(tmp_path / 'photograph.png')]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == 'photograph moved'
    label, count, length, survive, drift, rigid, _, of_flow = lines[2].split()
    assert (label, length) == ('fast', '31')
    assert 35 <= int(count) <= 40
    assert float(survive) > 0.8
    assert float(drift) < 0.2
    assert float(rigid) > 0.9
    assert float(of_flow) > 0
    assert sum(line.split()[:2] == ['plain', 'OpenCV'] for line in lines) == 2


def test_what_can_not_be_read_is_said(capsys):
    assert track_command.main(['no_such_video.avi']) == 2
    said = capsys.readouterr()
    assert 'compare_tracks: no_such_video.avi: no such file' in said.err
    assert said.out == ''   # before anything is measured
    assert track_command.main(['-d', 'banana']) == 2
    assert "unknown detector 'banana'" in capsys.readouterr().err
