"""One comparison, from the options of the command line to the report."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from concurrent.futures import BrokenExecutor

from rvc_features.command_line import BAD_INPUT, FAILED, Interrupted, quiet_opencv, signals_as_exceptions
from rvc_features.comparison import contestants, executors, inputs, report, runner, sequences, summary, text_tables
from rvc_features.comparison.contestants import Contestant, ContestantError
from rvc_features.comparison.datasets import Dataset, Options, with_distinct_names
from rvc_features.comparison.executors import DaskError
from rvc_features.comparison.pair_task import Settings
from rvc_features.comparison.results import Store
from rvc_features.comparison.runner import Progress
from rvc_features.odometry.masks import MaskError
from rvc_features.odometry.masks import parse as parse_mask
from rvc_features.recordings.regular_files import SourceError


def compare(given: argparse.Namespace) -> int:
    """Compare as `given` (the parsed options of `command`) says; the exit status. What goes wrong is told on stderr."""
    quiet_opencv()
    try:
        with signals_as_exceptions():
            _compare(given)
            return 0
    except (SourceError, ContestantError, DaskError) as error:
        said, status = str(error), BAD_INPUT
    except BrokenExecutor as error:
        said, status = (f'a worker process has died, perhaps for lack of memory ({error}); the same command goes on '
                        'from there, with fewer --workers if need be.'), FAILED
    except OSError as error:
        said, status = f'{error.filename or given.output}: {error.strerror or error}', FAILED
    except Interrupted as interruption:
        said, status = (f'stopped; what is measured is kept in {given.output}, and the same command goes on from '
                        'there.'), interruption.status
    print(f'compare_detectors: {said}', file=sys.stderr)
    return status


def _compare(given: argparse.Namespace) -> None:
    for module in given.import_:
        _import(module)
    try:
        parse_mask(given.mask)
    except MaskError as error:
        raise ContestantError(f'--mask: {error}') from None
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
                            tuple(given.import_), given.mask)
        progress = Progress(runner.total_of(chosen))
        try:
            measured = runner.run(chosen, settings, store, executor, progress, gallery.look)
        finally:
            progress.close()
    if not measured:
        raise SourceError('there is no image to compare on; give one, or no input at all for a built-in photograph')

    made = summary.sections(measured, chosen, [contestant.label for contestant in group], settings.epsilons,
                            settings.points, settings.seed)
    paths = report.write(given.output, given.title, made, measured, chosen, group, settings, gallery,
                         given.command)
    print(text_tables.as_text(made))
    print('Wrote ' + ', '.join(paths))


def _contestants(given: argparse.Namespace) -> list[Contestant]:
    chosen = []
    for path in given.detectors_from:
        chosen += contestants.read_yaml(path, given.points)
    chosen += [contestants.parse(text, given.points) for text in given.detector]
    return contestants.with_distinct_labels(chosen or contestants.standard_choice(given.points))


def _datasets(given: argparse.Namespace) -> list[Dataset]:
    options = Options(given.kind, given.topic, given.every, given.maximum_frames, given.crop_identity, given.seed)
    chosen = inputs.open_inputs(given.input, options)
    chosen += [sequences.single_pair(first, second, homography, options) for first, second, homography in given.pair]
    chosen += [inputs.synthetic(path, options) for path in given.photograph]
    if given.examples or (given.or_examples and not chosen):
        chosen += inputs.examples(options)
    return with_distinct_names(chosen or [inputs.synthetic(None, options)])


def _import(module: str) -> None:
    """Import a module that registers the user's own detectors."""
    sys.path.insert(0, os.getcwd())
    try:
        importlib.import_module(module)
    except Exception as error:
        raise ContestantError(f'--import {module}: {type(error).__name__}: {error}; it must be a module that Python '
                              'finds, here or on PYTHONPATH') from None

