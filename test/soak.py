#!/usr/bin/env python3
"""Live nodes under everything that goes wrong at once, for as long as one likes: `./run soak [--minutes N]`.

Two nodes, one with raw and one with compressed input, get good frames of changing size at several times the rate that
they can follow, damaged messages of all kinds, storms of parameters, subscribers that come and go, connections that say
nothing or rubbish, publishers that break off in mid-message, SIGSTOP, and a master that is restarted. Every few seconds
the noise pauses and a good frame must get the right answer. In the end comes a table, and status 0 if all held.
"""

import argparse
import contextlib
import math
import os
import random
import re
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.msg import BoolParameter, Config, DoubleParameter, IntParameter, StrParameter
from dynamic_reconfigure.srv import Reconfigure
from rvc_features.msg import KeyPoints
from sensor_msgs.msg import CompressedImage, Image

from rvc_features import detectors
from rvc_features.brief import reporter
from rvc_features.image_transport.compressed import to_compressed_message
from rvc_features.image_transport.messages import to_image_message
from rvc_features.nodes.graph_watch import GraphWatch

SECONDS = 30.0           # for anything that must happen
ROUND = 4.0              # seconds of noise between two good frames that are looked at
LARGEST_GROWTH = 150e6   # bytes of resident memory
MORE_DESCRIPTORS, MORE_THREADS = 8, 8
LOG_BYTES = 60_000       # a minute and node: 2 kB for each of the causes there are here
GOOD = np.kron(np.random.default_rng(1).integers(0, 256, (60, 80), np.uint8), np.ones((8, 8), np.uint8))
SIZES = ((480, 640), (120, 160), (1080, 1920), (33, 47), (720, 1280), (2, 5000), (480, 640), (2160, 3840), (240, 320))


class Node:
    """One node under test, and what is known of its process."""

    def __init__(self, name, transport, folder):
        self.name, self.transport = name, transport
        self.topic = f'/{name}/camera' + ('' if transport == 'raw' else f'/{transport}')
        self.errors = folder / f'{name}.stderr'
        with open(self.errors, 'wb') as output:
            self.process = subprocess.Popen(
                ['rosrun', 'rvc_features', 'feature_detector', f'__name:={name}', f'in:=/{name}/camera',
                 f'image:=/{name}/image', f'key_points:=/{name}/key_points', f'response:=/{name}/response',
                 f'_image_transport:={transport}'],
                stdout=output, stderr=output, start_new_session=True, env={**os.environ, 'ROS_LOG_DIR': str(folder)})
        self.log = folder / f'{name}.log'
        self.sent, self.ages, self.values, self.levels, self.messages = Counter(), [], {}, Counter(), Counter()
        self.answers, self.answered = {}, threading.Condition()
        rospy.Subscriber(f'/{name}/key_points', KeyPoints, self._answer, queue_size=100)
        kind = Image if transport == 'raw' else CompressedImage
        self.publisher = rospy.Publisher(self.topic, kind, queue_size=1, tcp_nodelay=True)
        self.before = {}

    def _answer(self, message):
        with self.answered:
            self.answers[message.header.stamp] = message
            while len(self.answers) > 50:
                del self.answers[next(iter(self.answers))]
            self.answered.notify_all()
        if message.header.frame_id == 'soak':
            self.ages.append((rospy.Time.now() - message.header.stamp).to_sec())

    def report(self, status):
        self.values = {pair.key: pair.value for pair in status.values}
        self.levels[status.level] += 1
        self.messages.update(re.sub(r'[\d.,]+', '#', text) for text in status.message.split('; '))

    @property
    def pid(self):
        """Of the node itself, whether or not rosrun has become it."""
        return int(subprocess.run(['pgrep', '-s', str(self.process.pid), '-f', 'python3.*feature_detector'],
                                  capture_output=True, text=True, check=True).stdout.split()[0])

    def state(self):
        """Memory in bytes, threads, descriptors."""
        folder = Path(f'/proc/{self.pid}')
        pages = int((folder / 'statm').read_text().split()[1])
        return {'memory': pages * os.sysconf('SC_PAGE_SIZE'), 'threads': len(list((folder / 'task').iterdir())),
                'descriptors': len(list((folder / 'fd').iterdir()))}

    def send(self, image, kind='good', **changes):
        message = (to_image_message(image, 'mono8') if self.transport == 'raw'
                   else to_compressed_message(image, 'mono8', format='png' if kind == 'png' else 'jpeg', png_level=1))
        return self.publish(message, kind, **changes)

    def publish(self, message, kind, **changes):
        message.header.stamp, message.header.frame_id = rospy.Time.now(), 'soak'
        for name, value in changes.items():
            setattr(message, name, value)
        self.publisher.publish(message)
        self.sent[kind] += 1
        return message.header.stamp

    def right_answer(self, expected):
        """Send good frames until one is answered, and compare; a frame may be lost among those before it."""
        deadline = time.monotonic() + SECONDS
        while time.monotonic() < deadline:
            stamp = self.send(GOOD, 'png')
            with self.answered:
                if self.answered.wait_for(lambda stamp=stamp: stamp in self.answers, 1.0):
                    message = self.answers[stamp]
                    return list(message.x) == expected['x'].tolist() and list(message.y) == expected['y'].tolist()
        return False

    def end(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGCONT)
            os.killpg(self.process.pid, signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(10)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)


