"""Every command and every piece of code in the documents is run, or stands in one of two tables that say why not.

The step `docs` of run_tests.py runs this: it needs the package as it is built, with its messages and configurations.
"""

import argparse
import ast
import contextlib
import glob
import importlib
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from unittest import mock

import cv2
import documents
import numpy as np
import pytest
import yaml
from documents import ROOT

roslaunch_arg_dump = pytest.importorskip('roslaunch.arg_dump')

# Neither run nor taken apart, by what the command begins with.
NOT_TRIED = {
    'apt install': 'changes the system',
    'sudo apt-get install': 'the same; test_documents.py compares its packages with those of `run`',
    'catkin_make': 'needs a catkin workspace, and takes a minute',
    'mkdir rqt': 'rqt from its sources: fetches them from the network, and opens a window',
    'git clone': 'the same',
    'for folder in': 'the same',
    'export ROS_PACKAGE_PATH': 'the same',
    'python3 rqt_reconfigure': 'the same',
    'rosdep install': 'changes the system',
    'dask ': 'a cluster of its own; test_comparison_command.py has one',
    'rosbag play': 'needs a master, and never ends',
    'rosparam dump': 'needs a running node; test_settings.py does it',
    'rostopic echo': 'needs a running node',
    'rosservice info': 'needs a running node',
}
# Taken apart by the program itself, with all its options, but not run; by what the command begins with.
ONLY_PARSED = {
    './run ': 'the entry itself: each takes minutes',
    'rosrun rvc_features feature_detector': 'a node: never ends; the rostests start it',
    'rosrun rvc_features republish': 'the same',
    'rosrun rvc_features convert_points': 'the same',
    'rosrun rvc_features sliders': 'opens a window; test_settings.py opens it on a virtual screen',
    'rosrun rvc_features check_exercise --node': 'needs a running node; test_check_exercise.py has some',
    'rosrun rvc_features compare_detectors -d course': 'takes minutes; test_comparison_command.py runs it',
    'rosrun rvc_features compare_detectors drive.bag --topic /camera/image_raw --workers': 'the same',
    'rosrun rvc_features compare_detectors drive.bag --topic /camera/image_raw --dask': 'needs a cluster',
    'rosrun rvc_features compare_tracks': 'takes minutes; test_comparison_tracks.py runs it',
    'rosrun rvc_features TOOL': 'stands for any tool',
    'python3 -m benchmarks': 'takes minutes',
    'PYTHONPATH=src': 'takes minutes; test_no_ros.py runs it',
}
EXACTLY = {'rosrun rvc_features compare_detectors': 'takes minutes; test_comparison_command.py runs it'}

COMMANDS = documents.commands()
BLOCKS = list(documents.blocks())


def reason(command, table):
    return next((why for start, why in table.items() if command.text.startswith(start)), None)


def is_run(command):
    """The tools that work on files, and what reads their results."""
    return (command.text.startswith(('rosrun rvc_features', 'python3 -c', 'python3 -m rvc_features'))
            and not reason(command, {**NOT_TRIED, **ONLY_PARSED}) and command.text not in EXACTLY)


def test_no_table_has_a_line_too_many():
    starts = [*NOT_TRIED, *ONLY_PARSED]
    assert [start for start in starts if not any(command.text.startswith(start) for command in COMMANDS)] == []


# ---- Taken apart ----

class Parsed(BaseException):
    """The arguments were accepted."""


def parse(script, arguments, module=False):
    """Run a program up to where its arguments are parsed; pytest's failure where they are refused."""
    original = argparse.ArgumentParser.parse_args

    def parse_args(self, args=None, namespace=None):
        raise Parsed(original(self, args, namespace))

    with mock.patch.object(argparse.ArgumentParser, 'parse_args', parse_args), \
            mock.patch.object(sys, 'argv', [str(script), *arguments]), mock.patch('signal.signal'):
        try:
            if module:
                runpy.run_module(script, run_name='__main__')
            else:
                runpy.run_path(str(script), run_name='__main__')
        except Parsed as accepted:
            return accepted.args[0]
        except SystemExit as refused:
            pytest.fail(f'{script} refuses {arguments}: status {refused.code}')
    return pytest.fail(f'{script} takes no arguments')


