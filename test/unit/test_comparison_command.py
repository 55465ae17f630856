"""The whole tool: numbers end to end, bad input, interruption and resumption, workers."""

import csv
import html
import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import texture

from rvc_features import detectors, presets
from rvc_features.comparison import command, executors, measures, pictures, warps

pytestmark = pytest.mark.slow   # whole comparisons

SOURCE = Path(__file__).resolve().parents[2] / 'src'
QUICK = '--repeats', '1', '--points', '100', '-d', 'harris:fixed_number_of_points=1', '-d', 'fast:threshold=5'


@pytest.fixture(scope='module')
def sequence(tmp_path_factory):
    """A photograph, turned and zoomed, in the Oxford layout."""
    folder = tmp_path_factory.mktemp('data') / 'wall'
    folder.mkdir()
    photograph = texture((300, 390), smoothing=2.5)
    cv2.imwrite(str(folder / 'img1.png'), warps.reference(photograph))
    for number, (kind, amount) in enumerate((('rotation', 20), ('zoom', 0.8)), 2):
        image, homography = warps.warped(photograph, kind, amount)
        cv2.imwrite(str(folder / f'img{number}.png'), image)
        np.savetxt(folder / f'H1to{number}p', homography)
    return folder


def read_csv(path):
    with open(path, newline='') as file:
        return list(csv.DictReader(file))


def main(*arguments):
    return command.main([str(argument) for argument in arguments])


def environment():
    return {**os.environ, 'PYTHONPATH': os.pathsep.join([str(SOURCE), os.environ.get('PYTHONPATH', '')])}


def start(*arguments):
    return subprocess.Popen([sys.executable, '-m', 'rvc_features.comparison.command', *map(str, arguments)],
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(),
                            start_new_session=True)


# Numbers ------------------------------------------------------------------------------------------------------------

def test_the_numbers_are_those_of_the_protocol(sequence, tmp_path):
    assert main(sequence, '--output', tmp_path, *QUICK, '--points', 200) == 0
    rows = {(row['pair'], row['detector']): row for row in read_csv(tmp_path / 'pairs.csv')}
    assert len(rows) == 4

    # The protocol once more, written down plainly.
    for number in (2, 3):
        matrix = np.loadtxt(sequence / f'H1to{number}p')
        images = [cv2.imread(str(sequence / f'img{i}.png'), cv2.IMREAD_GRAYSCALE) for i in (1, number)]
        height, width = images[0].shape
        first, second = ([(float(p['x']), float(p['y'])) for p in detectors.create('harris').detect_arrays(image)[:200]]
                         for image in images)

        def moved(point, by):
            x, y, w = by @ (*point, 1)
            return x / w, y / w

        def seen(point, width=width, height=height):
            return 0 <= point[0] < width and 0 <= point[1] < height

        first = [moved(p, matrix) for p in first if seen(moved(p, matrix))]
        second = [p for p in second if seen(moved(p, np.linalg.inv(matrix)))]
        gaps = [[np.hypot(p[0] - q[0], p[1] - q[1]) for q in second] for p in first]
        mutual = [min(row) for i, row in enumerate(gaps)
                  if min(other[row.index(min(row))] for other in gaps) == min(row)]
        row = rows[f'1 to {number}', 'harris']
        assert (int(row['in_region_1']), int(row['in_region_2'])) == (len(first), len(second))
        for epsilon in (1.5, 3):
            expected = sum(gap <= epsilon for gap in mutual) / min(len(first), len(second))
            assert float(row[f'repeatability_{epsilon:g}']) == pytest.approx(expected, abs=1e-5)
            assert 0 < float(row[f'chance_{epsilon:g}']) < expected
        assert float(row['error_px']) == pytest.approx(np.mean([gap for gap in mutual if gap <= 3]), abs=1e-4)

    means = {(row['group'], row['measure'], row['detector']): row for row in read_csv(tmp_path / 'summary.csv')}
    mean = means['all', 'repeatability_1.5', 'harris']
    assert float(mean['value']) == pytest.approx(
        np.mean([float(rows[f'1 to {number}', 'harris']['repeatability_1.5']) for number in (2, 3)]), abs=1e-5)
    assert mean['pairs'] == '2'