# ---- Noise: each kind runs in a thread of its own until it is told to stop ----

def hostile_images(node, dice):
    """One damaged message."""
    height, width = dice.choice(SIZES[:5])
    size = height * width
    if node.transport == 'raw':
        kind = dice.choice(('short data', 'long step', 'unknown encoding', 'no pixels', 'giant claim', 'wrong depth',
                            'long text'))
        changes = {'short data': {'data': bytes(dice.randrange(size))}, 'long step': {'step': 2 ** 31},
                   'unknown encoding': {'encoding': dice.choice(('', 'abc8', 'bayer', '99UC4', 'mono\x00'))},
                   'no pixels': {'width': 0, 'height': 0, 'step': 0, 'data': b''},
                   'giant claim': {'width': 2 ** 31, 'height': 2 ** 31, 'step': 2 ** 32 - 1},
                   'wrong depth': {'encoding': dice.choice(('32FC1', '64FC4', '16UC1', 'rgba16'))},
                   'long text': {'encoding': 'x' * dice.choice((1000, 1_000_000))}}[kind]
        node.send(np.zeros((height, width), np.uint8), kind, **changes)
        return
    kind = dice.choice(('cut off', 'flipped bytes', 'noise', 'nothing', 'wrong format', 'long text'))
    image = to_compressed_message(GOOD, 'mono8', format=dice.choice(('jpeg', 'png')), png_level=1)
    data = bytearray(image.data)
    if kind == 'cut off':
        data = data[:dice.randrange(len(data))]
    elif kind == 'flipped bytes':
        for _ in range(dice.randrange(1, 30)):
            data[dice.randrange(len(data))] = dice.randrange(256)
    elif kind == 'noise':
        data = bytearray(os.urandom(dice.randrange(100_000)))
    elif kind == 'nothing':
        data = bytearray()
    changes = {'wrong format': {'format': dice.choice(('theora', ';;;', '16UC1; png', 'bayer_rggb8; jpeg'))},
               'long text': {'format': 'x' * dice.choice((1000, 1_000_000))}}.get(kind, {})
    node.publish(image, kind, data=bytes(data), **changes)


def camera(node, dice, stop, counts):
    """Good frames, now and then of another size, and a damaged one among three; faster than anybody can follow."""
    image = GOOD
    while not stop.wait(0.004):
        if dice.random() < 0.02:
            height, width = dice.choice(SIZES)
            image = cv2.resize(GOOD, (width, height), interpolation=cv2.INTER_NEAREST)
        if dice.random() < 0.33:
            hostile_images(node, dice)
        else:
            node.send(image)
        counts['messages'] += 1


