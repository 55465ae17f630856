"""What watches over a node between a camera and what it makes of the images, and says so on /diagnostics."""

from __future__ import annotations

import dataclasses
import threading
import time
import traceback
from typing import Any, Callable

import numpy as np
import rospy

from rvc_features import key_points
from rvc_features.brief import reporter, shown
from rvc_features.heap import resident_bytes, settle
from rvc_features.image_transport.encodings import ImageError
from rvc_features.kernels import compiler
from rvc_features.nodes import detector_modules
from rvc_features.nodes.diagnostics import ERROR, Finding, Input, Situation, judge
from rvc_features.nodes.graph_watch import GraphWatch
from rvc_features.nodes.lazy_input import LazyInput
from rvc_features.nodes.library_log import library_log
from rvc_features.nodes.newest_worker import NewestWorker
from rvc_features.nodes.statistics import NodeStatistics
from rvc_features.nodes.status_publisher import StatusPublisher

_PATIENCE = 2.0   # seconds for each thread to end what it is at, when the node is told to end
_WAKE_UP = 1.0    # seconds until a subscription that has failed is thought of again
_MOST_TRACEBACKS = 10   # of errors in different places; each is shown once
_NO_KEY_POINTS = key_points.empty()


class Supervision:
    """Counts a node's images, keeps its input subscribed while somebody listens, and reports once a second.

    It reports from `start` on, so that whatever the node hangs at while it starts is seen; it subscribes from `started`
    on.

    Parameters
    ----------
    name : str
        Of the status, after the node's.
    at_work : callable
        Name of what is at work on an image.
    worker : NewestWorker
    images : LazyInput
        Of the topic `in`.
    output : str
        Topic of the node's own images, before it is remapped.
    details : callable, optional
        Returns what else a Situation should have, and values beside the common ones.
    house_work : callable, optional
        What else is to be done once a second.
    returned : callable, optional
        Called when a master that was restarted knows the node again.

    Attributes
    ----------
    statistics : NodeStatistics
    transport : str
        Of the images that come in.
    starting : str
        What the node is at while it starts; empty afterwards.
    lasting : list of Finding
        Found while it starts, and true from then on.
    graph_watch : GraphWatch
    """

    def __init__(self, name: str, at_work: Callable[[], str], worker: NewestWorker, images: LazyInput, output: str,
                 details: Callable[[], tuple[dict[str, Any], dict[str, Any]]] = lambda: ({}, {}),
                 house_work: Callable[[], Any] = lambda: None, returned: Callable[[], Any] = lambda: None) -> None:
        self.statistics = NodeStatistics(lambda: (worker.received, worker.dropped))
        self.transport = 'raw'
        self.starting = 'reading the parameters'
        self.lasting: list[Finding] = []
        self.graph_watch = GraphWatch(lambda: [self.input_state().topic], returned, lambda: self._status.is_heard())
        self._at_work, self._worker, self._images, self._output = at_work, worker, images, output
        self._details = details
        self._tracebacks: set[tuple[str, int]] = set()
        self._stopping = False
        self._status = StatusPublisher(name, self.report, house_work, self.statistics.report)
        self._subscribing = threading.Thread(target=self._keep_subscribed, name='lazy input', daemon=True)
        rospy.on_shutdown(self.stop)

    def start(self) -> None:
        """Begin to report."""
        self._status.start()

    def started(self) -> None:
        """The node can work on images: subscribe while somebody listens, and watch the graph."""
        settle()
        self.starting = ''
        self._subscribing.start()
        self.graph_watch.start()

    def import_detector_modules(self) -> None:
        """Import what ~detector_modules names; what can't be imported is said, and stays in the status."""
        for problem in detector_modules.import_all(rospy.get_param('~detector_modules', []), self._importing):
            self.lasting.append(Finding(ERROR, problem))
            rospy.logerr(problem)

    def busy(self) -> float:
        """Seconds that the image at work has been taking."""
        since = self._worker.busy_since
        return 0.0 if since is None else time.monotonic() - since

    def frame_arrived(self, message: Any) -> float:
        """Count an image that has come; returns when, by time.monotonic."""
        stamp, delay = message.header.stamp, None
        if stamp.secs or stamp.nsecs:
            now = time.time() if rospy.rostime.is_wallclock() else rospy.get_time()   # which makes several objects
            delay = now - stamp.secs - stamp.nsecs / 1e9
        return self.statistics.frame_arrived(delay)

    def frame_processed(self, shape: tuple[int, ...], begun: float, arrived: float,
                        found: np.ndarray = _NO_KEY_POINTS) -> None:
        """Count an image of that shape, with the key points it has; times are by time.monotonic."""
        now = time.monotonic()
        self.statistics.frame_processed(found, (shape[0], shape[1]), now - begun, now - arrived)

    def frame_refused(self, error: ImageError) -> None:
        """Count and report an image that is skipped."""
        self.statistics.frame_rejected(str(error))
        reporter().say(rospy.logwarn, 'images', f'image skipped: {error}')

    def frame_failed(self, error: BaseException) -> None:
        """Count and report what code that is plugged in raises, be it SystemExit: the next frame may be better."""
        text = f'{type(error).__name__}: {error}'
        self.statistics.frame_rejected(text)
        reporter().say(rospy.logerr, 'detector', f'image skipped: {text}')
        places = traceback.extract_tb(error.__traceback__)
        place = (places[-1].filename, places[-1].lineno or 0) if places else ('', 0)
        if place not in self._tracebacks and len(self._tracebacks) < _MOST_TRACEBACKS:
            self._tracebacks.add(place)
            rospy.logerr('this is said once:\n%s', ''.join(traceback.format_list(places[-4:])).rstrip()[-1000:])

    def input_state(self) -> Input:
        """Of the topic `in`."""
        return self._images.state('in', self.transport, self.graph_watch.graph)

    def report(self) -> tuple[Finding, dict[str, Any]]:
        """Level and message of the node's diagnostic status, and its values."""
        statistics, worker, images = self.statistics, self._worker, self.input_state()
        report, graph = statistics.report(), self.graph_watch.graph
        output = rospy.resolve_name(self._output)
        situation = Situation(
            self._at_work(), report, images,
            busy=self.busy(), abandoned=worker.abandoned(), starting=self.starting,
            other_publishers=tuple(node for node in (graph.publishers.get(output, ()) if graph else ())
                                   if node != rospy.get_name()),
            output_topic=output, last_problem=statistics.last_problem, lasting=tuple(self.lasting),
            passing=library_log().recent(), master=self.graph_watch.problem)
        processed = report.interval.processed
        changes, values = self._details()
        return judge(dataclasses.replace(situation, **changes)), {
            'input': f'{images.topic} ({images.transport})',
            'publishers connected': images.connections,
            'running on': compiler.description(),
            'frames received': worker.received,
            'frames processed': statistics.processed,
            'frames dropped for newer ones': worker.dropped,
            'frames rejected': statistics.frames_rejected,
            'last rejected because': statistics.last_problem,
            'rejected because': statistics.causes_in_words(),
            'milliseconds per frame': f'{1000 * report.interval.busy_seconds / processed:.1f}' if processed else 'none',
            'age of output in ms, median': f'{1000 * report.age_median:.1f}' if processed else 'none',
            'age of output in ms, worst': f'{1000 * report.age_worst:.1f}' if processed else 'none',
            'seconds from stamp to arrival': 'none' if report.stamp_delay is None else f'{report.stamp_delay:.3f}',
            **values,
            'memory in MB': f'{resident_bytes() / 1e6:.0f}',
        }

    def stop(self) -> None:
        """End the threads; called by rospy, whose own flag is not set yet."""
        self._stopping = True
        self._images.changed.set()
        self.graph_watch.stop()
        self._status.stop(_PATIENCE)
        if self._subscribing.is_alive():
            self._subscribing.join(_PATIENCE)
        self._worker.stop(_PATIENCE)

    def _importing(self, module: str) -> None:
        self.starting = f'importing {shown(module)}' if module else 'taking over the parameters'

    def _keep_subscribed(self) -> None:
        """Subscribe while somebody listens.

        A thread of its own: rospy announces listeners with locks held that subscribing needs too, and without a master
        subscribing waits until there is one.
        """
        while not self._stopping:
            self._images.update()
            self._images.wait(_WAKE_UP)
