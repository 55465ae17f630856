"""The executables in scripts/, as far as no master is needed."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / 'scripts'

# Ctrl-C at the moment when the first module of ours is looked for.
INTERRUPTED = """
import os, runpy, signal, sys

class Finder:
    def find_spec(self, name, *arguments):
        if name == 'rvc_features':
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Finder())
runpy.run_path(sys.argv[1], run_name='__main__')
"""


@pytest.mark.parametrize('script', sorted(SCRIPTS.iterdir()), ids=lambda path: path.name)
def test_ctrl_c_at_the_start_leaves_no_traceback(script):
    ended = subprocess.run([sys.executable, '-c', INTERRUPTED, str(script)], stderr=subprocess.PIPE, timeout=60,
                           check=False)
    assert (ended.returncode, ended.stderr) == (-signal.SIGINT, b'')


@pytest.mark.parametrize(('what', 'line'), [
    ('print("x" * 100_000, flush=True)', '-c: [Errno 28] No space left on device\n'), ('1 // 0', 'Traceback')])
def test_what_can_not_be_printed_is_said_in_a_line(what, line):
    code = f'from rvc_features.command_line import print_safely; print_safely(); {what}'
    with open('/dev/full', 'w') as full:
        ended = subprocess.run([sys.executable, '-c', code], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60,
                               cwd=SCRIPTS.parent / 'src', check=False)
    assert ended.returncode == 1
    assert ended.stderr.startswith(line)