def parameter_storm(node, dice, stop, counts):
    """Requests with values that are right, out of range, of another type, or that nobody has heard of."""
    numbers = (0, 1, -1, 5, 2 ** 31 - 1, -2 ** 31)
    texts = ('harris', 'orb', 'fast', 'good_features_to_track', 'banana', 'x' * 100_000)
    while not stop.wait(0.01):
        request = Config(
            ints=[IntParameter(dice.choice(('window_size', 'octaves', 'orb_levels', 'threshold', 'no')),
                               dice.choice(numbers))],
            doubles=[DoubleParameter(dice.choice(('threshold', 'derivative_sigma', 'harris_k', 'minimum_response')),
                                     dice.choice((0.0, 1e-310, 1e308, math.nan, -math.inf, 0.01)))],
            strs=[StrParameter(dice.choice(('detector', 'window', 'fast_type')), dice.choice(texts))],
            bools=[BoolParameter(dice.choice(('ANMS', 'local_maxima', 'subpixel')), dice.random() < 0.5)])
        try:
            set_parameters(node, request)
            counts['parameter sets'] += 1
        except (rospy.ServiceException, rospy.ROSException, OSError):
            stop.wait(0.2)   # no master, or a node that is stopped


def set_parameters(node, request):
    return rospy.ServiceProxy(f'/{node.name}/set_parameters', Reconfigure)(request)


def come_and_go(node, dice, stop, counts):
    """Subscribers to everything that the node publishes."""
    while not stop.wait(0.02):
        topic, kind = dice.choice((('image', Image), ('image/compressed', CompressedImage), ('response', Image)))
        subscriber = rospy.Subscriber(f'/{node.name}/{topic}', kind, queue_size=1)
        stop.wait(dice.random() / 10)
        subscriber.unregister()
        counts['subscriptions'] += 1


def rude_connections(node, dice, stop, counts):
    """To the port of the node's topics: silence, rubbish, and sizes that never come."""
    kept = []
    while not stop.wait(0.2):
        try:
            uri = rosgraph.Master('/soak').lookupService(f'/{node.name}/set_parameters')
            host, _, port = uri[len('rosrpc://'):].rpartition(':')
            connection = socket.create_connection((host, int(port)), 1)
            what = dice.choice((b'', os.urandom(500), struct.pack('<I', 2 ** 31), struct.pack('<I', 100) + b'x' * 50,
                                b'GET / HTTP/1.0\r\n\r\n'))
            connection.sendall(what)
        except (OSError, rosgraph.MasterException):
            continue
        kept.append(connection)
        counts['rude connections'] += 1
        if len(kept) > 4:
            kept.pop(0).close()
    for connection in kept:
        connection.close()


BREAKS_OFF = '''
import os, sys, threading, time, rospy
from sensor_msgs.msg import Image
rospy.init_node('breaks_off', anonymous=True, disable_signals=True)
publisher = rospy.Publisher(sys.argv[1], Image, queue_size=1)
message = Image(encoding='mono8', width=4000, height=4000, step=4000, data=bytes(16_000_000))
threading.Timer(1.5, os._exit, [9]).start()
while True:
    publisher.publish(message)
'''


