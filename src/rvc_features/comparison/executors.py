"""Where jobs run: in this process, in processes of this machine, or on a Dask cluster; `runner` sees an executor."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import connection
from typing import Any, Callable, Iterator


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


class SerialExecutor(Executor):
    """Runs a job at once, in this process: one worker without a second process."""

    def submit(self, function: Callable, *arguments: Any, **named: Any) -> Future:   # type: ignore[override]
        future: Future = Future()
        try:
            future.set_result(function(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


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
