"""The rooms of src/rvc_features and what each may import, read from the source."""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / 'src' / 'rvc_features'
GENERATED = {'cfg', 'msg', 'srv'}   # made by catkin from cfg/, msg/ and srv/
ROS = {'rospy', 'rosbag', 'roslib', 'rosgraph', 'roslaunch', 'rosmaster', 'genpy', 'cv_bridge', 'dynamic_reconfigure',
       'diagnostic_msgs', 'diagnostic_updater', 'sensor_msgs', 'std_msgs', 'std_srvs', 'message_filters'}

# What each room may import of the others; `top` are the modules beside the rooms.
MAY_IMPORT = {
    'kernels': set(),
    'top': {'kernels'},
    'still_images': set(),
    'image_transport': {'top', 'still_images'},
    'recordings': {'top', 'still_images', 'image_transport'},
    'odometry': {'top', 'recordings'},
    'comparison': {'top', 'recordings', 'odometry'},
    'nodes': {'top', 'kernels', 'image_transport', 'recordings', 'odometry', 'comparison'},
    'demo': {'top', 'image_transport', 'recordings'},
    'windows': {'top', 'nodes'},
    'exercise': {'top', 'image_transport'},
}
# Modules that work where no ROS is installed.
WITHOUT_ROS = {'kernels', 'top', 'still_images', 'odometry', 'comparison', 'recordings.image_sources',
               'recordings.file_times', 'recordings.regular_files', 'recordings.whole_files', 'nodes.detector_config',
               'nodes.sliders', 'nodes.newest_worker', 'nodes.settings', 'nodes.statistics',
               'nodes.diagnostics', 'nodes.detector_modules',
               'windows.panel', 'windows.ranges',
               *(f'exercise.{module}' for module in (
                   'child', 'command', 'drawings', 'examination', 'findings', 'mistakes', 'mistakes_of_exercise_2',
                   'pictures', 'questions', 'reference', 'scenes', 'subject'))}
TOP_WITH_ROS = {'reconfigure'}
MOST_LINES = 320

FILES = sorted(PACKAGE.rglob('*.py'))


def module_of(path):
    parts = path.relative_to(PACKAGE).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def room_of(module):
    """The room that a module (without the package's name) lies in."""
    first = module.split('.')[0]
    return first if first in MAY_IMPORT else 'top'


def imports_of(path):
    """Every module that a file imports, at its top or inside a function, with the package's own as rvc_features.X."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: imports name the package in full'
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def own_imports(path):
    for name in imports_of(path):
        if name.startswith('rvc_features.'):
            module = name[len('rvc_features.'):]
            if module.split('.')[0] not in GENERATED:
                yield module


def test_every_room_is_known():
    rooms = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != '__pycache__'}
    assert rooms == set(MAY_IMPORT) - {'top'}


@pytest.mark.parametrize('path', FILES, ids=module_of)
def test_imports_go_one_way(path):
    room = room_of(module_of(path))
    for module in own_imports(path):
        assert room_of(module) in MAY_IMPORT[room] | {room}, f'{room} may not import {module}'


@pytest.mark.parametrize('path', FILES, ids=module_of)
def test_the_detector_half_names_no_ros(path):
    module = module_of(path)
    if module in TOP_WITH_ROS or not {module, room_of(module)} & WITHOUT_ROS:
        return
    assert not {name.split('.')[0] for name in imports_of(path)} & ROS
    generated = [name for name in imports_of(path) if re.match(r'rvc_features\.(cfg|msg)\b', name)]
    assert not generated, 'what catkin generates needs ROS'


@pytest.mark.parametrize('path', [path for path in FILES if room_of(module_of(path)) == 'kernels'], ids=module_of)
def test_only_modules_with_a_twin_import_kernels(path):
    """And no kernel imports its reference: the top calls down, never the other way round."""
    assert all(room_of(module) == 'kernels' for module in own_imports(path))


@pytest.mark.parametrize('path', FILES, ids=module_of)
def test_no_file_is_too_long_to_read(path):
    assert len(path.read_text().splitlines()) <= MOST_LINES


# ---- Every kernel has its reference, and a test that compares the two ----

# The files of kernels/ whose functions the top calls; the others are what those are made of.
CALLED = {module.split('.')[1] for path in FILES if room_of(module_of(path)) == 'top'
          for module in own_imports(path) if module.startswith('kernels.')}
TWINS = [PACKAGE / 'kernels' / f'{name}.py' for name in sorted(CALLED - {'compiler'})]


def public_kernels(path):
    """Name and docstring of each public function of a file in kernels/ that modules outside it call."""
    own = f'rvc_features.kernels.{path.stem}'
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith('_'):
            elsewhere = any(f'{own}.{node.name}' in set(imports_of(other)) for other in TWINS)
            if not elsewhere:   # a part that two kernels share
                yield node.name, ast.get_docstring(node) or ''


KERNELS = [(path, *kernel) for path in TWINS for kernel in public_kernels(path)]


def test_kernels_are_found():
    assert len(KERNELS) >= 8


@pytest.mark.parametrize(('path', 'name', 'text'), KERNELS, ids=[f'{path.stem}.{name}' for path, name, _ in KERNELS])
def test_each_kernel_has_a_reference_and_a_test(path, name, text):
    named = re.search(r'reference: `(\w+)\.(\w+)`', text)
    assert named, f'kernels/{path.name}: {name} names no reference in its docstring'
    module, reference = named.groups()
    functions = {node.name for node in ast.parse((PACKAGE / f'{module}.py').read_text()).body
                 if isinstance(node, ast.FunctionDef)}
    assert reference in functions, f'{name} names {module}.{reference}, which does not exist'
    tests = [node for file in Path(__file__).parent.glob('test_kernels*.py')
             for node in ast.walk(ast.parse(file.read_text()))
             if isinstance(node, ast.FunctionDef) and node.name.startswith('test_')]
    called = [{part.attr for part in ast.walk(test) if isinstance(part, ast.Attribute)}
              | {part.id for part in ast.walk(test) if isinstance(part, ast.Name)} for test in tests]
    assert any({name, reference} <= names for names in called), f'no test compares {name} with {reference}'


class Subscripts(ast.NodeVisitor):
    """Lines where `set[str]` and the like are evaluated, and not only an annotation."""

    def __init__(self):
        self.lines = []

    def visit_AnnAssign(self, node):
        if node.value is not None:
            self.visit(node.value)

    def visit_arg(self, node):
        pass

    def visit_FunctionDef(self, node):
        for part in [*node.decorator_list, node.args, *node.body]:
            self.visit(part)

    def visit_Subscript(self, node):
        if isinstance(node.value, ast.Name) and node.value.id in ('set', 'frozenset', 'list', 'dict', 'tuple', 'type'):
            self.lines.append(node.lineno)
        self.generic_visit(node)


@pytest.mark.parametrize('path', FILES, ids=module_of)
def test_python_3_8_can_run_it(path):
    """That of ROS Noetic, where the built-in types take no subscript."""
    subscripts = Subscripts()
    subscripts.visit(ast.parse(path.read_text(), feature_version=(3, 8)))
    assert subscripts.lines == []
