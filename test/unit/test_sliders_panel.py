"""The sliders: what positions mean, and a real window on a screen that nobody sees (Xvfb)."""

import math
import os
import shutil
import subprocess

import numpy as np
import pytest

from rvc_features.windows import ranges

DETECTORS = repr({'enum_description': 'Detectors', 'enum': [
    {'name': name, 'type': 'str', 'value': value, 'description': f'the detector {value}'}
    for name, value in (('harris', 'harris'), ('ORB', 'orb'))]})

# Another list that has a detector's name in it.
SCORES = DETECTORS.replace("'orb'", "'fast'").replace("'ORB'", "'score_fast'").replace(
    "'name': 'harris'", "'name': 'score_harris'")


def description(name, kind, default, low='', high='', text='What it is.', edit_method=''):
    return {'name': name, 'type': kind, 'default': default, 'min': low, 'max': high, 'description': text,
            'edit_method': edit_method}


DESCRIPTIONS = [
    description('detector', 'str', 'harris', edit_method=DETECTORS),
    description('window_size', 'int', 5, 3, 31, 'Harris: side of the window.'),
    description('threshold', 'double', 0.01, 0.0, 0.2, 'Harris with two_scales: least share.'),
    description('anms', 'bool', False, False, True, 'HARRIS: evenly.'),
    description('orb_levels', 'int', 8, 1, 16, 'Levels of the pyramid.'),
    description('orb_score', 'str', 'fast', edit_method=SCORES),
    description('gain', 'double', 1.0, -math.inf, math.inf),
    description('label', 'str', 'left'),
]


@pytest.mark.parametrize(('low', 'high', 'default', 'whole', 'step', 'steps'), [
    (3, 31, 5, True, 1, 28), (0, 5000, 500, True, 1, 5000), (0.0, 0.2, 0.01, False, 0.001, 200),
    (0.0, 1.0, 0.5, False, 0.005, 200), (-3.0, 7.3, 0.0, False, 0.05, 206), (0, 100000, 5000, True, 500, 200),
    (-2 ** 31, 2 ** 31 - 1, 0, True, 1, 0), (0, 2 ** 31 - 1, 10, True, 1, 0), (-math.inf, math.inf, 0.0, False, 1, 0),
    (1.0, 1.0, 1.0, False, 1, 0)])
def test_steps_read_well(low, high, default, whole, step, steps):
    found = ranges.of_number(low, high, default, whole)
    assert (found.step, found.steps) == (pytest.approx(step), steps)
    if steps:
        assert (found.value(0), found.value(steps), found.value(-3)) == (low, high, low)
        for position in range(steps + 1):
            value = found.value(position)
            assert found.position(value) == position
            assert isinstance(value, int) == whole
            assert low <= value <= high
            assert len(f'{value:.10g}') <= 6


def test_a_range_of_many_orders_of_magnitude_is_spread_over_them():
    found = ranges.of_number(0.0, 1e6, 10.0, False)
    assert (found.value(0), found.value(1), found.value(found.steps)) == (0.0, 0.01, 1e6)
    assert found.value(found.position(10.0)) == pytest.approx(10.0, rel=0.1)
    assert found.value(101) / found.value(100) == pytest.approx(1.1, abs=0.05)
    assert all(found.value(position) <= found.value(position + 1) for position in range(found.steps))


@pytest.mark.parametrize(('text', 'problem'), [('abc', 'a number is wanted'), ('nan', '0 to 0.2 is accepted; got nan'),
                                               ('0.3', '0 to 0.2 is accepted'), ('', 'a number is wanted')])
def test_what_is_typed_wrongly_is_refused(text, problem):
    with pytest.raises(ValueError, match=problem):
        ranges.of_number(0.0, 0.2, 0.01, False).read(text)
    with pytest.raises(ValueError, match='a whole number is wanted'):
        ranges.of_number(1, 9, 3, True).read('2.5')


class Screen:
    """A screen in memory; what is on it can be read."""

    def __init__(self, folder):
        self.file = folder / 'Xvfb_screen0'
        reader, writer = os.pipe()
        self.server = subprocess.Popen(
            ['Xvfb', '-displayfd', str(writer), '-screen', '0', '800x700x24', '-fbdir', str(folder)],
            pass_fds=[writer], stderr=subprocess.DEVNULL)
        os.close(writer)
        with os.fdopen(reader) as answer:
            self.display = f':{answer.readline().strip()}'

    def picture(self):
        """What is on the screen, (700, 800, 3) BGR, from Xvfb's file in the format of xwd."""
        data = self.file.read_bytes()
        header = np.frombuffer(data[:100], '>u4')
        return np.frombuffer(data[header[0] + 12 * header[19]:], np.uint8).reshape(700, 800, 4)[..., :3]

    def close(self):
        self.server.terminate()
        self.server.wait(10)


@pytest.fixture(scope='module')
def screen(tmp_path_factory):
    if shutil.which('Xvfb') is None:
        pytest.skip('Xvfb is not installed')
    screen = Screen(tmp_path_factory.mktemp('screen'))
    yield screen
    screen.close()


