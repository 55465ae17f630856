"""The command line: `rosrun rvc_features compare_detectors`, or `python3 -m rvc_features.comparison.command`."""

from __future__ import annotations

import argparse
import shlex
import sys
from typing import Sequence

from rvc_features.command_line import at_least, positive_number, print_safely
from rvc_features.comparison.datasets import KINDS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    print_safely()
    arguments = sys.argv[1:] if arguments is None else arguments
    given = _parser().parse_args(arguments)
    given.command = ' '.join(shlex.quote(word) for word in ('compare_detectors', *arguments))
    from rvc_features.comparison.compare import compare  # here, for it takes a second, which --help can do without
    return compare(given)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='compare_detectors', formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Compare key point detectors on any images, and write a report: one HTML page, Markdown and CSV.',
        epilog='Detectors: fast, good_features_to_track, harris, orb, and your own with --import. '
               'Presets of harris: course, even, matching, repeatable. '
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
    what.add_argument('--kind', choices=KINDS, default='auto',
                      help='take every INPUT as this instead of finding out')
    what.add_argument('--topic', default='', help='image topic of a bag: sensor_msgs/Image or CompressedImage')
    what.add_argument('--pair', nargs=3, action='append', default=[], metavar=('IMAGE1', 'IMAGE2', 'HOMOGRAPHY'),
                      help='two images and the file with the homography between them; may be repeated')
    what.add_argument('--photograph', action='append', default=[], metavar='IMAGE',
                      help='a photograph to put under known changes; may be repeated')
    what.add_argument('--examples', action='store_true',
                      help='a real pair, photographs and a video that come with Debian\'s opencv-doc')
    what.add_argument('--or-examples', action='store_true',
                      help='the same where nothing else is named to compare on, as ./run compare does')
    what.add_argument('--every', type=at_least(1), default=1, metavar='N',
                      help='take every N-th frame of videos, bags and images (default: %(default)s)')
    what.add_argument('--maximum-frames', type=at_least(1), metavar='N', help='stop after N frames of each input')
    what.add_argument('--mask', default='', metavar='MASK',
                      help='no points there: rectangles x,y,width,height separated by blanks, or an image file that is '
                      'zero there')
    what.add_argument('--no-identity-crop', dest='crop_identity', action='store_false',
                      help='do not crop the second image of a sequence where the homography is the identity')
    who = parser.add_argument_group('what is compared')
    who.add_argument('-d', '--detector', action='append', default=[], metavar='[LABEL=]NAME[:PARAMETER=VALUE,...]',
                     help='a detector or a preset of harris; may be repeated (default: a choice of all)')
    who.add_argument('--detectors-from', action='append', default=[], metavar='FILE', help='a YAML file of detectors')
    who.add_argument('--import', dest='import_', action='append', default=[], metavar='MODULE',
                     help='a Python module that registers detectors of your own')
    how = parser.add_argument_group('how')
    how.add_argument('--points', type=at_least(1), default=500, metavar='K',
                     help='compare the K strongest points of each image (default: %(default)s)')
    how.add_argument('--epsilon', type=positive_number, nargs='+', default=[1.5, 3.0], metavar='PIXELS',
                     help='distances within which a point is found again (default: 1.5 3)')
    how.add_argument('--repeats', type=at_least(1), default=3, metavar='N',
                     help='how often each detector is timed on each image (default: %(default)s)')
    how.add_argument('--seed', type=at_least(0), default=1, help='of all that is random (default: %(default)s)')
    how.add_argument('--workers', type=at_least(1), default=1, metavar='N',
                     help='processes; times are the most trustworthy with one (default: %(default)s)')
    how.add_argument('--dask-scheduler', metavar='ADDRESS',
                     help='run on the workers of a Dask cluster, such as tcp://host:8786, instead')
    how.add_argument('--output', default='compare_output', metavar='FOLDER',
                     help='where the report goes; a second call with the same folder goes on (default: %(default)s)')
    how.add_argument('--title', default='How do the detectors compare?', help='of the report')
    return parser


if __name__ == '__main__':
    sys.exit(main())
