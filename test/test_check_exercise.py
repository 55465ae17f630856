#!/usr/bin/env python3
"""check_exercise on running nodes: ours is right, a careless one is told what it does wrong."""

import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import rostest


def examined(*topics):
    """Exit status, and the result as written for marking."""
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / 'result.json'
        done = subprocess.run(['rosrun', 'rvc_features', 'check_exercise', '--json', str(results), '--pictures', folder,
                               '--node', *topics], capture_output=True, text=True, timeout=90)
        return done, json.loads(results.read_text())[0] if results.exists() else {}


class TestCheckExercise(unittest.TestCase):
    def test_our_node_is_right(self):
        done, result = examined('in:=/camera', 'image:=/ours/image', 'key_points:=/ours/key_points')
        self.assertEqual([check for check in result['checks'] if check['status'] == 'failed'], [])
        self.assertEqual(done.returncode, 0, done.stdout)
        passed = {check['check'] for check in result['checks'] if check['status'] == 'passed'}
        self.assertLessEqual({'header', 'encoding', 'picture', 'newest frame', 'parameters', 'edges', 'threshold',
                              'ANMS', 'octaves', 'orientation'}, passed)

    def test_a_careless_node(self):
        done, result = examined('in:=/camera', 'image:=/careless/image', 'key_points:=/careless/key_points')
        self.assertEqual(done.returncode, 1)
        failed = {check['check']: check for check in result['checks'] if check['status'] == 'failed'}
        self.assertEqual(failed['header']['mistakes'], ['header lost'])
        self.assertIn('stamp and frame_id', failed['header']['sentence'])
        self.assertEqual(failed['parameters']['mistakes'], ['parameter not live'])
        self.assertIn('threshold does not show', failed['parameters']['sentence'])
        self.assertEqual(set(result['mistakes']) - {'threshold ignored'}, {'header lost', 'parameter not live'})

    def test_nothing_there(self):
        done, _ = examined('in:=/nowhere', 'image:=/nothing')
        self.assertEqual(done.returncode, 2)
        self.assertIn('nobody listens to /nowhere', done.stderr)


if __name__ == '__main__':
    rostest.rosrun('rvc_features', 'check_exercise', TestCheckExercise, sys.argv)