class Faults:
    """What happens now and then, one after the other, in the pauses between two rounds."""

    def __init__(self, nodes, master, counts):
        self._nodes, self._master, self._counts = nodes, master, counts
        self._turn = 0

    def next(self):
        faults = (self.stopped, self.broken_off, self.stopped, self.master_restarted)
        faults[self._turn % len(faults)]()
        self._turn += 1

    def stopped(self):
        for node in self._nodes:
            os.kill(node.pid, signal.SIGSTOP)
        time.sleep(1.0)
        for node in self._nodes:
            os.kill(node.pid, signal.SIGCONT)
        self._counts['SIGSTOP for a second'] += 1

    def broken_off(self):
        subprocess.run([sys.executable, '-c', BREAKS_OFF, self._nodes[0].topic], timeout=SECONDS, check=False,
                       stderr=subprocess.DEVNULL)
        self._counts['publishers killed in mid-message'] += 1

    def master_restarted(self):
        self._master.restart()
        names = {f'/{node.name}' for node in self._nodes}
        wanted = {f'/{node.name}/set_parameters' for node in self._nodes}
        deadline = time.monotonic() + SECONDS
        while time.monotonic() < deadline:
            publishers, _, services = rosgraph.Master('/soak').getSystemState()
            publishing = {node for _, nodes in publishers for node in nodes}
            if names | {rospy.get_name()} <= publishing and wanted <= {service for service, _ in services}:
                self._counts['restarts of the master'] += 1
                return
            time.sleep(0.2)
        raise AssertionError('the nodes are not known to the master that was restarted')


class Master:
    """A master of its own in a process of its own, on a free port of the loopback."""

    def __init__(self, folder):
        with socket.socket() as free:
            free.bind(('localhost', 0))
            self._port = free.getsockname()[1]
        os.environ.update(ROS_MASTER_URI=f'http://localhost:{self._port}/', ROS_HOSTNAME='localhost')
        os.environ.pop('ROS_IP', None)
        self._folder = folder
        self.start()

    def start(self):
        self._process = subprocess.Popen(
            ['rosmaster', '--core', '-p', str(self._port)], start_new_session=True, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, env={**os.environ, 'ROS_LOG_DIR': str(self._folder)})
        deadline = time.monotonic() + SECONDS
        while not rosgraph.is_master_online():
            assert time.monotonic() < deadline, 'no master'
            time.sleep(0.1)

    def end(self):
        self._process.kill()
        self._process.wait()

    def restart(self):
        self.end()
        time.sleep(1.0)
        self.start()


def wait_until_up(nodes):
    deadline = time.monotonic() + 4 * SECONDS
    while not all(node.publisher.get_num_connections() for node in nodes):
        assert time.monotonic() < deadline, 'the nodes do not come up'
        assert all(node.process.poll() is None for node in nodes), 'a node has ended'
        time.sleep(0.1)


def good_frames(node, count=100):
    """So many VGA frames, each answered."""
    for _ in range(count):
        node.send(GOOD, 'png')
        time.sleep(0.02)


def soak(seconds, folder):
    """The whole run; returns the failures, and prints the table."""
    master, counts, failures, nodes = Master(folder), Counter(), [], []
    try:
        rospy.init_node('soak', disable_signals=True, disable_rosout=True)
        watch = GraphWatch()
        watch.start()
        nodes = [Node('raw_node', 'raw', folder), Node('compressed_node', 'compressed', folder)]

        def diagnose(message):
            for status in message.status:
                for node in nodes:
                    if status.name.startswith(node.name):
                        node.report(status)

        rospy.Subscriber('/diagnostics', DiagnosticArray, diagnose, queue_size=100)
        wait_until_up(nodes)
        expected = detectors.create('harris').detect_arrays(GOOD)
        defaults = {node.name: set_parameters(node, Config()).config for node in nodes}
        for node in nodes:
            good_frames(node)
            node.before = node.state()
        worst = {node.name: dict(node.before) for node in nodes}
        faults, dice = Faults(nodes, master, counts), random.Random(1)
        begin = time.monotonic()
        while time.monotonic() - begin < seconds and not failures:
            stop = threading.Event()
            threads = [threading.Thread(target=kind, args=(node, random.Random(dice.random()), stop, counts))
                       for node in nodes for kind in (camera, parameter_storm, come_and_go, rude_connections)]
            for thread in threads:
                thread.start()
            end = time.monotonic() + ROUND
            while time.monotonic() < end:
                time.sleep(0.5)
                for node in nodes:
                    for name, value in node.state().items():
                        worst[node.name][name] = max(worst[node.name][name], value)
            stop.set()
            for thread in threads:
                thread.join(SECONDS)
                if thread.is_alive():
                    failures.append(f'{thread} hangs')
            faults.next()
            for node in nodes:
                if node.process.poll() is not None:
                    failures.append(f'{node.name} has ended with status {node.process.returncode}')
                    continue
                set_parameters(node, defaults[node.name])
                counts['good frames compared'] += 1
                if not node.right_answer(expected):
                    failures.append(f'{node.name}: no right answer after {time.monotonic() - begin:.0f} s')
        minutes = (time.monotonic() - begin) / 60
        after = {}
        for node in nodes:
            if node.process.poll() is None:
                good_frames(node)
                after[node.name] = node.state()
                failures += judge(node, after[node.name], minutes)
        watch.stop()
        print_table(nodes, after, worst, counts, minutes)
    finally:
        for node in nodes:
            node.end()
        rospy.signal_shutdown('done')
        master.end()
        reporter().catch_up()
    return failures


