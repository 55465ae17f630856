"""An input that a node subscribes to only while somebody listens to what it makes of it."""

from __future__ import annotations

import dataclasses
import threading
import time
from typing import Any, Callable

import rosgraph
import rospy

from rvc_features.brief import reporter
from rvc_features.image_transport import TRANSPORTS, Subscriber
from rvc_features.nodes.diagnostics import Input
from rvc_features.nodes.graph_watch import Graph

_FIRST_PAUSE, _LONGEST_PAUSE = 1.0, 30.0   # seconds between two attempts to subscribe that fail


class LazyInput:
    """Subscribes and unsubscribes as listeners come and go; what fails is tried again, less and less often.

    `update` is to be called from one thread, and not from rospy's callbacks: those announce listeners with locks held
    that subscribing needs too. They only set `changed`, for which that thread waits. Without a master it may wait
    until there is one, so that thread should have nothing else to do.

    Parameters
    ----------
    subscribe : callable
        Makes the subscription.
    listeners : callable
        How many there are at the moment.

    Attributes
    ----------
    subscriber : image_transport.Subscriber or None
    changed : threading.Event
        To be set when somebody begins or ceases to listen.
    problem : str
        Why the last attempt to subscribe failed; empty if it didn't.
    subscribing_since : float or None
        By time.monotonic, when an attempt was begun that has not ended yet.
    """

    def __init__(self, subscribe: Callable[[], Subscriber], listeners: Callable[[], int]) -> None:
        self.subscriber: Subscriber | None = None
        self.changed = threading.Event()
        self.problem = ''
        self.subscribing_since: float | None = None
        self._subscribe, self._listeners = subscribe, listeners
        self._published_before = False
        self._pause = _FIRST_PAUSE
        self._next_attempt = 0.0

    def update(self) -> None:
        """Subscribe if somebody listens now, unsubscribe if nobody does; never raises."""
        wanted = self._listeners() > 0
        if wanted and self.subscriber is None:
            if time.monotonic() >= self._next_attempt:
                self._attempt()
        elif not wanted:
            self.problem = ''
            subscriber, self.subscriber = self.subscriber, None
            if subscriber is not None:
                try:
                    subscriber.shutdown()
                except Exception as error:   # the master is away, for one: what matters is that no image comes any more
                    reporter().say(rospy.logwarn, 'unsubscribe', f'not unsubscribed: {type(error).__name__}: {error}')

    def wait(self, seconds: float) -> None:
        """Until listeners change, but not longer than that."""
        if self.changed.wait(seconds):
            self.changed.clear()

    def state(self, name: str, transport_name: str, graph: Graph | None) -> Input:
        """What /diagnostics has to know, and what the graph says of the topic.

        Parameters
        ----------
        name : str
            Of the base topic, before it is remapped.
        transport_name : str
        graph : Graph, optional
            What the master was last heard to say.
        """
        base, subscriber, since = rospy.resolve_name(name), self.subscriber, self.subscribing_since
        transport: Any = TRANSPORTS[transport_name]()
        state = Input(
            topic=transport.topic(base), transport=transport_name, message_type=transport.message_class._type,
            listeners=self._listeners(), subscribed=subscriber is not None, problem=self.problem,
            connections=0 if subscriber is None else subscriber.get_num_publishers(),
            subscribing=0.0 if since is None else time.monotonic() - since,
            remapped=base != rosgraph.names.ns_join(rospy.get_namespace(), name))
        if graph is None:
            return state
        publishers = tuple(graph.publishers.get(state.topic, ()))
        self._published_before |= bool(publishers)
        return dataclasses.replace(
            state, publishers=publishers, published_before=self._published_before,
            silent=tuple(node for node in publishers if node in graph.silent),
            published_type=graph.types.get(state.topic, '') if publishers else '',
            other_transports=tuple(other for other, kind in TRANSPORTS.items()
                                   if other != transport_name and graph.publishers.get(kind().topic(base))))

    def _attempt(self) -> None:
        self.subscribing_since = time.monotonic()
        try:
            self.subscriber = self._subscribe()
        except Exception as error:   # the master is away, a parameter makes no sense: both may change
            self.problem = f'can not subscribe: {type(error).__name__}: {error}'
            reporter().say(rospy.logerr, 'subscribe', self.problem)
            self._next_attempt = time.monotonic() + self._pause
            self._pause = min(2 * self._pause, _LONGEST_PAUSE)
        else:
            self.problem, self._pause = '', _FIRST_PAUSE
        self.subscribing_since = None
