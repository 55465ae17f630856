"""Plays bags through the node, turns its parameters meanwhile, and records what comes out."""

from __future__ import annotations

import contextlib
import subprocess
import threading
import time
from pathlib import Path
from typing import Any, Callable

import genpy
import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from rvc_features import key_points as kp
from rvc_features.demo.launch import launched
from rvc_features.demo.private_master import private_master
from rvc_features.demo.recorder import Recorder, recorder
from rvc_features.demo.scenes import DemoError, Phase, Scene, phases_of
from rvc_features.image_transport import ImageTransport, TransportHints
from rvc_features.image_transport.messages import to_array
from rvc_features.msg import KeyPoints

_NODE = '/feature_detector'
_PATIENCE = 30.0   # seconds for anything that should happen at once
_START_PATIENCE = 240.0   # for the node's start: where the build had no Numba, it compiles the kernels first
_GRACE = 2.0       # seconds for the last frame to come out
_SHOWS = 7         # times that a frame is sent for the sheet; the first is not timed
_SHOWN = 'shown by the demo'   # frame_id of such a frame, by which it is known again


def play(scenes: list[Scene], topic: str, output: Path, view: bool = False) -> tuple[list[Phase], str]:
    """Show the node one frame of each scene under every setting, then play the scenes, and record what comes out.

    Returns
    -------
    list of Phase
        What came of each setting on each scene.
    str
        What the node runs on.

    Raises
    ------
    DemoError
        When nothing comes in or out.
    """
    base_topic, transport = topic, 'raw'
    if topic.endswith('/compressed'):
        base_topic, transport = topic.rsplit('/', 1)[0], 'compressed'
    phases = [phase for scene in scenes for phase in phases_of(scene)]
    with private_master('demo'), \
            launched([scene.bag for scene in scenes], base_topic, transport, view, output / 'launch.log') as launch:
        _wait_for_node(launch, output / 'launch.log')
        with recorder(output, _NODE) as recording:
            session = _Session(base_topic, transport, recording, launch)
            session.show(phases)
            session.play(phases)
            session.close()
    return phases, session.running_on


