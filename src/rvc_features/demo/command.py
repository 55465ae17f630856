"""The main job on real frames: plays a bag into the node, turns parameters meanwhile, and keeps what comes out.

    rosrun rvc_features demo [--output FOLDER] [--bag FILE [--topic NAME]] [--view]

Leaves in the output folder: the bags that were played (where it made them), output.bag with what the node published,
annotated.avi, and contact_sheet.png with a frame for each setting. Everything runs under a master of its own.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Sequence

import cv2
import numpy as np
import rosbag
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool

from rvc_features.demo.private_master import private_master
from rvc_features.image_transport import ImageTransport, TransportHints
from rvc_features.image_transport.messages import to_array
from rvc_features.msg import KeyPoints
from rvc_features.recordings.bags import BagImages
from rvc_features.recordings.image_sources import ImageFiles, SourceError, Video
from rvc_features.recordings.make_bag import make_bag

# What is shown, in order; each setting starts from the node's defaults.
SETTINGS: tuple[tuple[str, dict[str, Any]], ...] = (
    ('threshold 0.01', {}),
    ('threshold 0.1', {'threshold': 0.1}),
    ('strongest 150', {'fixed_number_of_points': True, 'number_of_points': 150}),
    ('ANMS 150', {'ANMS': True, 'ANMS_points': 150}),
    ('ANMS 150, window 15', {'ANMS': True, 'ANMS_points': 150, 'window_size': 15}),
    ('ANMS 150, 4 octaves', {'ANMS': True, 'ANMS_points': 150, 'octaves': 4}),
)

_EXAMPLES = Path('/usr/share/doc/opencv-doc/examples/data')   # of the Debian package opencv-doc
_STREET_FRAMES = 60
_NODE = '/feature_detector'
_PATIENCE = 30.0   # seconds for anything that should happen at once
_GRACE = 2.0       # seconds for the last frame to come out


class DemoError(RuntimeError):
    """The demo can't go on; the text says why."""


@dataclass
class Scene:
    """A bag to play and how many images it has."""

    name: str
    bag: Path
    frames: int


@dataclass
class Phase:
    """What one setting gave on one scene."""

    scene: str
    setting: str
    changes: dict[str, Any]
    frames: int   # its share of the scene's
    frames_in: int = 0
    frames_out: int = 0
    points: list[int] = field(default_factory=list)
    milliseconds: list[float] = field(default_factory=list)
    picture: np.ndarray | None = None


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    output = Path(options.output)
    try:
        output.mkdir(parents=True, exist_ok=True)
        scenes, topic = _own_bag(options.bag, options.topic) if options.bag else _real_frames(output)
        phases = play(scenes, topic, output, options.view)
    except (SourceError, DemoError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 2
    cv2.imwrite(str(output / 'contact_sheet.png'), contact_sheet(phases))
    table = summary(phases)
    (output / 'summary.txt').write_text(table + '\n')
    print(f'\n{table}\n\nIn {output}: contact_sheet.png, annotated.avi, output.bag, summary.txt')
    return 0


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
    phases = [phase for scene in scenes for phase in _phases_of(scene)]
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


def contact_sheet(phases: list[Phase], columns: int = 3, width: int = 480) -> np.ndarray:
    """The last picture of each phase, with a caption, in rows."""
    tiles = [_captioned(phase, width) for phase in phases]
    rows = []
    for start in range(0, len(tiles), columns):
        row = tiles[start:start + columns]
        height = max(tile.shape[0] for tile in row)
        row += [np.zeros((1, width, 3), np.uint8)] * (columns - len(row))
        rows.append(np.hstack([cv2.copyMakeBorder(tile, 4, height - tile.shape[0] + 4, 4, 4, cv2.BORDER_CONSTANT)
                               for tile in row]))
    return np.vstack(rows)


def summary(phases: list[Phase]) -> str:
    """A table of what went in and came out."""
    lines = [f'{"scene":<12} {"setting":<22} {"frames in":>9} {"out":>5} {"points":>8} {"ms":>7}']
    for phase in phases:
        points = f'{np.median(phase.points):.0f}' if phase.points else '-'
        milliseconds = f'{np.median(phase.milliseconds):.1f}' if phase.milliseconds else '-'
        lines.append(f'{phase.scene:<12} {phase.setting:<22} {phase.frames_in:>9} {phase.frames_out:>5} '
                     f'{points:>8} {milliseconds:>7}')
    lines.append('points: median per frame; ms: median from image to annotated image, as another node sees it')
    return '\n'.join(lines)


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


def _phases_of(scene: Scene) -> list[Phase]:
    """Every setting, with equal shares of the scene's frames."""
    ends = [scene.frames * (index + 1) // len(SETTINGS) for index in range(len(SETTINGS))]
    return [Phase(scene.name, name, changes, end - begin)
            for (name, changes), begin, end in zip(SETTINGS, [0, *ends], ends) if end > begin]


def _real_frames(output: Path) -> tuple[list[Scene], str]:
    """Two bags of real frames: a chessboard held by hand, and a street seen by a fixed camera."""
    chessboard, street = sorted(_EXAMPLES.glob('left[0-9][0-9].jpg')), _EXAMPLES / 'vtest.avi'
    if not chessboard or not street.is_file():
        raise DemoError(f'no frames in {_EXAMPLES}: install the package opencv-doc, or name a bag with --bag')
    start, topic = time.time(), '/camera/image_raw'
    scenes = [Scene('chessboard', output / 'chessboard.bag', 0), Scene('street', output / 'street.bag', 0)]
    scenes[0].frames = make_bag(scenes[0].bag, ImageFiles(chessboard), 2.0, topic, start=start)
    scenes[1].frames = make_bag(scenes[1].bag, Video(street, _STREET_FRAMES), 10.0, topic,
                                start=start + scenes[0].frames / 2.0)
    return scenes, topic


def _own_bag(bag: str, topic: str | None) -> tuple[list[Scene], str]:
    images = BagImages(bag, topic)
    return [Scene(Path(bag).stem[:12], Path(bag), len(images))], images.topic


def _captioned(phase: Phase, width: int) -> np.ndarray:
    picture = np.zeros((width * 3 // 4, width, 3), np.uint8) if phase.picture is None else phase.picture
    picture = cv2.resize(picture, (width, picture.shape[0] * width // picture.shape[1]), interpolation=cv2.INTER_AREA)
    count = f'{phase.points[-1]} points' if phase.points else 'no image'
    caption = np.full((30, width, 3), 40, np.uint8)
    cv2.putText(caption, f'{phase.setting}: {count}', (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 1,
                cv2.LINE_AA)
    return np.vstack((caption, picture))


def _end(process: subprocess.Popen) -> None:
    """End a process that leads a session, and all it started."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='demo', description='Key points on real frames.')
    parser.add_argument('--output', default='demo_output', metavar='FOLDER', help='default: %(default)s')
    parser.add_argument('--bag', metavar='FILE', help='a bag of your own')
    parser.add_argument('--topic', metavar='NAME', help='its image topic; not needed where there is only one')
    parser.add_argument('--view', action='store_true', help='show the images in a window meanwhile')
    return parser
