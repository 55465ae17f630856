"""What is asked of a node beside what is asked of any detector: headers, pictures, frames and live parameters."""

from __future__ import annotations

from typing import Any, Mapping, Sequence

import numpy as np

from rvc_features.exercise import scenes
from rvc_features.exercise.drawings import as_bgr, is_grey, share_drawn, widest_drawn
from rvc_features.exercise.examination import (
    FAILED,
    LAST_EXERCISE,
    NOT_TESTED,
    PASSED,
    Check,
    Examination,
    examine,
)
from rvc_features.exercise.node_subject import NodeSubject, Reply
from rvc_features.exercise.questions import PARAMETERS, USUAL
from rvc_features.exercise.subject import CannotRunError

_ANOTHER = 0.5       # share of the pixels that differ: more is another picture
_SHOWN_BY_DRAWING = ('corners', 'edges', 'threshold', 'colour')
# What to turn, from and to, with what else: where the parameter is live the points differ.
_TURNED: Mapping[str, tuple[dict[str, Any], dict[str, Any]]] = {
    'threshold': ({'threshold': 0.02}, {'threshold': 0.2}),
    'window_size': ({'window_size': 3}, {'window_size': 15}),
    'fixed_number_of_points': ({'number_of_points': 3}, {'number_of_points': 3, 'fixed_number_of_points': True}),
    'number_of_points': ({'fixed_number_of_points': True, 'number_of_points': 2},
                         {'fixed_number_of_points': True, 'number_of_points': 9}),
    'octaves': ({'octaves': 1}, {'octaves': 3}),
    'anms': ({'anms_points': 3}, {'anms_points': 3, 'anms': True}),
    'anms_points': ({'anms': True, 'anms_points': 2}, {'anms': True, 'anms_points': 9}),
}


def examine_node(texts: Sequence[str], seconds: float, exercise: int = LAST_EXERCISE) -> Examination:
    """All checks of the node between the topics that `texts` name: in:=TOPIC image:=TOPIC [key_points:=TOPIC]."""
    subject = NodeSubject(_topics(texts), seconds)
    try:
        node = _NodeExaminer(subject)
        checks = node.checks()
        if node.has_points:
            detector = examine(subject, exercise, None if subject.has_points else _SHOWN_BY_DRAWING)
        else:
            detector = Examination(subject.name)
        lacking = [name for name in PARAMETERS if name not in subject.takes]
        remarks = [f'Its dynamic_reconfigure server has no {", ".join(lacking)}.'] if lacking else []
        if subject.whole_threshold:
            checks += node.of_whole_threshold()
        if not subject.has_points:
            remarks.append('No topic of key points was given: they are found in the drawing.')
        checks += [check for check in detector.checks if check.name not in ('prints', 'input')]
        return Examination(subject.name, checks, remarks)
    finally:
        subject.close()


def _topics(texts: Sequence[str]) -> dict[str, str]:
    topics = dict(text.split(':=', 1) for text in texts if ':=' in text)
    if len(topics) != len(texts) or not {'in', 'image'} <= set(topics) <= {'in', 'image', 'key_points'}:
        raise CannotRunError(f'--node takes in:=TOPIC image:=TOPIC [key_points:=TOPIC]; got {" ".join(texts)}')
    return topics