def dynamic_parameters(name='FeatureDetectorConfig'):
    return importlib.import_module(f'rvc_features.cfg.{name}Config').defaults


NODES = {'feature_detector': 'feature_detector_node', 'republish': 'republish', 'convert_points': 'convert_node'}


def try_tool(words):
    tool, arguments = words[0], words[1:]
    if tool == 'TOOL':
        return
    script = ROOT / 'scripts' / tool
    assert script.is_file()
    parse(script, arguments)
    for name in [word.partition(':=')[0] for word in arguments if ':=' in word and tool in NODES]:
        said = (ROOT / 'src' / 'rvc_features' / 'nodes' / f'{NODES[tool]}.py').read_text()
        known = re.search(rf'^    ~?{name.lstrip("_")} \(|\b{name}:=', said, re.MULTILINE)
        assert known or name.lstrip('_') in dynamic_parameters(), f'{tool} has no {name}'


def try_launch(words):
    from roslaunch import config, xmlloader
    file = str(ROOT / 'launch' / words[0])
    given = dict(word.split(':=', 1) for word in words[1:])
    assert set(given) <= set(roslaunch_arg_dump.get_args([file]))
    loaded = config.ROSLaunchConfig()
    xmlloader.XmlLoader().load(file, loaded, argv=words[1:], verbose=False)
    assert loaded.nodes


def try_dynparam(words):
    verb, node, *rest = words
    if verb == 'set':
        config = 'CompressedPublisher' if node.endswith('/compressed') else 'FeatureDetectorConfig'
        value = yaml.safe_load(rest[1])
        assert type(dynamic_parameters(config)[rest[0]]) is type(value)
    else:
        assert verb in ('dump', 'load')
        assert len(rest) == 1


def try_run(words):
    name, arguments = words[0], words[1:]
    if name == 'exec':
        try_command(arguments or ['CMD'])
    elif name == 'test':
        runner = runpy.run_path(str(ROOT / 'test' / 'run_tests.py'))
        steps = re.findall(r"'(\w+)': lambda", (ROOT / 'test' / 'run_tests.py').read_text())
        assert set(arguments) <= {*steps, *runner['ROSTESTS']}
    elif name == 'bench':
        try_module(['benchmarks', *arguments])
    elif name == 'soak':
        parse(ROOT / 'test' / 'soak.py', [word.replace('N', '1') for word in arguments])
    elif name in ('demo', 'compare'):
        parse(ROOT / 'scripts' / {'compare': 'compare_detectors'}.get(name, name), arguments)
    else:
        assert arguments == []
        assert re.search(rf'^  {name}( \||\))', (ROOT / 'run').read_text(), re.MULTILINE)


def try_module(words):
    if words[0] == 'pytest':
        assert [file for file in words[1:] if not (ROOT / file).is_file()] == []
    elif words[0] == 'benchmarks':
        with mock.patch.object(sys, 'path', [str(ROOT), *sys.path]):
            given = parse('benchmarks', words[1:], module=True)
            assert set(given.names) <= set(importlib.import_module('benchmarks.__main__').NAMES)
    else:
        parse(words[0], words[1:], module=True)


def try_command(words):
    if words[:2] == ['rosrun', 'rvc_features']:
        try_tool(words[2:])
    elif words[:2] == ['rosrun', 'dynamic_reconfigure']:
        assert words[2] == 'dynparam'
        try_dynparam(words[3:])
    elif words[:2] == ['roslaunch', 'rvc_features']:
        try_launch(words[2:])
    elif words[0] == './run':
        try_run(words[1:])
    elif words[:2] == ['python3', '-m']:
        try_module(words[2:])
    elif words[:2] == ['PYTHONPATH=src', 'python3']:
        try_command(words[1:])
    elif words[:2] == ['python3', '-c']:
        ast.parse(words[2])
    elif len(words) > 1 or words[0] != 'CMD':
        assert words == ['python3'] or (ROOT / words[0]).is_file(), f'nobody knows what {words[0]} is'


