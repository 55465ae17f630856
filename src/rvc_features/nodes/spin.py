"""Run a node beside the main thread, which is left to signals."""

from __future__ import annotations

import logging
import threading
import traceback
from typing import Any, Callable

import rospy

from rvc_features.brief import cut
from rvc_features.nodes.library_log import library_log


def spin(name: str, node: Callable[[], Any], anonymous: bool = False) -> int:
    """Make or run a node in a thread of its own until rospy shuts down.

    rospy ends a node from a signal handler, in the main thread, and that asks the master. If the main thread were in a
    call to the master at that moment, as it often is while a node starts, it would wait for itself for ever.

    Parameters
    ----------
    name : str
        Of the node, as for rospy.init_node.
    node : callable
        Makes the node; may return at once or run as long as the node does. An integer that it returns, other than 0,
        ends the node with that status; so does an exception, with status 1.
    anonymous : bool
        As for rospy.init_node.

    Returns
    -------
    int
        Exit status; what an exception said is in the log.
    """
    logging.raiseExceptions = False   # a log file on a full disk is not worth a traceback for each line
    try:
        rospy.init_node(name, anonymous=anonymous)
    except Exception as error:
        if rospy.is_shutdown():   # a start that is cut short: told to end, it ends
            return 0
        rospy.logfatal(f'{name} can not start: {type(error).__name__}: {cut(str(error))}')
        return 1
    logger = logging.getLogger('rvc_features')
    logger.addHandler(library_log())
    logger.propagate = False
    status = [0]

    def start() -> None:
        try:
            result = node()
            status[0] = result if isinstance(result, int) else 0
        except Exception:
            if not rospy.core.is_shutdown_requested():   # what a start that is cut short runs into is nobody's concern
                status[0] = 1
                rospy.logfatal(traceback.format_exc())
        if status[0]:
            rospy.signal_shutdown('the node has failed')

    threading.Thread(target=start, name='node', daemon=True).start()
    rospy.spin()
    return status[0]
