"""How long a subscriber tries to reach a publisher: for as long as both are wanted.

rospy starts a thread for each publisher whenever the list of them changes, and the thread tries for ever: a camera
whose machine is switched off costs one more each time that somebody subscribes, and a stranger can make it a thousand.
"""

from __future__ import annotations

import functools
import threading
from typing import Any, Iterable

import rospy
from rospy.impl import masterslave
from rospy.impl.registration import RegManager, get_topic_manager


class _Attempts:
    """Those that are being made, one for each publisher of a topic, and which publishers there are."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._publishers: dict[str, frozenset[str]] = {}
        self._running: set[tuple[str, str, Any]] = set()   # topic, publisher, subscription
        self._own = threading.local()   # what the calling thread tries

    def wrap(self) -> None:
        """Have rospy ask here."""
        RegManager.publisher_update = self._noting(RegManager.publisher_update)
        masterslave.ROSHandler._connect_topic = self._trying(masterslave.ROSHandler._connect_topic)
        masterslave.is_shutdown = self._is_over   # what the loop of attempts asks each time

    def _noting(self, publisher_update: Any) -> Any:
        @functools.wraps(publisher_update)
        def note(manager: Any, topic: str, uris: Iterable[str]) -> None:
            if get_topic_manager().get_subscriber_impl(topic) is not None:
                with self._lock:
                    self._publishers[topic] = frozenset(map(str, uris))
            publisher_update(manager, topic, uris)

        return note

    def _trying(self, connect_topic: Any) -> Any:
        @functools.wraps(connect_topic)
        def try_to_connect(handler: Any, topic: str, uri: str) -> Any:
            attempt = topic, uri, get_topic_manager().get_subscriber_impl(topic)
            with self._lock:
                if attempt in self._running:
                    return 1, 'is being tried already', 0
                self._running.add(attempt)
            self._own.attempt = attempt
            try:
                return connect_topic(handler, topic, uri)
            finally:
                self._own.attempt = None
                with self._lock:
                    self._running.discard(attempt)

        return try_to_connect

    def _is_over(self) -> bool:
        attempt = getattr(self._own, 'attempt', None)
        if attempt is None:
            return rospy.is_shutdown()
        topic, uri, subscription = attempt
        return (rospy.is_shutdown() or get_topic_manager().get_subscriber_impl(topic) is not subscription
                or uri not in self._publishers.get(topic, (uri,)))


@functools.lru_cache(maxsize=None)
def limit_attempts() -> None:
    """Have this process's subscribers try like that."""
    _Attempts().wrap()
