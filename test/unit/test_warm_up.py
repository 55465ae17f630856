"""After the warm-up nothing is left to compile: not at a first frame, and not where what is compiled can't be kept."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

pytest.importorskip('numba')

from rvc_features import kernels
from rvc_features.kernels import compiler

if not compiler.available():
    pytest.skip('kernels are turned off', allow_module_level=True)

WORK = '''
    import itertools, sys
    import numpy as np
    from rvc_features import presets
    from rvc_features.drawing import draw_key_points
    from rvc_features.feature_detector import as_grey
    from rvc_features.harris_detector import HarrisDetector
    from rvc_features.kernels import warm_up

    warm_up.compile_all()

    def variants():
        """All that is compiled or loaded, by the name of the kernel."""
        return {f'{module.__name__}.{name}{signature}' for module in list(sys.modules.values())
                if module.__name__.startswith('rvc_features')
                for name, value in vars(module).items() for signature in getattr(value, 'signatures', ())}

    known = variants()
    random = np.random.default_rng(0)
    blocks = np.kron(random.integers(0, 256, (9, 12, 3)), np.ones((8, 8, 1))).astype(np.uint8)
    images = [np.ascontiguousarray(blocks), random.integers(0, 256, (72, 96, 3), np.uint8)]
    options = {'strength': ('two_scales', 'harris'), 'window': ('box', 'gaussian'), 'window_size': (3, 5, 7, 31),
               'evenness': (0.0, 0.5), 'anms': (False, True), 'fixed_number_of_points': (False, True)}
    settings = [presets.values(name) for name in presets.names()] + [{'octaves': 3}, {'subpixel': False}]
    settings += [dict(zip(options, values)) for values in itertools.product(*options.values())]
    for values in settings:
        detector = HarrisDetector(**values)
        for image in images:
            grey = as_grey(image)
            detector.detect_arrays(grey, grey > 50)
            found = detector.detect_arrays(grey)
            draw_key_points(image.copy(), found)
            draw_key_points(grey, found)
        new = variants() - known
        if new:
            print(values, *sorted(new), sep='\\n    ')
            known |= new
'''


@pytest.mark.slow
def test_no_image_of_a_camera_needs_a_kernel_that_the_warm_up_left_out():
    source = str(Path(kernels.__file__).parents[2])
    result = subprocess.run([sys.executable, '-c', textwrap.dedent(WORK)], capture_output=True, text=True,
                            env={**os.environ, 'PYTHONPATH': source}, check=True)
    assert result.stdout == ''