def test_a_picture_and_itself(tmp_path, capsys):
    folder = tmp_path / 'same'
    folder.mkdir()
    for number in (1, 2):
        cv2.imwrite(str(folder / f'img{number}.png'), texture((200, 260)))
    (folder / 'H1to2p').write_text('1 0 0\n0 1 0\n0 0 1\n')
    assert main(folder, '--output', tmp_path / 'out', '--repeats', 1, '--points', 100) == 0
    for row in read_csv(tmp_path / 'out' / 'pairs.csv'):
        assert (row['repeatability_0.5'], row['error_px']) == ('1', '0')
        assert row['matches'] == row['right_matches']
    assert 'one pair' in capsys.readouterr().out.lower()


def test_frames_without_ground_truth(tmp_path):
    folder = tmp_path / 'drive'
    folder.mkdir()
    scene = texture((200, 400), smoothing=2.0)
    for number in range(3):
        cv2.imwrite(str(folder / f'{number:03}.png'), scene[:, 4 * number:4 * number + 260])
    assert main(folder, '--output', tmp_path / 'out', *QUICK, '--points', 100) == 0
    assert 'Mean over 2 pairs and 1 single image' in (tmp_path / 'out' / 'report.html').read_text()
    assert 'differ in size' not in (tmp_path / 'out' / 'report.html').read_text()
    rows = read_csv(tmp_path / 'out' / 'pairs.csv')
    assert [row['pair'] for row in rows[::2]] == ['000.png', '001.png', '002.png']
    assert all(float(row['tracked']) > 0.9 for row in rows[:4])
    assert all(float(row['motion_px']) == pytest.approx(4, abs=0.1) for row in rows[:4])
    assert rows[4]['tracked'] == ''
    assert all(row['repeatability_1.5'] == '' for row in rows)


def test_own_detectors_by_import(sequence, tmp_path, monkeypatch):
    (tmp_path / 'my_own_detector.py').write_text(
        'from dataclasses import dataclass\n'
        'from rvc_features import detectors, key_points\n'
        'from rvc_features.feature_detector import FeatureDetector\n'
        '@detectors.register\n@dataclass(frozen=True)\n'
        'class Corner(FeatureDetector):\n'
        "    name = 'top_left'\n"
        '    def detect_impl(self, image, mask):\n'
        '        return key_points.empty(1)\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', list(sys.path))
    monkeypatch.setattr(detectors, '_registered', dict(detectors._registered))
    assert main(sequence, '--output', 'out', '--repeats', 1, '--import', 'my_own_detector', '-d', 'top_left') == 0
    assert {row['found_1'] for row in read_csv('out/pairs.csv')} == {'1'}
    assert main(sequence, '--output', 'out', '--import', 'no_such_module') == 2


# The report ---------------------------------------------------------------------------------------------------------

class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.sources, self.open, self.words = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.sources += [value for name, value in attributes if name in ('src', 'href', 'srcset', 'data')]
        if tag not in ('meta', 'img', 'br', 'line', 'circle', 'link'):
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in ('line', 'circle'):
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_the_report_needs_nothing_else(sequence, tmp_path):
    assert main(sequence, '--output', tmp_path, '--repeats', 1, '-d', 'harris', '-d', '<b>&"=fast',
                '--title', 'A < B') == 0
    text = (tmp_path / 'report.html').read_text()
    page = Page(text)
    assert page.open == []
    assert all(source.startswith(('data:image/', '#')) for source in page.sources)
    assert not re.search(r'https?://|<script|@import|url\(', text)
    assert '<b>&"' in page.words            # a label is text, whatever is in it
    assert 'A < B' in page.words
    said = ' '.join(page.words)
    for what in ('repeatability, 1.5 px', 'share of the points in the region both images see', 'chance',
                 'window_size', cv2.__version__, np.__version__, 'numpy', 'time against points', 'In short'):
        assert what in said
    assert text.count('data:image/jpeg') == 2     # a picture for each detector
    markdown = (tmp_path / 'report.md').read_text()
    for row in read_csv(tmp_path / 'summary.csv'):
        if row['measure'] == 'repeatability_1.5' and row['group'] == 'all':
            assert f'{float(row["value"]):.3f}' in markdown
            assert f'{float(row["value"]):.3f}' in text


