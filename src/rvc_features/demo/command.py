"""The main job on real frames: plays a bag into the node, turns parameters meanwhile, and keeps what comes out.

    rosrun rvc_features demo [--output FOLDER] [--bag FILE [--topic NAME]] [--view]

Leaves in the output folder: the bags that were played (where it made them), output.bag with what the node published,
annotated.avi, and contact_sheet.png with a frame for each setting. Everything runs under a master of its own.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import os
import sys
from pathlib import Path
from typing import Iterator, Sequence

import cv2

from rvc_features.command_line import BAD_INPUT, FAILED, Interrupted, print_safely, quiet_opencv, signals_as_exceptions
from rvc_features.demo.results import contact_sheet, lost, summary
from rvc_features.demo.scenes import DemoError, own_bag, real_frames
from rvc_features.recordings.regular_files import SourceError
from rvc_features.recordings.whole_files import whole_file


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    print_safely()
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.topic and not options.bag:
        parser.error('--topic names a topic of the bag, so --bag is needed, too')
    quiet_opencv()
    output = Path(options.output)
    try:
        with signals_as_exceptions():
            _make_folder(output)
            with _alone_in(output):
                from rvc_features.demo.play import play  # here: a mistake on the command line is said at once
                scenes, topic = own_bag(options.bag, options.topic) if options.bag else real_frames(output)
                phases, running_on = play(scenes, topic, output, options.view)
                with whole_file(output / 'contact_sheet.png', suffix='.png') as unfinished:
                    cv2.imwrite(str(unfinished), contact_sheet(phases))
                table = f'{summary(phases)}\nThe node ran on {running_on}.'
                (output / 'summary.txt').write_text(table + '\n')
    except (SourceError, DemoError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return BAD_INPUT
    except Interrupted as interruption:
        print(f'demo: {interruption}; all that it started has ended', file=sys.stderr)
        return interruption.status
    print(f'\n{table}\n\nIn {output}: contact_sheet.png, annotated.avi, output.bag, summary.txt')
    sentence = lost(phases)
    if sentence:
        print(f'demo: {sentence}', file=sys.stderr)
    return FAILED if sentence else 0


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:   # a file of that name, for one, which says no more than "File exists"
        raise DemoError(f'{path}: results can\'t be written there ({error.strerror}); give another folder with '
                        '--output') from None


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """DemoError while another demo writes there."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DemoError(f'another demo is writing into {folder}; wait for it, or name another folder with '
                            '--output') from None
        yield
    finally:
        os.close(handle)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='demo', description='Key points on real frames.')
    parser.add_argument('--output', default='demo_output', metavar='FOLDER', help='default: %(default)s')
    parser.add_argument('--bag', metavar='FILE', help='a bag of your own')
    parser.add_argument('--topic', metavar='NAME', help='its image topic; not needed where there is only one')
    parser.add_argument('--view', action='store_true', help='show the images in a window meanwhile')
    return parser
