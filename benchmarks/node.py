"""The node against C++ nodes of opencv_apps: round trips of images, and how old its output is when it can't keep up.

Each node gets the same image and answers with the annotated one; they take turns, and a client on bare sockets looks at
the clock on the wall. The nodes run as a user starts them: on any core, with as many threads as they like, and with the
heap as they find it.
"""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Iterator

import numpy as np

from benchmarks import images
from benchmarks.harness import SIZES, WARM_HEAP, Report

_PEERS = ('corner_harris', 'goodfeature_track')
_OURS = {'default': ('_fixed_number_of_points:=true',),
         'course': ('_preset:=course', '_fixed_number_of_points:=true')}   # names, and how the node is started
_REACH = {('VGA', 'corner_harris'): 0.60, ('1080p', 'corner_harris'): 0.20,
          ('VGA', 'goodfeature_track'): 0.45, ('1080p', 'goodfeature_track'): 0.18}
_REACH_PROCESSOR = {'VGA': 0.6, '1080p': 0.3}
_REACH_ALONE = {'VGA': 0.4, '1080p': 0.2}
_WARM_UP = 10      # round trips that do not count
_SLOW = 0.1        # seconds that benchmarks.slow_detector takes for an image
_SECONDS = 30.0    # to wait for anything at the most


def run(quick: bool) -> Report:
    report = Report('node', 'Round trip through the node: image in, annotated image out', 'opencv_apps')
    try:
        from rvc_features.demo.private_master import private_master
    except ImportError as error:
        report.notes.append(f'Not run: {error} (it needs ROS; use ./run bench)')
        return report
    peers = [peer for peer in _PEERS if Path(f'/usr/lib/opencv_apps/{peer}').is_file()]
    if len(peers) < len(_PEERS):
        report.notes.append('Without its peers: install ros-opencv-apps, libopencv-apps-dev and libnodeletlib-tools')
    os.sched_setaffinity(0, range(os.cpu_count() or 1))   # the nodes inherit it
    with private_master('benchmark_node') as master:
        _round_trips(report, master, peers, 40 if quick else 150)
        _processor_time(report, master, peers, 30 if quick else 100)
        _age_of_output(report, 3.0 if quick else 10.0)
    return report


def _round_trips(report: Report, master: str, peers: list[str], rounds: int) -> None:
    from benchmarks.raw_ros import ImagePeer, packed, stamp_of
    from rvc_features.image_transport.messages import to_image_message
    with ExitStack() as stack:
        clients = {}
        for ours, options in _OURS.items():
            stack.enter_context(_started('rvc_features', 'feature_detector', ours, *options))
            clients[ours] = stack.enter_context(ImagePeer(master, f'/to_{ours}', f'/{ours}/in', f'/{ours}/out'))
        for peer in peers:
            stack.enter_context(_started('opencv_apps', peer, peer, '_debug_view:=false', '_use_camera_info:=false'))
        for peer in peers:
            clients[peer] = stack.enter_context(ImagePeer(master, f'/to_{peer}', f'/{peer}/in', f'/{peer}/image'))
        for size in ('VGA', '1080p'):
            image = to_image_message(np.dstack([images.picture(SIZES[size])] * 3), 'bgr8')
            times: dict[str, list[float]] = {name: [] for name in clients}
            for number in range(1, rounds + _WARM_UP + 1):
                packet = packed(image, number)
                for name, client in clients.items():
                    start = time.perf_counter()
                    answer = client.round_trip(packet)
                    times[name].append(time.perf_counter() - start)
                    if stamp_of(answer) != number:
                        raise RuntimeError(f'{name} answered image {number} with one of stamp {stamp_of(answer)}')
            times = {name: values[_WARM_UP:] for name, values in times.items()}
            for ours in _OURS:
                for peer in peers:
                    report.compare(f'{size} bgr8, 500 points, {ours}', times, ours, peer, _REACH[size, peer])
                if not peers:
                    report.notes.append(f'{size}, {ours}: {1000 * np.median(times[ours]):.2f} ms')


