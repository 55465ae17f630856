"""What a node's state means: findings with a level, from plain numbers. (No ROS here; levels as in DiagnosticStatus.)

The status of a node is its worst finding's level, and a message with all findings, the worst first.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Iterator, NamedTuple

from rvc_features.brief import cut
from rvc_features.nodes.statistics import Report

OK, WARN, ERROR = 0, 1, 2

FIRST_PATIENCE = 5.0     # seconds without images before it is said, as long as it is not known how often they come
_LEAST_PATIENCE = 2.5    # seconds, once it is known
_GAPS = 3                # times the usual gap without images before it is said
_BUSY, HANGING = 2.0, 10.0   # seconds for one image: worth a warning, and an error
_MANY_DROPPED = 0.1      # share of the images
_FEW_DROPPED = 3         # images, that are no overload yet
_OLD = 1.0               # seconds from an image's arrival to its results
_LATE = 1.0, 600.0       # seconds from stamp to arrival; beyond the latter, stamps are of another clock or day
_CORNER = 0.25           # of the image's sides: where all points lie in less, they lie in one corner
_MANY_POINTS = 20        # fewer may well lie in one corner
_LONGEST_MESSAGE = 400   # characters


class Finding(NamedTuple):
    level: int
    text: str


@dataclass(frozen=True)
class Input:
    """The images that come in, or should."""

    topic: str                          # the transport's own
    transport: str
    message_type: str
    listeners: int = 0                  # of what the node makes of them: without any, none are wanted
    subscribed: bool = False
    connections: int = 0
    problem: str = ''                   # of subscribing
    subscribing: float = 0.0            # seconds that this has been taking
    remapped: bool = True
    # What the master says; None where it has not been asked.
    publishers: tuple[str, ...] | None = None
    published_before: bool = False      # whether there ever was one
    silent: tuple[str, ...] = ()        # those of them that do not answer
    published_type: str = ''
    other_transports: tuple[str, ...] = ()


@dataclass(frozen=True)
class Situation:
    """All that is known about a node."""

    detector: str
    report: Report
    input: Input
    busy: float = 0.0                   # seconds that the detector has been at work on one image
    abandoned: int = 0                  # calls of detectors that hang, and were given up for another detector
    starting: str = ''                  # what it is at while it starts
    least_points: int = 0
    other_publishers: tuple[str, ...] = ()   # of the topic of its own images
    output_topic: str = ''
    last_problem: str = ''
    lasting: tuple[Finding, ...] = field(default=())   # found once, and true from then on
    passing: tuple[str, ...] = ()       # warnings of the last minute
    master: str = ''                    # what is wrong with the master


def judge(situation: Situation) -> Finding:
    """Level and message of a node's status."""
    findings = sorted(findings_of(situation), key=lambda finding: -finding.level)
    if not findings:
        seconds, processed = situation.report.interval.seconds, situation.report.interval.processed
        rate = f'{processed / seconds:.1f} images per second' if seconds > 0 else 'starting'
        return Finding(OK, 'idle: nobody listens' if situation.input.listeners == 0 else rate)
    message = cut('; '.join(finding.text for finding in findings), _LONGEST_MESSAGE)
    idle = 'idle: nobody listens; ' if situation.input.listeners == 0 and not situation.starting else ''
    return Finding(findings[0].level, idle + message)


def findings_of(situation: Situation) -> Iterator[Finding]:
    """Everything that is not as it should be."""
    yield from situation.lasting
    if situation.starting:
        yield Finding(WARN, f'starting: {situation.starting}')
        return
    if situation.master:
        yield Finding(WARN, situation.master)
    yield from _about_input(situation.input, situation.report)
    yield from _about_detector(situation)
    if situation.other_publishers:
        yield Finding(WARN, f'{situation.output_topic} is published by {_names(situation.other_publishers)}, too')
    yield from (Finding(WARN, text) for text in situation.passing)


