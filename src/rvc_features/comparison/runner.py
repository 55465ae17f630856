"""Pairs through an executor. What has a result on disk is not measured again; the report is made of results alone."""

from __future__ import annotations

import dataclasses
import sys
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any, Callable, Iterator, Sequence

from rvc_features.comparison import pair_task
from rvc_features.comparison.datasets import Dataset, Pair
from rvc_features.comparison.pair_task import Settings
from rvc_features.comparison.results import Measured, Store


def run(datasets: Sequence[Dataset], settings: Settings, store: Store, executor: Executor,
        progress: Progress, look: Callable[[Dataset, Pair], None] = lambda dataset, pair: None) -> list[Measured]:
    """Measure what has no result yet, and return all results in the order of the data.

    Images are read here, one pair after the other and only a few ahead of the workers, and travel with the job: the
    workers need no access to the files, and a long recording needs no memory.

    Parameters
    ----------
    look
        Called with every pair as it comes by.
    """
    order: list[tuple[str, Measured]] = []
    results: dict[str, dict[str, Any]] = {}
    under_way: dict[Future, str] = {}

    def collect(futures: Sequence[Future], dataset: Dataset) -> None:
        # What has failed comes last, so that no result beside it is lost.
        for future in sorted(futures, key=lambda each: each.exception() is not None):
            key = under_way.pop(future)
            results[key] = future.result()
            store.save(key, results[key])
            progress.step(dataset, False)

    dataset: Dataset
    try:
        for dataset, pair in _all_pairs(datasets):
            look(dataset, pair)
            key = pair_task.key(pair, settings)
            height, width = pair.first.shape
            order.append((key, Measured(dataset.name, pair.group, pair.name, pair.change, pair.note,
                                        (height, width), pair.second is not None, {})))
            if key in results or key in under_way.values():
                continue
            saved = store.load(key)
            if saved is not None:
                results[key] = saved
                progress.step(dataset, True)
                continue
            under_way[executor.submit(pair_task.measure, pair, settings)] = key
            collect([future for future in under_way if future.done()], dataset)
            if len(under_way) >= 2 * settings.concurrent + 2:
                collect(list(wait(under_way, return_when=FIRST_COMPLETED).done), dataset)
        while under_way:
            collect(list(wait(under_way, return_when=FIRST_COMPLETED).done), dataset)
    except BaseException:
        for future in under_way:
            future.cancel()
        raise
    return [dataclasses.replace(measured, result=results[key]) for key, measured in order]


def _all_pairs(datasets: Sequence[Dataset]) -> Iterator[tuple[Dataset, Pair]]:
    for dataset in datasets:
        for number, pair in enumerate(dataset.pairs()):
            yield dataset, dataclasses.replace(pair, sweep=number == 0)


def total_of(datasets: Sequence[Dataset]) -> int | None:
    counts = [dataset.count for dataset in datasets]
    return None if None in counts else sum(count for count in counts if count is not None)


class Progress:
    """A bar on a terminal; elsewhere a line for each tenth of the work."""

    def __init__(self, total: int | None, stream: Any = None) -> None:
        self.total = total
        self.reused = 0
        self.stream = sys.stderr if stream is None else stream
        self.bar = _bar(total, self.stream) if self.stream.isatty() else None
        self.done = 0

    def step(self, dataset: Dataset, reused: bool) -> None:
        """One more result is there; `reused`: from before."""
        self.done += 1
        self.reused += reused
        text = dataset.name + (f', {self.reused} from before' if self.reused else '')
        if self.bar is not None:
            self.bar.set_postfix_str(text, refresh=False)
            self.bar.update()
        elif self.done * 10 // (self.total or 1000) > (self.done - 1) * 10 // (self.total or 1000):
            self.stream.write(f'{self.done} of {self.total or "an unknown number"} measured; {text}\n')
            self.stream.flush()

    def close(self) -> None:
        if self.bar is not None:
            self.bar.close()


def _bar(total: int | None, stream: Any) -> Any:
    try:
        from tqdm import tqdm
    except ImportError:    # then there are lines, as where there is no terminal
        return None
    return tqdm(total=total, unit='job', file=stream)