def test_recordings_of_other_sizes_and_single_images(tmp_path):
    for name, shapes in (('one', [(60, 80)]), ('two', [(60, 80), (60, 80), (70, 80)])):
        (tmp_path / name).mkdir()
        for number, shape in enumerate(shapes):
            cv2.imwrite(str(tmp_path / name / f'{number}.png'), texture(shape))
    assert main(tmp_path / 'one', tmp_path / 'two', '--output', tmp_path / 'both', *QUICK) == 0
    markdown = (tmp_path / 'both' / 'report.md').read_text()
    assert 'Mean over 1 pair and 3 single images' in markdown
    assert 'Note: two, 1.png: the next image has another size, so nothing is tracked to it.' in markdown
    assert main(tmp_path / 'one', '--output', tmp_path / 'single', *QUICK) == 0
    markdown = (tmp_path / 'single' / 'report.md').read_text()
    assert 'Mean over 1 single image;' in markdown
    assert 'Note: There is no pair of images' in markdown
    assert 'one pair' not in markdown.lower()


def test_a_note_on_many_pairs_is_said_once(tmp_path):
    folder = tmp_path / 'light'
    folder.mkdir()
    for number in range(1, 7):
        cv2.imwrite(str(folder / f'img{number}.png'), texture((100, 160), seed=number))
        (folder / f'H1to{number}p').write_text('1 0 0\n0 1 0\n0 0 1\n')
    (folder / 'H1to1p').unlink()
    assert main(folder, '--output', tmp_path / 'out', *QUICK) == 0
    markdown = (tmp_path / 'out' / 'report.md').read_text()
    notes = [line for line in markdown.splitlines() if 'is the identity' in line]
    assert notes == ['Note: light, 1 to 2; light, 1 to 3; light, 1 to 4; and 2 more: the homography is the identity: '
                     'the second image was cropped by 37 pixels on the left and 23 at the top.']


def test_names_are_neither_formulas_nor_markup(tmp_path):
    folder = tmp_path / '=1+1'
    folder.mkdir()
    cv2.imwrite(str(folder / '@a<script>.png'), texture((60, 80)))
    assert main(folder, '--output', tmp_path / 'out', *QUICK[:4], '-d', '+b|<img>`=fast', '--title', '# <b>[x](y)') == 0
    for name in ('pairs.csv', 'summary.csv'):
        with open(tmp_path / 'out' / name, newline='') as file:
            for row in csv.reader(file):
                assert not [cell for cell in row if cell[:1] in ('=', '+', '@')]
    assert read_csv(tmp_path / 'out' / 'pairs.csv')[0]['data'] == "'=1+1"
    markdown = (tmp_path / 'out' / 'report.md').read_text()
    assert markdown.startswith('# \\# &lt;b&gt;\\[x\\](y)\n')
    assert '| +b\\|&lt;img&gt;\\` |' in markdown
    assert not re.search(r'<(img|b|script)\b', markdown)


def test_the_report_says_when_where_and_how(sequence, tmp_path):
    assert main(sequence, '--output', tmp_path, *QUICK, '--title', "it's") == 0
    (result, *_) = results_in(tmp_path)
    about = json.loads(result.read_text())['result']
    for name in ('report.html', 'report.md'):
        text = html.unescape((tmp_path / name).read_text())
        assert f'Measured on {about["date"]} on {about["machine"]}' in text
        assert "Made by: compare_detectors" in text
        assert f'--output {tmp_path}' in text
    picture = cv2.imread(str(tmp_path / 'comparison.png')).astype(int)
    for colour in (pictures.AGAIN, pictures.NOT_AGAIN, pictures.NOT_SEEN):      # the legend, below the mosaic
        assert (np.abs(picture[-80:, :30] - colour).max(axis=2) < 20).sum() > 10


def test_help_is_quick_and_names_every_detector():
    program = ('import sys\n'
               'from rvc_features.comparison import command\n'
               'try:\n'
               "    command.main(['--help'])\n"
               'except SystemExit:\n'
               "    assert not {'cv2', 'numpy', 'numba', 'tqdm', 'yaml'} & set(sys.modules)\n")
    result = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, env=environment(),
                            timeout=60, check=False)
    assert (result.returncode, result.stderr) == (0, '')
    for name in (*detectors.names(), *presets.names()):
        assert name in result.stdout


