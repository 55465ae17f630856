"""The examiner: right solutions in many styles raise no alarm, and each seeded mistake is named by what it is."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rvc_features import key_points, presets
from rvc_features.exercise import command, scenes
from rvc_features.exercise.child import points_of, raised
from rvc_features.exercise.examination import FAILED, NOT_TESTED, examine
from rvc_features.exercise.findings import explain
from rvc_features.exercise.mistakes import LEGAL, TABLE
from rvc_features.exercise.questions import PARAMETERS, questions
from rvc_features.exercise.reference import Reference
from rvc_features.exercise.subject import Answer

SOLUTIONS = Path(__file__).parent / 'exercise_solutions'
SCENES = [scenes.corners(), scenes.strengths(), scenes.crowd(), scenes.colours(), scenes.large(), scenes.masked()]


class Made:
    """A class, examined without a process of its own."""

    printed = ''
    name = 'made'

    def __init__(self, make, takes=PARAMETERS):
        self.make = make
        self.takes = takes if isinstance(takes, dict) else {name: name for name in takes}

    def answer(self, probe, before=()):
        detector = self.make(**{self.takes[name]: value for name, value in probe.parameters.items()
                                if name in self.takes})
        for image in before:
            detector.detect(image.copy())
        given = probe.scene.image.copy()
        try:
            found = points_of(detector.detect(given, *([] if probe.scene.mask is None else [probe.scene.mask])))
        except Exception as error:
            return Answer(None, f'it raises {raised(error)["raised"]}', raised(error)['meant'])
        return Answer(np.array([tuple(row) for row in found['points']], key_points.DTYPE),
                      changed=not np.array_equal(given, probe.scene.image))


def solution(name, old='', new='', attribute='HarrisDetector'):
    """A class or factory of a file in exercise_solutions/, with a piece of its text replaced."""
    text = (SOLUTIONS / f'{name}.py').read_text()
    assert old in text, f'{name} has no {old}'
    loaded = {'__name__': name}
    exec(text.replace(old, new) if old else text, loaded)
    return loaded[attribute]


def failed(examination):
    return {check.name: check.sentence for check in examination.checks if check.status == FAILED}


# ---- The reference, and the table ----

@pytest.mark.parametrize('scene', SCENES, ids=lambda scene: scene.name)
def test_the_reference_is_our_detector_with_whole_pixels(scene):
    for values in ({'octaves': 3}, {'anms': True, 'anms_points': 6},
                   {'fixed_number_of_points': True, 'number_of_points': 4, 'window_size': 7}):
        expected = presets.create('course', window='gaussian', **values).detect_arrays(scene.image, scene.mask)
        found = Reference(**values).detect(scene.image, scene.mask)
        assert len(found) == len(expected)
        for point, same in zip(found, partners(found, expected)):
            step = 2.0 ** point['octave']   # rounding may take either of two neighbours that are as strong
            distance = abs(point['x'] - same['x']), abs(point['y'] - same['y'])
            assert distance == (0, 0) or (max(distance) <= step and point['response'] == pytest.approx(
                same['response'], rel=1e-5))
            assert (point['octave'], point['size']) == (same['octave'], same['size'])
            assert point['response'] == pytest.approx(same['response'], rel=1e-2)
            if distance == (0, 0):
                assert point['angle'] == pytest.approx(same['angle'], abs=0.1)


def partners(found, expected):
    """Those of `expected` that are nearest to those found, each of them once."""
    def places(points):
        return np.column_stack((points['x'], points['y'], 1e4 * points['octave'])).astype(np.float64)
    distances = np.linalg.norm(places(found)[:, None] - places(expected), axis=2)
    nearest = distances.argmin(axis=1)
    assert len(set(nearest)) == len(found)
    return expected[nearest]


def explained(make):
    def ask(question):
        return question.read(question.probes, [make(**probe.parameters).detect(probe.scene.image, probe.scene.mask)
                                               for probe in question.probes])

    return explain({question.name: ask(question) for question in questions() if not question.decides}, ask)


@pytest.mark.parametrize('way', [way for ways in TABLE.values() for way in ways], ids=lambda way: way.__name__)
def test_every_way_to_make_a_mistake_is_told_from_all_others(way):
    explanation = explained(way)
    assert [finding.names for finding in explanation.findings] == [(way.name,)]
    assert explanation.unexplained == ()


@pytest.mark.parametrize('way', [Reference, *LEGAL], ids=lambda way: way.__name__)
def test_what_the_sheet_allows_is_no_mistake(way):
    explanation = explained(way)
    assert explanation.failed == ()
    assert explanation.base is way


def test_two_mistakes_of_different_steps_are_both_named():
    one, other = TABLE['angle mirrored'][0], TABLE['one fewer than asked'][0]
    explanation = explained(type('Both', (one, other), {}))
    assert {finding.names for finding in explanation.findings} == {('angle mirrored',), ('one fewer than asked',)}


# ---- Solutions of others ----

@pytest.mark.parametrize(('name', 'attribute'), [
    ('plain', 'HarrisDetector'), ('loops', 'HarrisDetector'), ('numpy_only', 'HarrisDetector'),
    ('determinants', 'HarrisDetector'), ('factory', 'make_detector')])
def test_no_alarm_on_a_right_solution(name, attribute):
    takes = {**dict(zip(PARAMETERS, PARAMETERS)), 'anms': 'ANMS', 'anms_points': 'ANMS_points'}
    examination = examine(Made(solution(name, attribute=attribute), takes if name == 'loops' else PARAMETERS))
    assert failed(examination) == {}
    assert [check.name for check in examination.checks if check.status == NOT_TESTED] == []
    if name == 'numpy_only':
        assert any('sheet\'s own formula' in check.sentence for check in examination.checks)


@pytest.mark.parametrize('subpixel', [True, False])
def test_no_alarm_on_our_own(subpixel):
    def make(**values):
        return presets.create('course', subpixel=subpixel, **values)

    assert failed(examine(Made(make))) == {}


SEEDS = [
    ('plain', '0.04 * (a + c) ** 2', '0.04 * (a + c)', 'trace not squared'),
    ('loops', '0.04 * (a + c) ** 2', '0.04 * (a + c)', 'trace not squared'),
    ('plain', '0.04 * (a + c) ** 2', '(a + c)', 'trace not squared'),
    ('numpy_only', ' - 0.04 * (A + C) ** 2', '', 'k forgotten'),
    ('plain', '0.04 * (a + c) ** 2', '(a + c) ** 2', 'k forgotten or nothing averaged'),
    ('determinants', '- 0.06 *', '+ 0.06 *', 'k of wrong sign'),
    ('plain', 'h = a', 'b = ix * iy\n        h = a', 'B not averaged'),
    ('factory', 'W(gx * gy)', 'gx * gy', 'B not averaged'),
    ('plain', 'pt[0]), float(pt[1])', 'pt[1]), float(pt[0])', 'x and y swapped'),
    ('plain', 'if image.ndim == 3:', 'if False:', 'gradients of a colour image'),
    ('determinants', 'cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)', 'image[..., 2]', 'gradients of a colour image'),
    ('plain', 'self.threshold * kps[0].response', 'self.threshold', 'threshold absolute'),
    ('loops', 'self.t * m', 'self.t', 'threshold absolute'),
    ('plain', 'kps[0].response]', 'max(j.response for j in kps if j.octave == k.octave)]', 'H_max taken per octave'),
    ('plain', ' & (h == cv2.dilate(h, np.ones((3, 3))))', '', 'no local maxima'),
    ('plain', '(x * 2**octave, y * 2**octave)', '(x, y)', 'coordinates not scaled back'),
    ('plain', 'float(w * 2**octave)', 'float(w)', 'sizes not scaled back'),
    ('plain', 'self.number_of_points]', 'self.number_of_points - 1]', 'one fewer than asked'),
    ('numpy_only', 'sorted(X, key=lambda k: -k.response)', 'X', 'unsorted'),
    ('plain', 'if self.anms:', 'if self.anms:\n            kps.sort(key=lambda k: (k.octave, k.pt[1], k.pt[0]))',
     'ANMS on unsorted points'),
    ('loops', 'p.response < 0.9 * q.response', 'p is not q and 0.9 * p.response < q.response',
     'c_r on the wrong side'),
    ('plain', 'k.response < 0.9 * j.response', '0.9 * k.response < j.response', 'c_r on the wrong side or forgotten'),
    ('plain', 'r = [np.inf]', 'r = [0]', 'the strongest lost'),
    ('plain', 'np.arctan2(by', 'np.arctan2(-by', 'angle mirrored'),
    ('plain', 'np.arctan2(by[y, x], bx[y, x])', 'np.arctan(by[y, x] / (bx[y, x] or 1e-9))',
     'angle by atan instead of atan2'),
    ('factory', 'angleInDegrees=True', 'angleInDegrees=False', 'angle in radians'),
    ('plain', 'np.degrees(', '90 + np.degrees(', 'angle 90 degrees off'),
    ('plain', 'if mask is not None:', 'if False:', 'mask ignored'),
    ('plain', 'kps = []\n', 'image[0, 0] += 1\n        kps = []\n', 'input image drawn into'),
    ('plain', 'kps = []\n', 'kps = self.__dict__.setdefault("kps", [])\n', 'points kept from the image before'),
]


@pytest.mark.parametrize(('name', 'old', 'new', 'mistake'), SEEDS,
                         ids=[f'{mistake} in {name}' for name, _, _, mistake in SEEDS])
def test_a_seeded_mistake_is_named_and_no_other(name, old, new, mistake):
    attribute, takes = ('make_detector' if name == 'factory' else 'HarrisDetector'), dict(zip(PARAMETERS, PARAMETERS))
    if name == 'loops':
        takes.update(anms='ANMS', anms_points='ANMS_points')
    examination = examine(Made(solution(name, old, new, attribute), takes))
    assert examination.mistakes == [mistake]
    assert all(check.mistakes for check in examination.checks if check.status == FAILED)
    assert examination.exit_status == 1


def test_what_fits_no_mistake_is_told_without_a_guess():
    odd = solution('plain', 'pt = (x * 2**octave', 'pt = (40 + x * 2**octave')
    examination = examine(Made(odd))
    assert examination.mistakes == []
    assert 'no mistake that is known here explains it' in failed(examination)['corners']


def test_sorting_is_asked_for_only_with_a_fixed_number():
    assert failed(examine(Made(solution('plain', 'kps[0].response]', 'kps[0].response][::-1]')))) == {}


def test_only_what_is_done_so_far():
    examination = examine(Made(solution('plain', 'r = [np.inf]', 'r = [0]')), exercise=1)
    assert examination.exit_status == 0
    assert 'ANMS' not in {check.name for check in examination.checks}


# ---- The command, with a process for each class ----

@pytest.fixture(scope='module')
def marked(tmp_path_factory):
    """A folder of submissions, some of them broken, marked in one call: results by file name, status and seconds."""
    folder = tmp_path_factory.mktemp('submissions')
    plain = (SOLUTIONS / 'plain.py').read_text()
    begin = '        kps = []\n'
    for name, text in {
        'right': plain,
        'syntax': 'class HarrisDetector(:\n',
        'missing': 'import there_is_no_such_module\n',
        'empty': '',
        'raises': plain.replace(begin, begin + '        [][0]\n'),
        'raises_with_anms': plain.replace('r = [np.inf]', 'r = [np.inf][1]'),
        'hangs': plain.replace(begin, begin + '        while True: pass\n'),
        'exits': plain.replace(begin, begin + '        raise SystemExit(3)\n'),
        'dies': plain.replace(begin, begin + '        import os; os.abort()\n'),
        'rubbish': plain.replace(begin, begin + '        return [1, 2]\n'),
        'prints': plain.replace(begin, begin + '        print("detecting", image.shape)\n'),
        'reads': plain.replace(begin, begin + '        input()\n'),
        'no_mask': plain.replace('mask=None', '').replace('if mask is not None:', 'if False:'),
        'no_colour': plain.replace('image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)',
                                   'raise ValueError("a grey image, please")'),
        'exercise_1': 'import cv2\n\n\nclass HarrisDetector:\n    def detect(self, image):\n        return []\n',
    }.items():
        (folder / f'{name}.py').write_text(text)
    (folder / 'team_7' / 'src').mkdir(parents=True)
    (folder / 'team_7' / 'src' / 'harris.py').write_text(plain.replace('np.arctan2(by', 'np.arctan2(-by'))
    (folder / 'notes').mkdir()
    results, pictures = folder / 'marks.json', folder / 'pictures'
    start = time.monotonic()
    status = command.main(['--folder', str(folder), '--json', str(results), '--pictures', str(pictures),
                           '--seconds', '3'])
    seconds = time.monotonic() - start
    return ({Path(one['subject']).stem: one for one in json.loads(results.read_text())}, status, seconds, pictures)


@pytest.mark.parametrize(('name', 'status', 'mistakes'), [
    ('right', 0, []), ('syntax', 2, []), ('missing', 2, []), ('empty', 2, []), ('notes', 2, []),
    ('raises', 1, ['raises']), ('raises_with_anms', 1, ['raises']), ('hangs', 1, ['hangs']), ('exits', 1, ['raises']),
    ('dies', 1, ['dies']), ('rubbish', 1, ['rubbish']), ('prints', 1, ['prints']), ('reads', 1, ['raises']),
    ('no_mask', 0, []), ('no_colour', 0, []), ('harris', 1, ['angle mirrored'])])
def test_one_of_a_folder(marked, name, status, mistakes):
    result = marked[0][name]
    assert (result['exit_status'], result['mistakes']) == (status, mistakes)


def test_a_folder_says_what_each_broken_one_did(marked):
    results, status, _, pictures = marked
    assert status == 2
    assert 'SyntaxError' in results['syntax']['cannot_run']
    assert 'there_is_no_such_module' in results['missing']['cannot_run']

    def sentence(name, check='corners'):
        return next(one['sentence'] for one in results[name]['checks'] if one['check'] == check)

    assert 'IndexError' in sentence('raises')
    assert 'line' in sentence('raises')
    assert 'SystemExit: 3' in sentence('exits')
    assert 'hangs' in sentence('hangs')
    assert 'SIGABRT' in sentence('dies')
    assert 'int' in sentence('rubbish')
    assert 'detecting' in sentence('prints', 'prints')
    assert 'no mask' in sentence('no_mask', 'mask')
    assert 'a grey image, please' in sentence('no_colour', 'colour')
    assert 'threshold' in results['exercise_1']['remarks'][0]
    assert next(pictures.rglob('*harris.py/orientation.png')).stat().st_size > 1000


def test_what_cannot_be_run(tmp_path, capsys):
    for target in ('there_is_no_such_module:Detector', 'rvc_features.filters:nothing', str(tmp_path / 'none.py')):
        assert command.main(['--class', target, '--pictures', str(tmp_path)]) == 2
    printed = capsys.readouterr().out
    assert 'there_is_no_such_module' in printed
    assert 'has no nothing' in printed
    assert command.main(['--folder', str(tmp_path)]) == 2
    with pytest.raises(SystemExit) as ended:
        command.main(['--exercise', '7'])
    assert ended.value.code == 2


def test_an_endless_loop_ends_with_the_examiner(tmp_path):
    (tmp_path / 'endless.py').write_text('while True: pass')
    child = [sys.executable, '-m', 'rvc_features.exercise.child', str(tmp_path / 'endless.py:HarrisDetector')]
    examiner = ('import os, subprocess\n'
                f'subprocess.Popen({child}, stdin=subprocess.PIPE, stdout=subprocess.PIPE)\n'
                'os._exit(3)')
    # Returns when nobody has its standard error any more: that of the child, too.
    ended = subprocess.run([sys.executable, '-c', examiner], stderr=subprocess.PIPE, timeout=60, check=False)
    assert ended.returncode == 3
