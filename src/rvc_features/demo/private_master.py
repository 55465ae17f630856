"""A ROS master for one run only, on a free port of the loopback: runs side by side never meet."""

from __future__ import annotations

import os
import uuid
from contextlib import contextmanager
from typing import Iterator

import rosmaster.master
import rospy


@contextmanager
def private_master(node_name: str) -> Iterator[str]:
    """Start a master in this process, make this process a node of it, and end both.

    Processes started meanwhile find the master in their environment.

    Parameters
    ----------
    node_name : str

    Yields
    ------
    str
        The master's URI.
    """
    os.environ.pop('ROS_IP', None)
    os.environ['ROS_HOSTNAME'] = 'localhost'
    master = rosmaster.master.Master(port=0)
    master.start()
    os.environ['ROS_MASTER_URI'] = master.uri
    try:
        rospy.init_node(node_name, disable_signals=True)
        rospy.set_param('/run_id', str(uuid.uuid1()))   # roslaunch waits for it
        yield master.uri
    finally:
        rospy.signal_shutdown('done')
        master.stop()
