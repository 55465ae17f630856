"""The detector half imports no ROS: it must work where none is installed."""

import importlib.util
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2] / 'src'
ROS_HALF = {'bags', 'compare_node', 'demo', 'feature_detector_node', 'image_messages', 'image_transport', 'lazy_input',
            'make_bag', 'private_master', 'reconfigure', 'republish', 'spin', 'whole_reads'}
NUMBA_ONLY = set() if importlib.util.find_spec('numba') else {'vectors'}

PROGRAM = """
import importlib, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {'rospy', 'rosbag', 'roslib', 'genpy', 'cv_bridge', 'sensor_msgs', 'std_msgs',
                                  'dynamic_reconfigure', 'diagnostic_updater', 'rosgraph'}:
            raise ImportError('the detector half imports ' + name)

sys.meta_path.insert(0, NoRos())
for module in sys.argv[1:]:
    importlib.import_module('rvc_features.' + module)
from rvc_features import detectors
import numpy
image = numpy.kron(numpy.eye(4, dtype=numpy.uint8) * 255, numpy.ones((16, 16), numpy.uint8))
print(len(detectors.create('harris').detect(image)))
"""


def test_the_detector_half_works_without_ros():
    modules = sorted(path.stem for path in (SOURCE / 'rvc_features').glob('*.py') if path.stem != '__init__')
    assert ROS_HALF & set(modules), 'the list above names no module that exists'
    detector_half = [module for module in modules if module not in ROS_HALF | NUMBA_ONLY]
    result = subprocess.run([sys.executable, '-c', PROGRAM, *detector_half], capture_output=True, text=True,
                            cwd=SOURCE, timeout=120, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 0