def _processor_time(report: Report, master: str, peers: list[str], frames: int) -> None:
    """User and system time of the whole process for each frame, at ten a second; ours also with key points alone."""
    from rvc_features.msg import KeyPoints

    from benchmarks.raw_ros import ImagePeer, packed
    from rvc_features.image_transport.messages import to_image_message
    with ExitStack() as stack:
        processes, clients = {}, {}

        def enter(name: str, package: str, executable: str, options: tuple[str, ...], *answer: Any) -> None:
            node = 'cpu_' + name.replace(', ', '_').replace(' ', '_')
            topic, *kind = answer
            processes[name] = stack.enter_context(_started(package, executable, node, *options,
                                                           f'key_points:=/{node}/key_points'))
            clients[name] = stack.enter_context(
                ImagePeer(master, f'/to_{node}', f'/{node}/in', f'/{node}{topic}', *kind))

        for ours, options in _OURS.items():
            enter(ours, 'rvc_features', 'feature_detector', options, '/out')
            enter(f'{ours}, key points alone', 'rvc_features', 'feature_detector', options, '/key_points', KeyPoints)
        for peer in peers:
            enter(peer, 'opencv_apps', peer, ('_debug_view:=false', '_use_camera_info:=false'), '/image')
        for size in ('VGA', '1080p'):
            packet = packed(to_image_message(np.dstack([images.picture(SIZES[size])] * 3), 'bgr8'), 1)
            busy: dict[str, list[float]] = {name: [] for name in clients}
            for _ in range(frames + _WARM_UP):
                begin = time.monotonic()
                for client in clients.values():
                    client.round_trip(packet)
                time.sleep(max(0.0, begin + 0.1 - time.monotonic()))   # what they do after the answer counts, too
                for name in clients:
                    busy[name].append(_busy(processes[name]))
            times = {name: np.diff(values[_WARM_UP - 1:]).tolist() for name, values in busy.items()}
            for ours in (name for name in clients if name not in peers):
                reach = _REACH_ALONE[size] if ours.endswith('alone') else _REACH_PROCESSOR[size]
                for peer in peers:
                    report.compare(f'{size} processor time a frame, {ours}', times, ours, peer,
                                   reach if peer == 'corner_harris' else None)


def _busy(process: subprocess.Popen) -> float:
    """Seconds of user and system time that a process has had, to the nanosecond where the kernel says so."""
    total = 0
    for thread in Path(f'/proc/{process.pid}/task').iterdir():
        total += int((thread / 'schedstat').read_text().split()[0])
    return total / 1e9


def _age_of_output(report: Report, seconds: float) -> None:
    """30 images a second into a detector that takes 100 ms, from a camera with a queue of 100."""
    import rospy
    from sensor_msgs.msg import Image

    from rvc_features.image_transport.messages import to_image_message
    ages: list[float] = []
    connected = threading.Event()

    def came_out(message: Image) -> None:
        ages.append((rospy.Time.now() - message.header.stamp).to_sec())

    class Listener(rospy.SubscribeListener):
        def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
            connected.set()

    with _started('rvc_features', 'feature_detector', 'slow', '_detector_modules:=[benchmarks.slow_detector]',
                  '_detector:=slow'):
        camera = rospy.Publisher('/slow/in', Image, Listener(), queue_size=100)
        annotated = rospy.Subscriber('/slow/out', Image, came_out, queue_size=100)
        if not connected.wait(_SECONDS):
            raise TimeoutError('the node does not listen')
        image = to_image_message(np.dstack([images.picture(SIZES['VGA'])] * 3), 'bgr8')
        end, rate = time.monotonic() + seconds, rospy.Rate(30)
        while time.monotonic() < end:
            image.header.stamp = rospy.Time.now()
            camera.publish(image)
            rate.sleep()
        annotated.unregister()
        camera.unregister()
    half = len(ages) // 2
    report.notes.append(
        f'Age of the output, 30 images a second, {1000 * _SLOW:.0f} ms for each: median {np.median(ages):.3f} s, '
        f'{np.median(ages) / _SLOW:.2f} times the processing (reach: 1.5); '
        f'first half {np.median(ages[:half]):.3f} s, second half {np.median(ages[half:]):.3f} s')


@contextmanager
def _started(package: str, executable: str, name: str, *parameters: str) -> Iterator[subprocess.Popen]:
    """A node under the private master, on any core and with the heap that a user has."""
    environment = {variable: value for variable, value in os.environ.items() if variable not in WARM_HEAP}
    environment['PYTHONPATH'] = os.pathsep.join((os.getcwd(), environment.get('PYTHONPATH', '')))
    command = ['rosrun', package, executable, f'__name:={name}', f'in:=/{name}/in', f'image:=/{name}/'
               + ('out' if package == 'rvc_features' else 'in'), *parameters]
    process = subprocess.Popen(command, env=environment, start_new_session=True, stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
