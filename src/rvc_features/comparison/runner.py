"""Jobs through an executor; each result is a file of its own, so that an interrupted comparison goes on.

The report is made of these files alone. A file appears whole or not at all (`os.replace`), under a name that says what
it is the result of (`pair_task.key`): whatever changes, images, settings or code, is measured anew, and only that.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from multiprocessing import connection
from typing import Any, Callable, Iterator, Sequence

from tqdm import tqdm

from rvc_features.comparison import pair_task
from rvc_features.comparison.datasets import Dataset, Pair
from rvc_features.comparison.pair_task import Settings


@dataclasses.dataclass(frozen=True)
class Measured:
    """A pair without its images, and what was measured on it."""

    dataset: str
    group: str
    name: str
    change: float | None
    note: str
    shape: tuple[int, int]
    result: dict[str, Any]


class Store:
    """Results in a folder, one JSON file each."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        os.makedirs(folder, exist_ok=True)

    def load(self, key: str) -> dict[str, Any] | None:
        """The result, or None where there is none or only a damaged file."""
        try:
            with open(self._path(key), encoding='utf-8') as file:
                content = json.load(file)
        except (OSError, ValueError):
            return None
        return content['result'] if isinstance(content, dict) and content.get('key') == key else None

    def save(self, key: str, result: dict[str, Any]) -> None:
        write_whole(self._path(key), json.dumps({'key': key, 'result': result}))

    def _path(self, key: str) -> str:
        return os.path.join(self.folder, f'{key}.json')


def write_whole(path: str, content: str | bytes) -> None:
    """Write a file so that at any moment there is the old one or the new one, never half of one."""
    data = content.encode() if isinstance(content, str) else content
    handle, temporary = tempfile.mkstemp(prefix='.', suffix='.part', dir=os.path.dirname(path) or '.')
    try:
        with os.fdopen(handle, 'wb') as file:
            file.write(data)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)   # mkstemp's files are for the owner alone
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


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
        for future in futures:
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
                                        (height, width), {})))
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


class SerialExecutor(Executor):
    """Runs a job at once, in this process: one worker without a second process."""

    def submit(self, function: Callable, *arguments: Any, **named: Any) -> Future:   # type: ignore[override]
        future: Future = Future()
        try:
            future.set_result(function(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


@contextlib.contextmanager
def executor_for(workers: int, dask_scheduler: str | None) -> Iterator[tuple[Executor, int]]:
    """An executor and how many jobs it runs at the same time; shut down at the end.

    Parameters
    ----------
    workers : int
        Processes on this machine; none beside this one for a single worker.
    dask_scheduler : str, optional
        Address of a Dask scheduler whose workers are taken instead.

    Raises
    ------
    DaskError
    """
    if dask_scheduler:
        with _dask_client(dask_scheduler) as client:
            # `pure=False`: equal jobs are told apart by us already, and hashing the images twice would cost time.
            yield client.get_executor(pure=False), sum(client.nthreads().values())
        return
    # Spawned, not forked: OpenCV's and Numba's threads don't survive a fork.
    executor = SerialExecutor() if workers == 1 else \
        ProcessPoolExecutor(workers, multiprocessing.get_context('spawn'), _start_worker)
    with executor:
        yield executor, workers


class DaskError(RuntimeError):
    """Dask is not installed, or its scheduler does not answer; the text says what to do."""


def _dask_client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise DaskError('--dask-scheduler needs Dask, which is not installed here: '
                        'python3 -m pip install "dask[distributed]"') from None
    try:
        client = Client(address, timeout=_DASK_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DaskError(f'no Dask scheduler answers at {address} ({error or type(error).__name__}); '
                        'start one with `dask scheduler` and give its address, such as tcp://host:8786') from None
    if not client.nthreads():
        client.close()
        raise DaskError(f'the Dask scheduler at {address} has no workers; start some with `dask worker {address}`')
    return client


_DASK_TIMEOUT = 10   # seconds


def _start_worker() -> None:
    """In each worker process: leave Ctrl-C to the parent, and end when the parent does, however it ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


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
        self.bar = tqdm(total=total, unit='pair', file=self.stream) if self.stream.isatty() else None
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
            self.stream.write(f'{self.done} of {self.total or "an unknown number of"} pairs; {text}\n')
            self.stream.flush()

    def close(self) -> None:
        if self.bar is not None:
            self.bar.close()