class _Session:
    """Listens to what goes in and comes out, and turns the parameters."""

    def __init__(self, base_topic: str, transport: str, recording: Recorder, launch: subprocess.Popen) -> None:
        self._recording = recording
        self._launch = launch
        self._pause = rospy.ServiceProxy('/player/pause_playback', SetBool)
        self._base_topic = base_topic
        self._transport = transport
        self._changed = threading.Condition()
        self._playing: Phase | None = None       # the phase in force, of what is played
        self._total_in = 0
        self._on_their_way = 0                   # frames that went in and have not come out yet
        self._newest_in = self._newest_out = None
        self._over = False
        self._shown_pictures: dict[genpy.Time, float] = {}    # when they came
        self._shown_points: dict[genpy.Time, np.ndarray] = {}

        self._client = Client(_NODE, timeout=_PATIENCE)
        self._defaults = dict(self._client.get_configuration(timeout=_PATIENCE) or {})
        self._defaults.pop('groups', None)
        self._subscribers = [
            rospy.Subscriber(f'{_NODE}/key_points', KeyPoints, self._key_points_came_out, queue_size=100),
            ImageTransport().subscribe(f'{_NODE}/image', self._image_came_out, queue_size=100)]
        self.running_on = _wait_until_the_node_listens()
        threading.Thread(target=self._watch, daemon=True).start()

    def show(self, phases: list[Phase]) -> None:
        """Send the frame of each scene that is shown, under every setting."""
        camera = ImageTransport().advertise(self._base_topic, transports=[self._transport])
        deadline = time.monotonic() + _PATIENCE
        number = 0
        try:
            for phase in phases:
                self._configure(phase)
                answers = 0
                while answers < _SHOWS:
                    number += 1
                    stamp = genpy.Time(number)
                    sent = time.perf_counter()
                    camera.publish_array(phase.scene.shown, 'bgr8', Header(stamp=stamp, frame_id=_SHOWN))
                    with self._changed:
                        if self._changed.wait_for(
                                lambda: stamp in self._shown_pictures and stamp in self._shown_points, 1):  # noqa: B023
                            phase.shown_points = self._shown_points[stamp]
                            if answers > 0:
                                phase.milliseconds.append(1000 * (self._shown_pictures[stamp] - sent))
                            answers += 1
                            deadline = time.monotonic() + _PATIENCE
                    if time.monotonic() > deadline:
                        raise DemoError(f'the node does not answer to an image on {self._base_topic}')
        finally:
            camera.shutdown()

    def play(self, phases: list[Phase]) -> None:
        """Play the bags, and start each phase when the one before has had its frames."""
        image_in = ImageTransport().subscribe(
            self._base_topic, self._image_came_in, queue_size=100, decode=False,
            transport_hints=TransportHints(self._transport, parameter_name='demo_transport'))
        self._subscribers.append(image_in)
        threading.Thread(target=self._hold_back, daemon=True).start()
        ends = np.cumsum([phase.frames for phase in phases]).tolist()
        for number, (phase, end) in enumerate(zip(phases, ends)):
            self._configure(phase)
            with self._changed:
                self._playing = phase
            if number == 0:
                self._pause(False)
            with self._changed:
                self._wait_until(lambda: self._total_in >= end)   # noqa: B023, used in this round only
                last = self._newest_in
                self._changed.wait_for(
                    lambda: self._newest_out == last or self._newest_in != last, _GRACE)   # noqa: B023
        if not any(phase.frames_out for phase in phases):
            raise DemoError('the node published nothing')

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister() if isinstance(subscriber, rospy.Subscriber) else subscriber.shutdown()

    def _configure(self, phase: Phase) -> None:
        self._client.update_configuration({**self._defaults, **phase.changes})

    def _hold_back(self) -> None:
        """Let the player wait while two frames are on their way: of three, a node that is slow just then drops one."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._over or self._on_their_way >= 2)
                if self._over:
                    return
            with contextlib.suppress(rospy.ServiceException):   # it has played everything, and is gone
                self._pause(True)
                with self._changed:
                    self._changed.wait_for(lambda: self._over or self._on_their_way == 0, _GRACE)
                    self._on_their_way = 0   # what has not come by now does not come at all
                self._pause(False)

    def _watch(self) -> None:
        self._launch.wait()
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def _image_came_in(self, message: Any) -> None:
        with self._changed:
            if message.header.frame_id == _SHOWN or self._playing is None:
                return
            self._playing.frames_in += 1
            self._total_in += 1
            self._on_their_way += 1
            self._newest_in = message.header.stamp
            self._changed.notify_all()

    def _key_points_came_out(self, message: KeyPoints) -> None:
        with self._changed:
            if message.header.frame_id == _SHOWN:
                points = kp.empty(len(message.x))
                for name in kp.NAMES:
                    points[name] = getattr(message, name)
                self._shown_points[message.header.stamp] = points
                self._changed.notify_all()
            elif self._playing is not None:
                self._playing.points.append(len(message.x))
                self._recording.key_points(message)

    def _image_came_out(self, message: Image) -> None:
        came = time.perf_counter()
        with self._changed:
            if message.header.frame_id == _SHOWN:
                self._shown_pictures[message.header.stamp] = came
            elif self._playing is not None:
                self._playing.frames_out += 1
                self._newest_out = message.header.stamp
                self._on_their_way = max(self._on_their_way - 1, 0)
                self._recording.picture(message, to_array(message, 'bgr8'))
            self._changed.notify_all()

    def _wait_until(self, reached: Callable[[], bool]) -> None:
        """Until `reached` or the player has ended; DemoError when nothing moves."""
        while not reached() and not self._over:
            before = self._total_in
            if not self._changed.wait(_PATIENCE) and self._total_in == before:
                raise DemoError(f'no image on {self._base_topic} for {_PATIENCE:.0f} s')


def _wait_for_node(launch: subprocess.Popen, log: Path) -> None:
    deadline = time.monotonic() + _START_PATIENCE
    while True:
        try:
            return rospy.wait_for_service(f'{_NODE}/set_parameters', 1.0)
        except rospy.ROSException:
            if launch.poll() is not None:
                raise DemoError(f'roslaunch has ended; see {log}') from None
            if time.monotonic() > deadline:
                raise DemoError(f'the node has not started in {_START_PATIENCE:.0f} s; see {log}') from None


def _wait_until_the_node_listens() -> str:
    """Until the node reports that it is connected to the player; what it runs on."""
    connected = threading.Event()
    running_on = ''

    def look(message: DiagnosticArray) -> None:
        nonlocal running_on
        values = {pair.key: pair.value for status in message.status for pair in status.values}
        if int(values.get('publishers connected', 0)) > 0:
            running_on = values['running on']
            connected.set()

    subscriber = rospy.Subscriber('/diagnostics', DiagnosticArray, look)
    if not connected.wait(_PATIENCE):
        raise DemoError('the node does not listen to the player')
    subscriber.unregister()
    return running_on