def test_the_examples_where_nothing_else_is_named(photograph, monkeypatch):
    from rvc_features.comparison import compare, inputs
    monkeypatch.setattr(inputs, 'examples', lambda options: [inputs.synthetic(str(photograph), options)])

    def names(*arguments):
        given = command._parser().parse_args(['--or-examples', '--workers', '2', *map(str, arguments)])
        return [dataset.name for dataset in compare._datasets(given)]

    assert names() == ['photo, warped']
    assert names(photograph.parent) == [photograph.parent.name]


def test_without_tqdm_and_yaml(sequence, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tqdm', None)
    monkeypatch.setitem(sys.modules, 'yaml', None)
    assert main(sequence, '--output', tmp_path, *QUICK) == 0
    (tmp_path / 'detectors.yaml').write_text('- fast')
    assert main(sequence, '--output', tmp_path, '--detectors-from', tmp_path / 'detectors.yaml') == 2
    assert 'needs PyYAML, which is not installed here' in capsys.readouterr().err


def test_a_detector_that_raises_is_named(sequence, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(type(detectors.create('fast')), 'detect_impl', lambda self, image, mask: 1 // 0)
    assert main(sequence, '--output', tmp_path, '-d', 'label=fast') == 2
    assert re.search(r'^compare_detectors: label: fails on an image of 260x200 pixels: ZeroDivisionError: .* '
                     r'\(.*test_comparison_command.py, line \d+\)$', capsys.readouterr().err)


def test_the_best_is_marked_and_what_can_not_be_told_apart(sequence, tmp_path):
    assert main(sequence, '--output', tmp_path, '--repeats', 1, '-d', 'a=harris', '-d', 'b=harris',
                '-d', 'c=harris:subpixel=no,window=box,window_size=15') == 0
    rows = {row['detector']: row for row in read_csv(tmp_path / 'summary.csv')
            if row['measure'] == 'repeatability_1.5' and row['group'] == 'all'}
    assert [rows[label]['best'] for label in 'abc'] == ['1', '1', '0']     # equals are both best
    assert rows['c']['as_good_as_best'] == '0'


# Bad input ----------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize(('arguments', 'said'), [
    (['nowhere'], 'nowhere: no such file or folder'),
    (['{data}', '-d', 'surf'], "unknown detector 'surf'; there are fast"),
    (['{data}', '-d', 'harris:size=3'], "harris has no parameter 'size'; it has window_size"),
    (['{data}', '--detectors-from', 'no.yaml'], 'no.yaml: no such file'),
    (['--pair', '{data}/img1.png', '{data}/img2.png', '{data}/H'], '{data}/H: no such file'),
    (['--photograph', '{data}/H1to2p'], 'H1to2p: not an image'),
])
def test_bad_input_is_one_line_and_status_2(sequence, tmp_path, capsys, arguments, said):
    assert main(*(each.format(data=sequence) for each in arguments), '--output', tmp_path / 'out') == 2
    error = capsys.readouterr().err
    assert said.format(data=sequence) in error
    assert error.startswith('compare_detectors: ')
    assert error.count('\n') == 1
    assert 'Traceback' not in error


@pytest.mark.parametrize('arguments', [['--points', '0'], ['--epsilon', '-1'], ['--workers', 'x'], ['--every', '0']])
def test_bad_options(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(*arguments)
    assert stop.value.code == 2
    assert f'argument {arguments[0]}' in capsys.readouterr().err


def test_an_output_that_can_not_be_written(sequence, tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert main(sequence, '--output', tmp_path / 'file' / 'out') == 2
    assert 'give another folder with --output' in capsys.readouterr().err


# Going on -----------------------------------------------------------------------------------------------------------

def results_in(folder):
    return sorted((folder / 'results').glob('*.json'))


def without_times(rows):
    return [{name: value for name, value in row.items() if not name.startswith('median_ms')} for row in rows]


@pytest.fixture(scope='module')
def photograph(tmp_path_factory):
    path = tmp_path_factory.mktemp('photograph') / 'photo.png'
    cv2.imwrite(str(path), texture((150, 186), smoothing=2.0))
    return path


@pytest.fixture(scope='module')
def uninterrupted(photograph, tmp_path_factory):
    folder = tmp_path_factory.mktemp('uninterrupted')
    assert main('--photograph', photograph, '--output', folder, *QUICK) == 0
    return folder


def test_a_second_call_gives_the_same_report(photograph, uninterrupted, capsys):
    before = {path.name: path.read_bytes() for path in uninterrupted.iterdir() if path.is_file()}
    assert set(before) == {'report.html', 'report.md', 'summary.csv', 'pairs.csv', 'comparison.png'}
    times = {path: path.stat().st_mtime_ns for path in results_in(uninterrupted)}
    assert main('--photograph', photograph, '--output', uninterrupted, *QUICK) == 0
    assert {path.name: path.read_bytes() for path in uninterrupted.iterdir() if path.is_file()} == before
    assert {path: path.stat().st_mtime_ns for path in results_in(uninterrupted)} == times


def workers_of(process):
    """The processes that measure, of a running comparison."""
    children = Path(f'/proc/{process.pid}/task/{process.pid}/children').read_text().split()
    return [int(child) for child in children if b'spawn_main' in Path(f'/proc/{child}/cmdline').read_bytes()]


@pytest.mark.parametrize(('number', 'of', 'workers'), [
    (signal.SIGKILL, 'parent', 1), (signal.SIGKILL, 'parent', 2), (signal.SIGTERM, 'parent', 2),
    (signal.SIGINT, 'parent', 1), (signal.SIGTERM, 'group', 2), (signal.SIGINT, 'group', 2),
    (signal.SIGKILL, 'worker', 2)])
def test_it_goes_on_after_an_interruption(photograph, uninterrupted, tmp_path, number, of, workers):
    arguments = ('--photograph', photograph, '--output', tmp_path, *QUICK, '--workers', workers)
    process = start(*arguments)
    try:
        deadline = time.monotonic() + 60
        while len(results_in(tmp_path)) < 3:
            assert process.poll() is None, process.communicate()[1]
            assert time.monotonic() < deadline
            time.sleep(0.002)
        measuring = workers_of(process)
        if of == 'group':
            os.killpg(process.pid, number)
        else:
            os.kill(process.pid if of == 'parent' else measuring[0], number)
        _, errors = process.communicate(timeout=10)    # the pipes end with the last worker: none is left behind
    finally:
        process.kill()
        process.communicate()
    assert len(measuring) == (workers if workers > 1 else 0)
    if of == 'worker':
        assert process.returncode == 1
        assert 'a worker process has died, perhaps for lack of memory (ended by SIGKILL)' in errors
    elif number == signal.SIGKILL:
        assert process.returncode == -signal.SIGKILL
    else:
        assert process.returncode == 128 + number
        assert errors.splitlines()[-1].endswith('and the same command goes on from there.')
    assert 'Traceback' not in errors
    finished = results_in(tmp_path)
    assert 3 <= len(finished) < len(results_in(uninterrupted))
    assert not (tmp_path / 'report.html').exists()

    finished[0].write_text(finished[0].read_text()[:50])        # torn, as by a full disk
    finished[1].write_text('[]')
    kept = {path: path.stat().st_mtime_ns for path in finished[2:]}
    assert main(*arguments[:-1], 1) == 0       # how many workers there are decides no number
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert [path.name for path in results_in(tmp_path)] == [path.name for path in results_in(uninterrupted)]
    assert without_times(read_csv(tmp_path / 'pairs.csv')) == without_times(read_csv(uninterrupted / 'pairs.csv'))


peers = []


def close_peer():
    peers.pop().close()


@pytest.mark.parametrize('jobs', [[], [dict, close_peer]])
def test_a_worker_whose_parent_dies_with_an_answer_unread_ends_without_a_word(jobs):
    """Its pipe is then not at its end, but reset."""
    ours, theirs = multiprocessing.Pipe()
    for job in jobs:
        ours.send((job, (), {}))
    peers.append(ours)
    if not jobs:
        theirs.send('unread')
        close_peer()
    interrupted = signal.getsignal(signal.SIGINT)
    try:
        executors._work(theirs)
    finally:
        signal.signal(signal.SIGINT, interrupted)


def test_what_changes_is_measured_anew(sequence, tmp_path):
    def run(*more):
        assert main(sequence, '--output', tmp_path, *QUICK, *more) == 0
        return len(results_in(tmp_path))

    assert run() == 2
    assert run() == 2
    assert run('--points', 90) == 4
    assert run('--seed', 7) == 6
    original = (sequence / 'H1to3p').read_text()
    (sequence / 'H1to3p').write_text(original.replace('0.0000', '0.0001', 1))
    try:
        assert run() == 7
    finally:
        (sequence / 'H1to3p').write_text(original)


def test_results_are_whole_json(uninterrupted):
    for path in results_in(uninterrupted):
        content = json.loads(path.read_text())
        assert content['key'] == path.stem
        assert set(content['result']['contestants']) == {'harris', 'fast'}


# Somewhere else -----------------------------------------------------------------------------------------------------

def test_a_dask_cluster_gives_the_same_numbers(photograph, uninterrupted, tmp_path, monkeypatch):
    distributed = pytest.importorskip('distributed', reason='Dask is not installed')
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join([str(SOURCE), os.environ.get('PYTHONPATH', '')]))
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                                  worker_dashboard_address=None, host='127.0.0.1') as cluster:
        assert main('--photograph', photograph, '--output', tmp_path, *QUICK,
                    '--dask-scheduler', cluster.scheduler_address) == 0
    assert without_times(read_csv(tmp_path / 'pairs.csv')) == without_times(read_csv(uninterrupted / 'pairs.csv'))
    assert {json.loads(path.read_text())['result']['concurrent'] for path in results_in(tmp_path)} == {2}


def test_a_dask_scheduler_that_is_not_there(sequence, tmp_path, capsys, monkeypatch):
    pytest.importorskip('distributed', reason='Dask is not installed')
    from rvc_features.comparison import executors
    monkeypatch.setattr(executors, '_DASK_TIMEOUT', 0.5)
    assert main(sequence, '--output', tmp_path, '--dask-scheduler', 'tcp://127.0.0.1:9') == 2
    assert 'no Dask scheduler answers at tcp://127.0.0.1:9' in capsys.readouterr().err


@pytest.mark.parametrize('address', ['nonsense', '::', 'tcp://x:99999999', 'tcp://'])
def test_what_is_no_address(sequence, tmp_path, capsys, address):
    pytest.importorskip('distributed', reason='Dask is not installed')
    assert main(sequence, '--output', tmp_path, '--dask-scheduler', address) == 2
    assert f"'{address}' is no address of a Dask scheduler: write it as tcp://host:8786" in capsys.readouterr().err


def test_without_dask_one_sentence(sequence, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    assert main(sequence, '--output', tmp_path, '--dask-scheduler', 'tcp://127.0.0.1:9') == 2
    assert '--dask-scheduler needs Dask, which is not installed here: python3 -m pip install' in capsys.readouterr().err


def test_no_ros_is_needed():
    program = ('import sys\n'
               'class NoRos:\n'
               '    def find_spec(self, name, path=None, target=None):\n'
               "        if name.split('.')[0] in {'rospy', 'rosbag', 'roslib', 'genpy', 'sensor_msgs', 'std_msgs'}:\n"
               "            raise ImportError('imports ' + name)\n"
               'sys.meta_path.insert(0, NoRos())\n'
               'from rvc_features.comparison import command\n'
               "sys.exit(command.main(['drive.bag', '--kind', 'bag']))\n")
    result = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, cwd=SOURCE, timeout=60,
                            env=environment(), check=False)
    assert (result.returncode, result.stderr.count('\n')) == (2, 1), result.stderr
    assert 'drive.bag: no such file' in result.stderr


def test_every_detector_is_timed_in_turn(monkeypatch):
    from rvc_features.comparison import pair_task
    order = []

    class Fake:
        def __init__(self, name):
            self.name = name

        def detect(self, image):
            order.append(self.name)
            return []

    _, times = pair_task._detected([Fake('a'), Fake('b')], [np.zeros((2, 2))], repeats=2)
    assert order == ['a', 'b'] * 3       # one round to warm up, two timed
    assert [len(each) for each in times[0]] == [2, 2]
    assert measures.covered_cells(np.empty((0, 2)), (2, 2)) == 0