@pytest.mark.filterwarnings('ignore:.*found in sys.modules:RuntimeWarning')   # modules that are run as programs again
@pytest.mark.parametrize('command', [command for command in COMMANDS if not reason(command, NOT_TRIED)],
                         ids=lambda command: f'{command.place} {command.text}')
def test_programs_accept_their_arguments(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'tuned.yaml').write_text('threshold: 0.02\n')
    try_command(command.words)


# ---- Run ----

@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """A folder with everything that the documents' examples name, as small as can be."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')]))
    monkeypatch.setenv('PWD', str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    image = cv2.GaussianBlur(np.kron(np.random.default_rng(1).integers(0, 256, (12, 16)), np.ones((10, 10))), (0, 0), 1)
    frames = [np.roll(image, shift, axis=1).astype(np.uint8) for shift in (0, 1, 2)]
    cv2.imwrite('photograph.jpg', frames[0])
    for folder in ('frames', 'oxford/graf', 'oxford/boat', 'SEQUENCE_FOLDER'):
        Path(folder).mkdir(parents=True)
        for number, frame in enumerate(frames[:2], 1):
            cv2.imwrite(f'{folder}/{"frame" if folder == "frames" else "img"}{number}.png', frame)
        if folder != 'frames':
            Path(folder, 'H1to2p').write_text('1 0 1\n0 1 0\n0 0 1\n')
    solution = ROOT / 'test' / 'unit' / 'exercise_solutions' / 'plain.py'
    for place in ('my_harris.py', 'my_pkg/harris.py', 'submissions/one.py'):
        Path(place).parent.mkdir(exist_ok=True)
        shutil.copy(solution, place)
    shutil.copy(ROOT / 'test' / 'own_detector.py', 'YOUR_MODULE.py')
    Path('camera.yaml').write_text(yaml.safe_dump({
        'image_width': 160, 'image_height': 120, 'camera_name': 'camera', 'distortion_model': 'plumb_bob',
        'camera_matrix': {'rows': 3, 'cols': 3, 'data': [100, 0, 80, 0, 100, 60, 0, 0, 1]},
        'distortion_coefficients': {'rows': 1, 'cols': 5, 'data': [0] * 5},
        'rectification_matrix': {'rows': 3, 'cols': 3, 'data': [1, 0, 0, 0, 1, 0, 0, 0, 1]},
        'projection_matrix': {'rows': 3, 'cols': 4, 'data': [100, 0, 80, 0, 0, 100, 60, 0, 0, 0, 1, 0]}}))
    video = cv2.VideoWriter('drive.mp4', cv2.VideoWriter_fourcc(*'mp4v'), 10, (160, 120))
    for frame in frames:
        video.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    video.release()
    run_script('make_bag', ['drive.bag', 'frames', '--rate', '10', '--topic', '/camera/image_raw'])
    return tmp_path


def run_script(tool, arguments):
    """Exit status of a tool that runs in this process."""
    with mock.patch.object(sys, 'argv', [tool, *arguments]), contextlib.suppress(AttributeError):
        try:
            runpy.run_path(str(ROOT / 'scripts' / tool), run_name='__main__')
        except SystemExit as ended:
            return ended.code or 0
    return 0


def run_words(words):
    words = [file for word in words for file in (sorted(glob.glob(word)) if word.endswith('*.jpg') else [word])]
    if words[:2] == ['rosrun', 'rvc_features']:
        return run_script(words[2], words[3:])
    return subprocess.run([sys.executable, *words[1:]], timeout=100, check=False).returncode


def test_tools_do_what_the_documents_type(workspace, capfd):
    failed = []
    for command in filter(is_run, COMMANDS):
        status = run_words(command.words)
        if status != 0:
            failed.append(f'{command.place}: {command.text}: status {status}: {capfd.readouterr().err[-300:]}')
    assert failed == []
    assert {path.name for path in workspace.iterdir()} >= {
        'OUTPUT.bag', 'folder_or_video.avi', 'chessboard.bag', 'marks.json', 'compare_output'}
    assert json.loads(Path('marks.json').read_text())[0]['mistakes'] == []


SNIPPETS = r'''
import json, os, sys, traceback
import rospy
from rvc_features.demo.private_master import private_master
failed = []
with private_master("documents"):
    rospy.init_node = lambda *arguments, **options: None   # done
    rospy.spin = lambda: None
    for place, text in json.load(open("snippets.json")):
        try:
            exec(compile(text, place, "exec"), {"__name__": place})
        except Exception:
            failed.append(traceback.format_exc())
print("\n".join(failed), file=sys.stderr)
sys.stderr.flush()
os._exit(bool(failed))
'''


def test_pieces_of_python_run_as_they_stand(workspace):
    snippets = [(block.place, block.text) for block in BLOCKS if block.language == 'python']
    assert len(snippets) >= 5
    (workspace / 'snippets.json').write_text(json.dumps(snippets))
    ended = subprocess.run([sys.executable, '-c', SNIPPETS], capture_output=True, text=True, timeout=100, check=False)
    assert ended.returncode == 0, ended.stderr


# ---- Other languages ----

def test_files_of_detectors_can_be_read(tmp_path):
    from rvc_features.comparison import contestants
    texts = [block.text for block in BLOCKS if block.language == 'yaml']
    assert len(texts) == 1
    (tmp_path / 'detectors.yaml').write_text(texts[0])
    assert [each.label for each in contestants.read_yaml(str(tmp_path / 'detectors.yaml'), 500)][1:] == [
        'Harris, three octaves', 'ORB, thinned']


@pytest.mark.parametrize('block', [block for block in BLOCKS if block.language == 'xml'], ids=lambda block: block.place)
def test_launch_files_can_be_loaded(block, tmp_path):
    from roslaunch import config, xmlloader
    (tmp_path / 'shown.launch').write_text(block.text)
    loaded = config.ROSLaunchConfig()
    xmlloader.XmlLoader().load(str(tmp_path / 'shown.launch'), loaded, argv=[], verbose=False)
    assert {(node.package, node.type) for node in loaded.nodes} == {('rvc_features', 'feature_detector')}


# Of OpenCV only what the documents use, for its headers are not among what the tests install.
OPENCV = '''
#include <vector>
namespace cv { struct KeyPoint { KeyPoint(float x, float y, float size, float angle, float response, int octave) {} }; }
'''


def test_programs_in_cpp_compile(tmp_path):
    if not shutil.which('g++') or not Path('/usr/include/ros/ros.h').exists():
        pytest.skip('roscpp is not installed as Debian does')
    programs = [block for block in BLOCKS if block.language == 'cpp' and 'int main(' in block.text]
    assert len(programs) == 2
    (tmp_path / 'opencv2').mkdir()
    (tmp_path / 'opencv2' / 'core.hpp').write_text(OPENCV)
    folders = [tmp_path, *(Path(folder, 'include') for folder in os.environ['CMAKE_PREFIX_PATH'].split(':'))]
    for program in programs:
        (tmp_path / 'program.cpp').write_text(program.text)
        ended = subprocess.run(['g++', '-fsyntax-only', '-Wall', *(f'-I{folder}' for folder in folders), 'program.cpp'],
                               cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False)
        assert ended.returncode == 0, f'{program.place}: {ended.stderr[:1000]}'
        assert ended.stderr == '', program.place


def test_other_languages_are_known():
    assert {block.language for block in BLOCKS} <= {'', 'bash', 'python', 'yaml', 'xml', 'cpp', 'cmake'}
