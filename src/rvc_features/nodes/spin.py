"""Run a node beside the main thread, which is left to signals."""

from __future__ import annotations

import threading
import traceback
from typing import Any, Callable

import rospy


def spin(node: Callable[[], Any]) -> int:
    """Make or run a node in a thread of its own until rospy shuts down.

    rospy ends a node from a signal handler, in the main thread, and that asks the master. If the main thread were in a
    call to the master at that moment, as it often is while a node starts, it would wait for itself for ever.

    Parameters
    ----------
    node : callable
        Makes the node; may return at once or run as long as the node does.

    Returns
    -------
    int
        Exit status: 1 if `node` raised an exception, which then is in the log.
    """
    failed = threading.Event()

    def start() -> None:
        try:
            node()
        except Exception:
            if not rospy.is_shutdown():   # what a start that is cut short runs into is nobody's concern
                failed.set()
                rospy.logfatal(traceback.format_exc())
                rospy.signal_shutdown('the node has failed')

    threading.Thread(target=start, name='node', daemon=True).start()
    rospy.spin()
    return int(failed.is_set())