def _about_input(images: Input, report: Report) -> Iterator[Finding]:
    if images.problem:
        yield Finding(ERROR, images.problem)
    elif images.subscribing > _BUSY:
        yield Finding(ERROR, f'subscribing to {images.topic} has been taking {images.subscribing:.0f} s')
    elif images.published_type and images.published_type not in (images.message_type, '*'):
        yield Finding(ERROR, f'{images.topic} is of type {images.published_type}; {images.message_type} is wanted')
    elif (images.publishers is not None and set(images.publishers) <= set(images.silent)
          and not (images.connections and report.silence <= _patience(report.usual_gap))):
        yield from _about_camera(images)
    elif images.subscribed and report.silence > _patience(report.usual_gap):
        yield Finding(WARN, f'no images on {images.topic} ({images.transport}) for {report.silence:.0f} s'
                      + ('' if images.connections else ', not connected to any publisher'))
    elif images.subscribed and report.stamp_delay is not None and _LATE[0] < report.stamp_delay < _LATE[1]:
        yield Finding(WARN, f'images come {report.stamp_delay:.1f} s after their stamp')


def _about_camera(images: Input) -> Iterator[Finding]:
    """Of a topic that has no publisher, or none that lives."""
    if images.silent:
        yield Finding(WARN, f'{_names(images.silent)}, which published {images.topic}, does not answer')
        return
    if not (images.subscribed or images.published_before or images.other_transports) and images.remapped:
        return   # a camera that is not there yet is no trouble as long as nobody wants images
    text = f'no images: nobody publishes {images.topic} ({images.transport})'
    if images.other_transports:
        text += f'; set ~image_transport to {" or ".join(images.other_transports)}, which is there'
    elif not images.remapped:
        text += '; `in` is not remapped to a camera\'s topic'
    yield Finding(WARN, text)


def _about_detector(situation: Situation) -> Iterator[Finding]:
    report, window = situation.report, situation.report.window
    if situation.busy > _BUSY:
        yield Finding(ERROR if situation.busy > HANGING else WARN,
                      f'{situation.detector} has been at work on one image for {situation.busy:.0f} s')
    if situation.abandoned:
        yield Finding(WARN, f'{situation.abandoned} calls of detectors that were given up still hang')
    if report.interval.rejected or (window.rejected and not window.processed):
        nothing_else = window.processed == 0 and window.rejected >= _FEW_DROPPED
        share = f'{window.rejected} of {window.received} in {window.seconds:.0f} s'
        yield Finding(ERROR if nothing_else else WARN, f'images rejected: {situation.last_problem} ({share})')
    if window.dropped >= _FEW_DROPPED and window.dropped > _MANY_DROPPED * window.received:
        yield Finding(WARN, f'overload: {window.dropped} of {window.received} images dropped in '
                            f'{window.seconds:.0f} s')
    if report.age_worst > _OLD:
        yield Finding(WARN, f'results come up to {report.age_worst:.1f} s after their image')
    if report.interval.processed:
        yield from _about_points(report, situation.least_points)


def _about_points(report: Report, least: int) -> Iterator[Finding]:
    if max(report.points, default=0) < least:
        yield Finding(WARN, f'too few key points: {report.points[-1]}, where {least} are the least')
    elif report.points[-1] >= _MANY_POINTS and least > 0 and max(report.spread) < _CORNER:
        yield Finding(WARN, f'nearly all key points lie within {report.spread[0]:.0%} x {report.spread[1]:.0%} of the '
                            'image')


def _patience(usual_gap: float) -> float:
    return max(_LEAST_PATIENCE, _GAPS * usual_gap) if usual_gap > 0 else FIRST_PATIENCE


def _names(nodes: tuple[str, ...]) -> str:
    return ', '.join(nodes[:3]) + (f' and {len(nodes) - 3} more' if len(nodes) > 3 else '')
