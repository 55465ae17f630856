"""OpenCV's threads in a node: they must not spin, and are told so before OpenCV is there to be told."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_SOURCE = str(Path(__file__).parents[2] / 'src')
_CODE = '''
import os, sys
import rvc_features.nodes
print('cv2' in sys.modules, *(os.environ['OPENCV_THREAD_POOL_ACTIVE_WAIT_' + who] for who in ('WORKER', 'MAIN')))
'''


@pytest.mark.parametrize(('chosen', 'told'), [
    ({}, '0 0'), ({'OPENCV_THREAD_POOL_ACTIVE_WAIT_WORKER': '2000'}, '2000 0')])
def test_threads_are_told_before_opencv_is_loaded_and_a_users_own_choice_stays(chosen, told):
    answer = subprocess.run([sys.executable, '-c', _CODE], env={**os.environ, 'PYTHONPATH': _SOURCE, **chosen},
                            capture_output=True, text=True, check=True, timeout=60)
    assert answer.stdout.split(maxsplit=1) == ['False', told + '\n']
