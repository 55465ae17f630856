"""A node's status on /diagnostics, once a second while somebody listens, whatever the rest of the node is at."""

from __future__ import annotations

import threading
import time
from typing import Any, Callable

import rospy
from diagnostic_updater import Updater

from rvc_features.brief import cut, reporter
from rvc_features.image_transport.whole_writes import num_connections
from rvc_features.nodes.diagnostics import ERROR, Finding

_PERIOD = 1.0   # seconds, by the wall, whatever /clock does


class StatusPublisher:
    """A thread that asks for the status, publishes it, and keeps the log up to date.

    Parameters
    ----------
    name : str
        Of the status, after the node's.
    status : callable
        Returns a Finding, with level and message, and a dict of values.
    house_work : callable
        What else is to be done once a second.
    unheard : callable
        What is done instead of asking for the status while nobody listens.
    """

    def __init__(self, name: str, status: Callable[[], tuple[Finding, dict[str, Any]]],
                 house_work: Callable[[], Any] = lambda: None, unheard: Callable[[], Any] = lambda: None) -> None:
        self._status, self._house_work, self._unheard = status, house_work, unheard
        self._updater = Updater()
        self._updater.setHardwareID('none')
        self._updater.add(name, self._fill_in)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name='status', daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, seconds: float) -> None:
        """End the thread; wait for that, but not longer."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join(seconds)

    def is_heard(self) -> bool:
        """Whether somebody listens to /diagnostics."""
        return num_connections(self._updater.publisher) > 0

    def _run(self) -> None:
        next_report = time.monotonic()
        while not self._stopped.wait(max(0.0, next_report - time.monotonic())):
            next_report = time.monotonic() + _PERIOD
            try:
                (self._updater.force_update if self.is_heard() else self._unheard)()
                reporter().catch_up()
                self._house_work()
            except Exception as error:   # whatever the network does: the next report may get through
                reporter().say(rospy.logerr, 'diagnostics', f'no report: {type(error).__name__}: {error}')

    def _fill_in(self, status: Any) -> Any:
        try:
            finding, values = self._status()
        except Exception as error:   # silence is what must not happen here
            finding, values = Finding(ERROR, cut(f'no status: {type(error).__name__}: {error}')), {}
        status.summary(finding.level, finding.text)
        for name, value in values.items():
            status.add(name, str(value))
        return status
