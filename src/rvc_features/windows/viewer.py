"""Shows an image topic in a window of whatever viewer is installed.

    rosrun rvc_features view image:=/feature_detector/image

Looked for in this order: rviz (with the configuration that comes with the package), image_view, rqt_image_view. None
of them is needed by a robot without a screen, so the package does not depend on them; where none is there, this says
what to install.
"""

from __future__ import annotations

import argparse
import os
import sys
from typing import Callable

import rospkg
import rospy
from rosgraph.names import make_caller_id, resolve_name
from roslib.packages import ROSPkgException, find_node

# How each is started for the topic given.
_VIEWERS: dict[tuple[str, str], Callable[[str], list[str]]] = {
    ('rviz', 'rviz'): lambda topic: ['-d', _configuration(), f'image:={topic}'],
    ('image_view', 'image_view'): lambda topic: [f'image:={topic}', '_autosize:=true'],
    ('rqt_image_view', 'rqt_image_view'): lambda topic: [topic],
}
_ADVICE = ('no viewer is installed. Install one of rviz, image_view and rqt_image_view: on Debian 12 and 13 with '
           '"apt install rviz" or "apt install ros-image-view libimage-view-dev libnodeletlib-tools", with ROS Noetic '
           'as ros-noetic-rviz, ros-noetic-image-view or ros-noetic-rqt-image-view')


def command(topic: str, find: Callable[[str, str], list[str]]) -> list[str]:
    """The command line of the first viewer that `find` (package, executable) finds; empty where there is none."""
    for (package, executable), arguments in _VIEWERS.items():
        found = find(package, executable)
        if found:
            return [found[0], *arguments(topic)]
    return []


def _configuration() -> str:
    return os.path.join(rospkg.RosPack().get_path('rvc_features'), 'config', 'view.rviz')


def _find(package: str, executable: str) -> list[str]:
    try:
        return find_node(package, executable)
    except (ROSPkgException, rospkg.ResourceNotFound):
        return []


def main() -> int:
    """Become the viewer; the exit status where there is none."""
    parser = argparse.ArgumentParser(prog='view', usage='rosrun rvc_features view image:=TOPIC', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args(rospy.myargv()[1:])
    topic = rospy.names.load_mappings(sys.argv).get('image', '')
    if not topic:
        parser.error('which topic? such as image:=/feature_detector/image')
    viewer = command(resolve_name(topic, make_caller_id('view')), _find)
    if not viewer:
        print(f'view: {_ADVICE}', file=sys.stderr)
        return 1
    given = [argument for argument in sys.argv[1:] if argument.startswith('__')]   # name and log, from roslaunch
    os.execv(viewer[0], [*viewer, *given])
