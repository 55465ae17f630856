"""Plays bags through the node, turns its parameters meanwhile, and records what comes out."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable

import cv2
import numpy as np
import rosbag
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool

from rvc_features.demo.private_master import private_master
from rvc_features.demo.scenes import DemoError, Phase, Scene, phases_of
from rvc_features.image_transport import ImageTransport, TransportHints
from rvc_features.image_transport.messages import to_array
from rvc_features.msg import KeyPoints

_NODE = '/feature_detector'
_PATIENCE = 30.0   # seconds for anything that should happen at once
_GRACE = 2.0       # seconds for the last frame to come out


def play(scenes: list[Scene], topic: str, output: Path, view: bool = False) -> list[Phase]:
    """Play the scenes through the node, one setting after the other, and record what comes out.

    Raises
    ------
    DemoError
        When nothing comes in or out.
    """
    base_topic, transport = topic, 'raw'
    if topic.endswith('/compressed'):
        base_topic, transport = topic.rsplit('/', 1)[0], 'compressed'
    phases = [phase for scene in scenes for phase in phases_of(scene)]
    with private_master('demo'), open(output / 'launch.log', 'w', encoding='utf-8') as log:
        launch = subprocess.Popen(
            ['roslaunch', '--wait', 'rvc_features', 'demo.launch', f'in:={base_topic}',
             f'image_transport:={transport}', f'view:={str(view).lower()}', 'paused:=true',
             'bags:=' + ' '.join(str(scene.bag.resolve()) for scene in scenes)],
            stdout=log, stderr=log, start_new_session=True)
        try:
            _wait_for_node(launch, log.name)
            with Recorder(output) as recorder:
                _listen_and_turn(phases, base_topic, transport, recorder, launch)
        finally:
            _end(launch)
    return phases


class Recorder:
    """Writes what the node publishes: a bag of it, and a video of the pictures."""

    def __init__(self, output: Path) -> None:
        self._bag = rosbag.Bag(str(output / 'output.bag'), 'w')
        self._video_path = str(output / 'annotated.avi')
        self._video: cv2.VideoWriter | None = None
        self._size = (0, 0)

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *error: object) -> None:
        self._bag.close()
        if self._video is not None:
            self._video.release()

    def key_points(self, message: KeyPoints) -> None:
        self._bag.write(f'{_NODE}/key_points', message, message.header.stamp)

    def picture(self, message: Image, picture: np.ndarray) -> None:
        self._bag.write(f'{_NODE}/image', message, message.header.stamp)
        if self._video is None:
            self._size = (picture.shape[1], picture.shape[0])
            self._video = cv2.VideoWriter(self._video_path, cv2.VideoWriter.fourcc(*'MJPG'), 10, self._size)
        self._video.write(cv2.resize(picture, self._size))


def _listen_and_turn(phases: list[Phase], base_topic: str, transport: str, recorder: Recorder,
                     launch: subprocess.Popen) -> None:
    """Subscribe to what goes in and comes out, and start each phase when the one before has had its frames."""
    # The phase in force, and what the node has made of the newest frame.
    now = SimpleNamespace(phase=phases[0], total_in=0, newest_in=None, newest_out=None, arrivals={},
                          over=False, closed=False)
    changed = threading.Condition()

    def watch() -> None:
        launch.wait()
        with changed:
            now.over = True
            changed.notify()

    def image_came_in(message: Any) -> None:
        with changed:
            now.phase.frames_in += 1
            now.total_in += 1
            now.newest_in = message.header.stamp
            now.arrivals[message.header.stamp] = time.perf_counter()
            changed.notify()

    def key_points_came_out(message: KeyPoints) -> None:
        with changed:
            if now.closed:
                return
            now.phase.points.append(len(message.x))
            recorder.key_points(message)

    def image_came_out(message: Image) -> None:
        with changed:
            if now.closed:
                return
            stamp = message.header.stamp
            if stamp in now.arrivals:
                now.phase.milliseconds.append(1000 * (time.perf_counter() - now.arrivals[stamp]))
            now.phase.frames_out += 1
            now.phase.picture = to_array(message, 'bgr8', writable=True)
            now.newest_out = stamp
            recorder.picture(message, now.phase.picture)
            changed.notify()

    def wait_until(reached: Callable[[], bool]) -> None:
        """Until `reached` or the player has ended; DemoError when nothing moves."""
        while not reached() and not now.over:
            before = now.total_in
            if not changed.wait(_PATIENCE) and now.total_in == before:
                raise DemoError(f'no image on {base_topic} for {_PATIENCE:.0f} s')

    client = Client(_NODE, timeout=_PATIENCE)
    defaults = dict(client.get_configuration(timeout=_PATIENCE) or {})
    defaults.pop('groups', None)
    key_points = rospy.Subscriber(f'{_NODE}/key_points', KeyPoints, key_points_came_out, queue_size=100)
    image_out = ImageTransport().subscribe(f'{_NODE}/image', image_came_out, queue_size=100)
    image_in = ImageTransport().subscribe(
        base_topic, image_came_in, queue_size=100, decode=False,
        transport_hints=TransportHints(transport, parameter_name='demo_transport'))
    _wait_until_the_node_listens()
    threading.Thread(target=watch, daemon=True).start()
    for phase, end in zip(phases, np.cumsum([phase.frames for phase in phases])):
        client.update_configuration({**defaults, **phase.changes})
        with changed:
            now.phase = phase
        if phase is phases[0]:
            rospy.ServiceProxy('/player/pause_playback', SetBool)(False)
        with changed:
            wait_until(lambda: now.total_in >= end)   # noqa: B023, used in this round only
            last = now.newest_in
            changed.wait_for(lambda: now.newest_out == last or now.newest_in != last, _GRACE)   # noqa: B023
    image_in.shutdown()
    image_out.shutdown()
    key_points.unregister()
    with changed:   # what rospy has in hand still comes
        now.closed = True
    if not any(phase.frames_out for phase in phases):
        raise DemoError('the node published nothing')


def _wait_for_node(launch: subprocess.Popen, log: str) -> None:
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            return rospy.wait_for_service(f'{_NODE}/set_parameters', 1.0)
        except rospy.ROSException:
            if launch.poll() is not None:
                raise DemoError(f'roslaunch has ended; see {log}') from None
            if time.monotonic() > deadline:
                raise DemoError(f'the node has not started in {_PATIENCE:.0f} s; see {log}') from None


def _wait_until_the_node_listens() -> None:
    """Until the node reports that it is connected to the player."""
    connected = threading.Event()

    def look(message: DiagnosticArray) -> None:
        values = {pair.key: pair.value for status in message.status for pair in status.values}
        if int(values.get('publishers connected', 0)) > 0:
            connected.set()

    subscriber = rospy.Subscriber('/diagnostics', DiagnosticArray, look)
    if not connected.wait(_PATIENCE):
        raise DemoError('the node does not listen to the player')
    subscriber.unregister()


def _end(process: subprocess.Popen) -> None:
    """End a process that leads a session, and all it started."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
