"""Keeps an eye on the ROS graph: is the master there, does it still know this node, who publishes what.

A master that is restarted knows nobody. rospy says nothing and does nothing then: connections that exist live on, and
nobody finds the node any more. Here it is registered again as soon as the new master answers.
"""

from __future__ import annotations

import threading
import xmlrpc.client
from typing import Any, Callable, NamedTuple

import rosgraph
import rospy
from rospy.impl.registration import Registration, get_registration_listeners, get_service_manager, get_topic_manager

from rvc_features.brief import reporter

_PERIOD = 3.0        # seconds between two looks
_PATIENCE = 2.0      # seconds for an answer of the master or a node
_LOOKS_AT_PINGS = 3  # every so many looks the publishers are asked whether they live


class Graph(NamedTuple):
    """What the master says, and which of the publishers asked for do not answer."""

    publishers: dict[str, list[str]]
    types: dict[str, str]
    silent: frozenset[str]


class GraphWatch:
    """A thread that looks every few seconds, never waits long, and keeps what it saw.

    Parameters
    ----------
    topics : callable
        The topics whose publishers are to be asked whether they are alive.
    returned : callable
        Called when a master that was restarted knows the node again.
    wanted : callable
        Whether anybody wants to know the graph; else all that is asked is whether the master is there and knows the
        node, for on a robot the whole graph takes milliseconds to read.

    Attributes
    ----------
    problem : str
        What is wrong with the master; empty for nothing.
    graph : Graph or None
        What was seen last; None as long as that is nothing.
    """

    def __init__(self, topics: Callable[[], list[str]] = list, returned: Callable[[], Any] = lambda: None,
                 wanted: Callable[[], bool] = lambda: True) -> None:
        self.problem = ''
        self.graph: Graph | None = None
        self._topics, self._returned, self._wanted = topics, returned, wanted
        self._stopped = threading.Event()
        self._looks = 0
        self._silent: frozenset[str] = frozenset()
        self._thread = threading.Thread(target=self._run, name='graph watch', daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """End the thread, without waiting for it: it may be waiting for a master."""
        self._stopped.set()

    def look(self) -> None:
        """Look once; whatever the network does ends in `problem`."""
        address = rosgraph.get_master_uri()
        master, me = _proxy(address), rospy.get_name()
        try:
            if not self._known(master, me):
                register_again()
                reporter().say(rospy.logwarn, 'master', f'the master at {address} has been restarted: registered again')
                self._returned()
            graph = self._seen(master, me) if self._wanted() else None
        except Exception as error:   # refused, timed out, not a master, half an answer
            self.problem = (f'the master at {address} does not answer ({type(error).__name__}: {error}); connections '
                            'that exist live on, new ones are impossible')
            reporter().say(rospy.logerr, 'master', self.problem)
        else:
            self.problem = ''
            self.graph = graph

    def _seen(self, master: Any, me: str) -> Graph:
        publishers = dict(_answer(master.getSystemState(me))[0])
        types = dict(_answer(master.getTopicTypes(me)))
        if self._looks % _LOOKS_AT_PINGS == 0:
            wanted = {node for topic in self._topics() for node in publishers.get(topic, [])} - {me}
            self._silent = frozenset(node for node in wanted if not _lives(master, me, node))
        self._looks += 1
        return Graph(publishers, types, self._silent)

    def _known(self, master: Any, me: str) -> bool:
        """Whether the master knows this node's first service, which is registered only once, at the start."""
        services = get_service_manager().get_services()
        if not services:
            return True
        return master.lookupService(me, services[0][0])[0] == 1

    def _run(self) -> None:
        while not self._stopped.wait(_PERIOD):
            self.look()


def register_again() -> None:
    """Tell the master of all topics and services of this node, as if they were new."""
    for kind, entries in ((Registration.PUB, get_topic_manager().get_publications()),
                          (Registration.SUB, get_topic_manager().get_subscriptions()),
                          (Registration.SRV, get_service_manager().get_services())):
        for name, type_or_uri in entries:
            get_registration_listeners().notify_added(name, type_or_uri, kind)


def _lives(master: Any, me: str, node: str) -> bool:
    """Whether a node that the master knows answers."""
    try:
        _answer(_proxy(_answer(master.lookupNode(me, node))).getPid(me))
    except Exception:   # whatever it is, that is no answer
        return False
    return True


def _answer(triple: Any) -> Any:
    code, message, value = triple
    if code != 1:
        raise ConnectionError(message)
    return value


def _proxy(uri: str) -> Any:
    return xmlrpc.client.ServerProxy(uri, transport=_ImpatientTransport())


class _ImpatientTransport(xmlrpc.client.Transport):
    """HTTP that gives up: a node that is stopped takes connections and never answers."""

    def make_connection(self, host: Any) -> Any:
        connection = super().make_connection(host)
        connection.timeout = _PATIENCE
        return connection