class _NodeExaminer:
    def __init__(self, subject: NodeSubject) -> None:
        self.subject = subject
        self.shows_input = True
        self.has_points = False

    def checks(self) -> list[Check]:
        """In the order of the sheet."""
        frames = [_frame(number) for number in range(4)]
        replies = [self.subject.exchange(frame) for frame in frames]
        if not all(replies):
            return [Check('answers', FAILED, f'{sum(reply is None for reply in replies)} of 4 images had no answer '
                          f'within {self.subject.seconds:g} s', ('no answer',))]
        answered = [reply for reply in replies if reply is not None]
        return [_header(answered), self._encoding(answered[0]), self._picture(frames, answered),
                self._newest(frames, answered), self._frozen(), *self._live()]

    def _encoding(self, first: Reply) -> Check:
        name, frame, bad = 'encoding', _frame(0), ''
        for reply, sent in ((first, 'bgr8'), (self.subject.exchange(frame[:, :, ::-1].copy(), 'rgb8'), 'rgb8')):
            if reply is None:
                return Check(name, FAILED, f'an image in {sent} has no answer', ('encoding wrong',))
            if reply.picture is None:
                bad = f'the picture of an image in {sent} can\'t be read: {reply.unreadable}'
            elif (not is_grey(reply.picture) and share_drawn(frame, reply.picture) > 0.1
                  and share_drawn(frame[:, :, ::-1], reply.picture) < 0.1):
                bad = f'red and blue are exchanged in the picture of an image in {sent}, published as {reply.encoding}'
            if bad:
                return Check(name, FAILED, f'it looks like encoding wrong: {bad}', ('encoding wrong',))
        return Check(name, PASSED, f'pictures are {first.encoding}, and what they say they are')

    def _picture(self, frames: Sequence[np.ndarray], replies: Sequence[Reply]) -> Check:
        name, picture = 'picture', replies[-1].picture
        if picture is None:
            self.shows_input = False
            return Check(name, NOT_TESTED, 'it can\'t be read')
        greys = [as_bgr(_grey(frame)) for frame in frames]
        if is_grey(picture):
            self.shows_input = min(share_drawn(grey, picture) for grey in greys) < _ANOTHER
            what = 'the grey image' if self.shows_input else 'another picture, in grey (a response map?),'
            return Check(name, FAILED, f'it looks like grey published: {what} comes out, not the one in colour that '
                         f'came in, as {replies[-1].encoding}', ('grey published',))
        self.shows_input = min(share_drawn(frame, picture) for frame in frames) < _ANOTHER
        if self.shows_input or share_drawn(frames[-1][:, :, ::-1], picture) < _ANOTHER:
            return Check(name, PASSED, 'the picture is the image that came in, with something drawn into it or not')
        size = f'{picture.shape[1]} x {picture.shape[0]}, sent were {frames[-1].shape[1]} x {frames[-1].shape[0]}'
        return Check(name, FAILED, f'another picture comes out than came in ({size}): it is turned, cut, scaled or '
                     'worked over', ('another picture published',))

    def _newest(self, frames: Sequence[np.ndarray], replies: Sequence[Reply]) -> Check:
        name = 'newest frame'
        shown = []
        for reply in replies:
            if reply.picture is None or reply.picture.shape != frames[0].shape:
                return Check(name, NOT_TESTED, 'the pictures can\'t be compared with what was sent')
            candidates = [as_bgr(_grey(frame)) for frame in frames] if is_grey(reply.picture) else frames
            shares = [min(share_drawn(one, reply.picture), share_drawn(one[:, :, ::-1], reply.picture))
                      for one in candidates]
            if sorted(shares)[0] > _ANOTHER or sorted(shares)[1] - sorted(shares)[0] < 0.02:
                return Check(name, NOT_TESTED, 'the pictures are none of those that were sent')
            shown.append(int(np.argmin(shares)))
        if shown == list(range(len(frames))):
            return Check(name, PASSED, 'each picture is that of the image with the same stamp')
        if shown[1:] == list(range(len(frames) - 1)):
            return Check(name, FAILED, 'it looks like a frame behind: each picture is that of the image before',
                         ('a frame behind',))
        return Check(name, FAILED, f'of 4 images the pictures show number {", ".join(str(one + 1) for one in shown)}',
                     ('the first picture for ever',) if len(set(shown)) == 1 else ())

    def _frozen(self) -> Check:
        """Whether another image gives other points."""
        name, found = 'points', []
        for scene in (scenes.corners(), scenes.strengths()):
            points = self._points(scene.image)
            if points is None or len(points) == 0:
                return Check(name, NOT_TESTED if points is None else FAILED,
                             'no points can be seen' if points is None else
                             f'no key point is {"sent" if self.subject.has_points else "drawn"} for {len(scene.sites)} '
                             'places with a corner', () if points is None else ('no key points',))
            found.append(points[['x', 'y']].tolist())
        self.has_points = True
        if found[0] == found[1]:
            return Check(name, FAILED, 'it looks like frozen detector: another image has the same key points',
                         ('frozen detector',))
        return Check(name, PASSED, 'another image has other key points')

    def _live(self) -> list[Check]:
        name, takes = 'parameters', self.subject.takes
        if self.subject.client is None:
            return [Check(name, FAILED, 'it has no dynamic_reconfigure server: no parameter is live',
                          ('parameter not live',))]
        live: list[str] = []
        dead: list[str] = []
        for parameter in (one for one in _TURNED if one in takes):
            before, after = _TURNED[parameter]
            if not set(before) | set(after) <= set(takes):
                continue
            seen = []
            for changed in (before, after):
                self.subject.configure({**USUAL, 'threshold': 0.02, **changed})
                seen.append(self._points(scenes.crowd().image))
            first, second = seen
            if first is None or second is None:
                return [Check(name, NOT_TESTED, 'no points can be seen')]
            what = ['x', 'y', 'response', 'octave']
            same = first[what].tolist() == second[what].tolist()
            (dead if same else live).append(takes[parameter])
        self.subject.configure(USUAL)
        if not live and not dead:
            return [Check(name, NOT_TESTED, 'its dynamic_reconfigure server has none of the sheet\'s parameters')]
        if not dead:
            return [Check(name, PASSED, f'each shows in the next image: {", ".join(live)}')]
        if not live and len(dead) > 1:
            return [Check(name, FAILED, 'it looks like frozen detector: no parameter shows in the next image, the '
                          'detector of the start is used for ever', ('frozen detector',))]
        return [Check(name, FAILED, f'it looks like parameter not live: {", ".join(dead)} does not show in the next '
                      'image', ('parameter not live',))]

    def of_whole_threshold(self) -> list[Check]:
        """A threshold that is a whole number is not the sheet's; what it does to the drawing tells of local maxima."""
        low, high = self.subject.threshold_range
        sentence = f'its threshold is a whole number from {low:g} to {high:g}, not a share of H_max'
        checks = [Check('threshold', FAILED, sentence, ('threshold not a share of H_max',))]
        widest = []
        for share in (0.9, 0.4):
            self.subject.set_threshold(round(low + share * (high - low)))
            image = self.subject.lifted(scenes.corners().image)
            reply = self.subject.exchange(image)
            widest.append(0 if reply is None or reply.picture is None else widest_drawn(image, reply.picture))
        if self.subject.has_points or 0 in widest:
            return checks
        if widest[1] >= widest[0] + 2:
            sentence = (f'it looks like no local maxima: what is drawn at a corner grows from {widest[0]} to '
                        f'{widest[1]} pixels when the threshold falls, as of many points side by side')
            return [*checks, Check('local maxima', FAILED, sentence, ('no local maxima',))]
        sentence = 'what is drawn at a corner does not grow when the threshold falls'
        return [*checks, Check('local maxima', PASSED, sentence)]

    def _points(self, image: np.ndarray) -> np.ndarray | None:
        return self.subject.points(self.subject.exchange(self.subject.lifted(image)), self.subject.lifted(image))


def _header(replies: Sequence[Reply]) -> Check:
    lost = [what for what, kept in (('stamp', all(reply.stamp_kept for reply in replies)),
                                    ('frame_id', all(reply.frame_kept for reply in replies))) if not kept]
    if lost:
        return Check('header', FAILED, f'it looks like header lost: the picture has another {" and ".join(lost)} than '
                     'the image that it is of', ('header lost',))
    return Check('header', PASSED, 'stamp and frame_id are those of the image')


def _frame(number: int) -> np.ndarray:
    """A colour image with a bright square, at another place for each number."""
    image = np.empty((96, 160, 3), np.uint8)
    image[:, :, 0], image[:, :, 1] = 150, 70
    image[:, :, 2] = np.linspace(20, 60, 160, dtype=np.uint8)
    x = 12 + 36 * number
    image[30:62, x:x + 30] = (60, 200, 240)
    return image


def _grey(image: np.ndarray) -> np.ndarray:
    return (image @ np.array([0.114, 0.587, 0.299]) + 0.5).astype(np.uint8)