@pytest.fixture
def window(screen):
    """The panel in a window; `told` and `changes` are what it said."""
    tkinter = pytest.importorskip('tkinter')
    from rvc_features.windows.panel import Panel
    root = tkinter.Tk(screenName=screen.display)
    root.geometry('700x500+0+0')
    root.told, root.changes = [], []
    root.panel = Panel(root, DESCRIPTIONS, lambda *change: root.changes.append(change), root.told.append)
    root.panel.pack(fill='both', expand=True)
    root.update()
    yield root
    root.destroy()


def test_each_kind_has_its_widget_and_shows_its_default(window):
    rows = window.panel.rows
    assert {name: type(row).__name__ for name, row in rows.items()} == {
        'detector': '_List', 'window_size': '_Number', 'threshold': '_Number', 'anms': '_Flag', 'orb_levels': '_Number',
        'orb_score': '_List', 'gain': '_Number', 'label': '_Entry'}
    assert {name: row.value for name, row in rows.items()} == {
        'detector': 'harris', 'window_size': 5, 'threshold': 0.01, 'anms': False, 'orb_levels': 8,
        'orb_score': 'fast', 'gain': 1.0, 'label': 'left'}
    assert rows['detector'].labels == ['harris', 'ORB (orb)']
    assert rows['orb_score'].labels == ['harris', 'fast']   # of score_harris and score_fast
    assert [rows[name].scale.winfo_ismapped() for name in ('threshold', 'gain')] == [1, 0]
    assert (rows['threshold'].field.get(), rows['threshold'].scale.get()) == ('0.01', 10)
    assert window.changes == []


def test_whatever_is_moved_is_told(window):
    rows = window.panel.rows
    rows['threshold'].scale.set(25.4)
    rows['window_size'].scale.focus_force()
    window.update()
    rows['window_size'].scale.event_generate('<Right>')
    rows['anms'].box.invoke()
    rows['gain'].field.delete(0, 'end')
    rows['gain'].field.insert(0, '-2.5')
    rows['gain'].field.focus_force()
    window.update()
    rows['gain'].field.event_generate('<Return>')
    window.update()
    assert window.changes == [('threshold', 0.025), ('window_size', 6), ('anms', True), ('gain', -2.5)]
    assert rows['threshold'].field.get() == '0.025'
    assert rows['threshold'].scale.get() == 25   # whole steps


def test_what_is_typed_wrongly_is_told_and_taken_back(window):
    field = window.panel.rows['threshold'].field
    field.delete(0, 'end')
    field.insert(0, 'much')
    field.focus_force()
    window.update()
    field.event_generate('<Return>')
    window.update()
    assert (field.get(), window.changes) == ('0.01', [])
    assert "threshold: a number is wanted; got 'much'" in window.told


def test_rows_of_other_choices_are_left_out(window):
    panel = window.panel
    assert panel.shown() == ['detector', 'window_size', 'threshold', 'anms', 'gain', 'label']
    panel.rows['detector'].box.current(1)
    panel.rows['detector'].box.event_generate('<<ComboboxSelected>>')
    window.update()
    assert window.changes == [('detector', 'orb')]
    assert window.told == ['the detector orb']
    assert panel.shown() == ['detector', 'orb_levels', 'orb_score', 'gain', 'label']
    panel.show({'detector': 'harris', 'threshold': 0.1, 'unknown': 3})
    assert 'threshold' in panel.shown()
    assert panel.rows['threshold'].field.get() == '0.1'
    panel.wanted.set('THR')
    assert panel.shown() == ['threshold']
    assert window.changes == [('detector', 'orb')]


def test_it_is_seen(window, screen):
    """Moving a slider moves pixels, in its row and nowhere else."""
    window.update()
    scale = window.panel.rows['threshold'].scale
    before = screen.picture().copy()
    assert len(np.unique(before[:500, :700].reshape(-1, 3), axis=0)) > 5, 'widgets and text are there'
    scale.configure(value=190)
    window.update()
    changed = (screen.picture() != before).any(axis=2)
    rows, columns = np.nonzero(changed)
    top, left = scale.winfo_rooty(), scale.winfo_rootx()
    assert len(rows) > 20
    inside_rows = range(top, top + scale.winfo_height())
    inside_columns = range(left, left + scale.winfo_width())
    assert set(rows.tolist()) <= set(inside_rows)
    assert set(columns.tolist()) <= set(inside_columns)


def test_a_node_that_answers_before_the_window_is_ready_is_heard(screen, monkeypatch):
    tkinter = pytest.importorskip('tkinter')
    pytest.importorskip('rospy', reason='ROS is not installed')
    from rvc_features.windows import sliders

    class AtOnce:
        def __init__(self, node, tell):
            tell(self, 'problem', f'{node} answers at once')

        def close(self):
            pass

    monkeypatch.setattr(sliders, 'Connection', AtOnce)
    monkeypatch.setattr(sliders, 'find_reconfigure_services', lambda: ['/node'])
    root = tkinter.Tk(screenName=screen.display)
    window = sliders.SlidersWindow(root, '/node')
    assert window.status.get() == '/node answers at once'
    window.close()
