"""Run a node beside the main thread, which is left to signals."""

from __future__ import annotations

import logging
import sys
import threading
import traceback
import xmlrpc.client
from typing import Any, Callable

import rospy
import yaml

from rvc_features.brief import cut, shown
from rvc_features.nodes.library_log import RosLog, library_log, log_without_master
from rvc_features.reconfigure import warn_of_refused


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
    arguments, problems = _settable(sys.argv)
    try:
        rospy.init_node(name, arguments, anonymous=anonymous)
    except Exception as error:
        if rospy.is_shutdown():   # a start that is cut short: told to end, it ends
            return 0
        rospy.logfatal(f'{name} can not start: {type(error).__name__}: {cut(str(error))}')
        return 1
    RosLog().install()
    logger = logging.getLogger('rvc_features')
    logger.addHandler(library_log())
    logger.propagate = False
    if problems:
        warn_of_refused(problems)
    status = [0]

    def start() -> None:
        try:
            log_without_master()
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


def _settable(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Arguments without any `_name:=value` that no parameter server can take, and why each is left out.

    rospy stumbles over those: an integer of more than 32 bits, a date, nothing, what is not YAML.
    """
    kept, problems = arguments[:1], []
    for argument in arguments[1:]:
        name, found, value = argument.partition(':=')
        try:
            if found and name.startswith('_') and not name.startswith('__'):
                xmlrpc.client.dumps((yaml.safe_load(value),))
            kept.append(argument)
        except Exception as error:   # whatever YAML makes of it
            problems.append(f'{name[1:]} can not be {shown(value)} ({type(error).__name__}: {cut(str(error), 60)})')
    return kept, problems