def judge(node, after, minutes):
    """What did not hold."""
    if after['memory'] - node.before['memory'] > LARGEST_GROWTH:
        yield f'{node.name}: {(after["memory"] - node.before["memory"]) / 1e6:.0f} MB more than in the beginning'
    for name, most in (('threads', MORE_THREADS), ('descriptors', MORE_DESCRIPTORS)):
        if after[name] - node.before[name] > most:
            yield f'{node.name}: {after[name] - node.before[name]} {name} more than in the beginning'
    text = node.errors.read_text(errors='replace')
    if 'Traceback' in text:
        yield f'{node.name}: a traceback: {text[text.index("Traceback"):][:1500]}'
    if len(text) > LOG_BYTES * max(minutes, 1):
        yield f'{node.name}: {len(text)} bytes of log in {minutes:.1f} minutes'


def print_table(nodes, after, worst, counts, minutes):
    print(f'\n{minutes:.1f} minutes; faults injected and survived:')
    for name, count in counts.items():
        print(f'  {count:>9,}  {name}')
    for node in nodes:
        values, ages = node.values, sorted(node.ages) or [0.0]
        print(f'\n{node.name}')
        sent, good = sum(node.sent.values()), node.sent['good'] + node.sent['png']
        print(f'  sent: {sent:,} messages, {sent - good:,} of them damaged')
        for name in ('frames received', 'frames processed', 'frames dropped for newer ones', 'frames rejected',
                     'parameter values rejected'):
            print(f'  {name}: {int(values.get(name, 0)):,}')
        for cause in values.get('rejected because', '').split('; '):
            print(f'    {cause}')
        for name, unit in (('memory', 1e6), ('threads', 1), ('descriptors', 1)):
            ends = after.get(node.name, {}).get(name, 0)
            print(f'  {name}{" in MB" if unit > 1 else ""}: {node.before[name] / unit:.0f} before, '
                  f'{worst[node.name][name] / unit:.0f} at most, {ends / unit:.0f} after')
        print(f'  age of output in ms: median {1000 * statistics.median(ages):.0f}, 99 in 100 below '
              f'{1000 * ages[int(0.99 * (len(ages) - 1))]:.0f}, worst {1000 * ages[-1]:.0f}')
        print(f'  log: {node.errors.stat().st_size:,} bytes on the terminal')
        for text, count in node.messages.most_common(8):
            print(f'    {count:>5} reports said: {text[:110]}')


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--minutes', type=float, default=10.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        failures = soak(60 * arguments.minutes, Path(folder))
    for failure in failures:
        print(f'FAILED: {failure}')
    print('all held' if not failures else f'{len(failures)} failed')
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
