"""The main job on real frames: plays a bag into the node, turns parameters meanwhile, and keeps what comes out.

    rosrun rvc_features demo [--output FOLDER] [--bag FILE [--topic NAME]] [--view]

Leaves in the output folder: the bags that were played (where it made them), output.bag with what the node published,
annotated.avi, and contact_sheet.png with a frame for each setting. Everything runs under a master of its own.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Sequence

import cv2

from rvc_features.demo.play import play
from rvc_features.demo.results import contact_sheet, summary
from rvc_features.demo.scenes import DemoError, own_bag, real_frames
from rvc_features.recordings.image_sources import SourceError


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    output = Path(options.output)
    try:
        output.mkdir(parents=True, exist_ok=True)
        scenes, topic = own_bag(options.bag, options.topic) if options.bag else real_frames(output)
        phases = play(scenes, topic, output, options.view)
    except (SourceError, DemoError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 2
    cv2.imwrite(str(output / 'contact_sheet.png'), contact_sheet(phases))
    table = summary(phases)
    (output / 'summary.txt').write_text(table + '\n')
    print(f'\n{table}\n\nIn {output}: contact_sheet.png, annotated.avi, output.bag, summary.txt')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='demo', description='Key points on real frames.')
    parser.add_argument('--output', default='demo_output', metavar='FOLDER', help='default: %(default)s')
    parser.add_argument('--bag', metavar='FILE', help='a bag of your own')
    parser.add_argument('--topic', metavar='NAME', help='its image topic; not needed where there is only one')
    parser.add_argument('--view', action='store_true', help='show the images in a window meanwhile')
    return parser
