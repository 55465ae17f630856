"""The command line: `rosrun rvc_features compare_detectors`, or `python3 -m rvc_features.comparison.command`."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
from concurrent.futures import BrokenExecutor
from typing import Any, Iterator, NoReturn, Sequence

import cv2

from rvc_features import detectors
from rvc_features.comparison import (
    contestants,
    datasets,
    executors,
    inputs,
    report,
    runner,
    sequences,
    summary,
    text_tables,
)
from rvc_features.comparison.contestants import ContestantError
from rvc_features.comparison.datasets import Dataset, Options
from rvc_features.comparison.executors import DaskError
from rvc_features.comparison.pair_task import Settings
from rvc_features.comparison.results import Store
from rvc_features.comparison.runner import Progress
from rvc_features.recordings.image_sources import SourceError

FAILED = 1
BAD_INPUT = 2          # exit status, as argparse's own
INTERRUPTED = 128      # plus the number of the signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    parser = _parser()
    given = parser.parse_args(arguments)
    _quiet_opencv()
    try:
        with _signals_as_exceptions():
            return _compare(given)
    except (SourceError, ContestantError, DaskError) as error:
        print(f'{parser.prog}: {error}', file=sys.stderr)
        return BAD_INPUT
    except BrokenExecutor as error:
        print(f'{parser.prog}: a worker process has died, perhaps for lack of memory ({error}); the same command goes '
              'on from there, with fewer --workers if need be.', file=sys.stderr)
        return FAILED
    except OSError as error:
        print(f'{parser.prog}: {error.filename or given.output}: {error.strerror or error}', file=sys.stderr)
        return FAILED
    except _Interrupted as interruption:
        print(f'{parser.prog}: stopped; what is measured is kept in {given.output}, and the same command goes on '
              'from there.', file=sys.stderr)
        return INTERRUPTED + interruption.number


def _compare(given: argparse.Namespace) -> int:
    for module in given.import_:
        _import(module)
    group = _contestants(given)
    chosen = _datasets(given)
    if not given.output:
        raise SourceError('--output needs a folder')
    try:
        store = Store(os.path.join(given.output, 'results'))
    except OSError as error:
        raise SourceError(f'{given.output}: results can\'t be written there ({error.strerror}); give another folder '
                         'with --output') from None

    print(f'Comparing {"; ".join(contestant.label for contestant in group)}')
    for dataset in chosen:
        print(f'on {dataset.name}: {dataset.description}', flush=True)
    gallery = report.Gallery()
    with executors.executor_for(given.workers, given.dask_scheduler) as (executor, concurrent):
        settings = Settings(tuple(contestant.specification() for contestant in group), given.points,
                            tuple(sorted(set(given.epsilon))), given.repeats, given.seed, concurrent,
                            tuple(given.import_))
        progress = Progress(runner.total_of(chosen))
        try:
            measured = runner.run(chosen, settings, store, executor, progress, gallery.look)
        finally:
            progress.close()
    if not measured:
        raise SourceError('there is no image to compare on; give one, or no input at all for a built-in photograph')

    made = summary.sections(measured, chosen, [contestant.label for contestant in group], settings.epsilons,
                            settings.points, settings.seed)
    paths = report.write(given.output, given.title, made, measured, chosen, group, settings, gallery)
    print(text_tables.as_text(made))
    print('Wrote ' + ', '.join(paths))
    return 0


def _contestants(given: argparse.Namespace) -> list[contestants.Contestant]:
    chosen = []
    for path in given.detectors_from:
        chosen += contestants.read_yaml(path, given.points)
    chosen += [contestants.parse(text, given.points) for text in given.detector]
    return contestants.with_distinct_labels(chosen or contestants.presets(given.points))


def _datasets(given: argparse.Namespace) -> list[Dataset]:
    options = Options(given.kind, given.topic, given.every, given.maximum_frames, given.crop_identity, given.seed)
    chosen = inputs.open_inputs(given.input, options)
    chosen += [sequences.single_pair(first, second, homography, options) for first, second, homography in given.pair]
    chosen += [inputs.synthetic(path, options) for path in given.photograph]
    if given.examples:
        chosen += inputs.examples(options)
    return datasets.with_distinct_names(chosen or [inputs.synthetic(None, options)])


def _import(module: str) -> None:
    """Import a module that registers the user's own detectors."""
    import importlib
    sys.path.insert(0, os.getcwd())
    try:
        importlib.import_module(module)
    except Exception as error:
        raise ContestantError(f'--import {module}: {type(error).__name__}: {error}; it must be a module that Python '
                              'finds, here or on PYTHONPATH') from None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='compare_detectors', formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Compare key point detectors on any images, and write a report: one HTML page, Markdown and CSV.',
        epilog=f'Detectors: {", ".join(detectors.names())}. '
               'What each number means and the YAML format: docs/comparison.md.\n\n'
               'examples:\n'
               '  compare_detectors                               one photograph under known changes\n'
               '  compare_detectors oxford/graf oxford/boat       sequences with ground truth\n'
               '  compare_detectors drive.bag --topic /camera/image_raw --workers 4\n'
               '  compare_detectors frames/ -d harris:window_size=7,octaves=3 -d "fine=fast:threshold=5"')
    parser.add_argument('input', nargs='*', metavar='INPUT',
                        help='sequence folder (Oxford/VGG or HPatches layout), folder of such, folder of images, '
                             'image files, video or bag; with no input at all a photograph under known changes')
    what = parser.add_argument_group('what is compared on')
    what.add_argument('--kind', choices=datasets.KINDS, default='auto',
                      help='take every INPUT as this instead of finding out')
    what.add_argument('--topic', default='', help='image topic of a bag: sensor_msgs/Image or CompressedImage')
    what.add_argument('--pair', nargs=3, action='append', default=[], metavar=('IMAGE1', 'IMAGE2', 'HOMOGRAPHY'),
                      help='two images and the file with the homography between them; may be repeated')
    what.add_argument('--photograph', action='append', default=[], metavar='IMAGE',
                      help='a photograph to put under known changes; may be repeated')
    what.add_argument('--examples', action='store_true',
                      help='a real pair, photographs and a video that come with Debian\'s opencv-doc')
    what.add_argument('--every', type=_integer(1), default=1, metavar='N',
                      help='take every N-th frame of videos, bags and images (default: %(default)s)')
    what.add_argument('--maximum-frames', type=_integer(1), metavar='N', help='stop after N frames of each input')
    what.add_argument('--no-identity-crop', dest='crop_identity', action='store_false',
                      help='do not crop the second image of a sequence where the homography is the identity')
    who = parser.add_argument_group('what is compared')
    who.add_argument('-d', '--detector', action='append', default=[], metavar='[LABEL=]NAME[:PARAMETER=VALUE,...]',
                     help='a detector; may be repeated (default: a choice of all)')
    who.add_argument('--detectors-from', action='append', default=[], metavar='FILE', help='a YAML file of detectors')
    who.add_argument('--import', dest='import_', action='append', default=[], metavar='MODULE',
                     help='a Python module that registers detectors of your own')
    how = parser.add_argument_group('how')
    how.add_argument('--points', type=_integer(1), default=500, metavar='K',
                     help='compare the K strongest points of each image (default: %(default)s)')
    how.add_argument('--epsilon', type=_positive, nargs='+', default=[1.5, 3.0], metavar='PIXELS',
                     help='distances within which a point is found again (default: 1.5 3)')
    how.add_argument('--repeats', type=_integer(1), default=3, metavar='N',
                     help='how often each detector is timed on each image (default: %(default)s)')
    how.add_argument('--seed', type=_integer(0), default=1, help='of all that is random (default: %(default)s)')
    how.add_argument('--workers', type=_integer(1), default=1, metavar='N',
                     help='processes; times are the most trustworthy with one (default: %(default)s)')
    how.add_argument('--dask-scheduler', metavar='ADDRESS',
                     help='run on the workers of a Dask cluster, such as tcp://host:8786, instead')
    how.add_argument('--output', default='compare_output', metavar='FOLDER',
                     help='where the report goes; a second call with the same folder goes on (default: %(default)s)')
    how.add_argument('--title', default='How do the detectors compare?', help='of the report')
    return parser


def _integer(least: int) -> Any:
    def integer(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = least - 1
        if number < least:
            raise argparse.ArgumentTypeError(f'must be an integer of at least {least}; got {text!r}')
        return number
    return integer


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0
    if not 0 < number < 1e6:
        raise argparse.ArgumentTypeError(f'must be a positive number; got {text!r}')
    return number


class _Interrupted(BaseException):
    """Ctrl-C or SIGTERM; not an Exception, so that nothing on the way takes it for an error."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextlib.contextmanager
def _signals_as_exceptions() -> Iterator[None]:
    def interrupt(number: int, frame: Any) -> NoReturn:
        raise _Interrupted(number)

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _quiet_opencv() -> None:
    """What OpenCV prints about a bad file is said by us, once and in words."""
    with contextlib.suppress(AttributeError):
        cv2.utils.logging.setLogLevel(0)   # type: ignore[attr-defined]


if __name__ == '__main__':
    sys.exit(main())
