"""What more octaves cost: 1 to 5 of them against one."""

from __future__ import annotations

from benchmarks import images
from benchmarks.harness import SIZES, Report, in_turn
from rvc_features.harris_detector import HarrisDetector


def run(quick: bool) -> Report:
    report = Report('octaves', '500 key points out of 1 to 5 octaves', 'one octave', x_label='octaves')
    for size in ('VGA', '1080p'):
        image = images.picture(SIZES[size])
        contestants = {}
        for octaves in range(1, 6):
            detector = HarrisDetector(octaves=octaves, fixed_number_of_points=True)
            contestants[str(octaves)] = lambda detector=detector, image=image: detector.detect(image)
        times = in_turn(contestants, 9 if quick else 31)
        for octaves in range(1, 6):
            report.point(size, octaves, times[str(octaves)])
            if octaves > 1:
                reach = 1.6 if octaves == 4 else None
                report.compare(f'{size} {octaves} octaves', times, str(octaves), '1', reach)
    return report
