"""The detector half imports no ROS: it must work where none is installed."""

import importlib.util
import subprocess
import sys
from pathlib import Path

from test_layout import FILES, TOP_WITH_ROS, WITHOUT_ROS, module_of, room_of

SOURCE = Path(__file__).resolve().parents[2] / 'src'
NUMBA_ONLY = set() if importlib.util.find_spec('numba') else {'kernels.vectors'}

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
    detector_half = [module for module in map(module_of, FILES)
                     if module and {module, room_of(module)} & WITHOUT_ROS
                     and module not in TOP_WITH_ROS | NUMBA_ONLY]
    assert 'comparison.command' in detector_half
    result = subprocess.run([sys.executable, '-c', PROGRAM, *detector_half], capture_output=True, text=True,
                            cwd=SOURCE, timeout=120, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 0
