"""Where jobs run: in this process, in processes of this machine, or on a Dask cluster; `runner` sees an executor."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import re
import signal
import threading
from concurrent.futures import BrokenExecutor, Executor, Future
from multiprocessing import connection
from queue import SimpleQueue
from typing import Any, Callable, Iterator

from rvc_features.brief import shown


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
    with SerialExecutor() if workers == 1 else WorkerProcesses(workers) as executor:
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


class WorkerProcesses(Executor):
    """Processes of this machine, each with a pipe and a thread of its own that sends one job after the other.

    Where one of them dies (for lack of memory, or killed), its job's future raises BrokenExecutor at once, which
    `concurrent.futures.ProcessPoolExecutor` of some Python versions waits for in vain while a large job is being sent.
    `shutdown` ends the processes whatever they do: who leaves before the results are there wants none of them.
    """

    def __init__(self, workers: int) -> None:
        self._jobs: SimpleQueue = SimpleQueue()
        self._processes = []
        self._threads = []
        context = multiprocessing.get_context('spawn')   # OpenCV's and Numba's threads don't survive a fork
        for _ in range(workers):
            ours, theirs = context.Pipe()
            process = context.Process(target=_work, args=(theirs,), daemon=True)
            process.start()
            theirs.close()   # or the end of the process would not end the pipe
            thread = threading.Thread(target=self._serve, args=(process, ours), daemon=True)
            thread.start()
            self._processes.append(process)
            self._threads.append(thread)

    def submit(self, function: Callable, *arguments: Any, **named: Any) -> Future:   # type: ignore[override]
        future: Future = Future()
        self._jobs.put((future, (function, arguments, named)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        for process in self._processes:
            process.kill()
        for _ in self._threads:
            self._jobs.put(None)
        for process in self._processes:
            process.join()

    def _serve(self, process: Any, pipe: connection.Connection) -> None:
        for future, job in iter(self._jobs.get, None):
            if not future.set_running_or_notify_cancel():
                continue
            try:
                pipe.send(job)
                result, error = pipe.recv()
            except (EOFError, OSError):
                process.join()
                future.set_exception(BrokenExecutor(_how_it_ended(process.exitcode)))
                return
            except Exception as failure:   # a job that can't be sent
                result, error = None, failure
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)


def _work(pipe: connection.Connection) -> None:
    """In each worker process: jobs from the pipe until it ends, which the parent's death may do at any time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)   # Ctrl-C is for the parent
    _end_with_the_parent()
    while True:
        try:
            function, arguments, named = pipe.recv()
        except (EOFError, ConnectionError):
            return
        answer: tuple[Any, Exception | None]
        try:
            answer = function(*arguments, **named), None
        except Exception as error:
            answer = None, error
        try:
            pipe.send(answer)
        except ConnectionError:
            return


def _end_with_the_parent() -> None:
    """End this process when its parent does, however that ended and whatever is being done here."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _how_it_ended(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        return f'ended by {signal.Signals(-exit_code).name}'
    return f'ended with status {exit_code}'


class DaskError(RuntimeError):
    """Dask is not installed, or its scheduler does not answer; the text says what to do."""


def _dask_client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise DaskError('--dask-scheduler needs Dask, which is not installed here: '
                        'python3 -m pip install "dask[distributed]"') from None
    if not _is_address(address):
        raise DaskError(f'{shown(address)} is no address of a Dask scheduler: write it as tcp://host:8786')
    try:
        client = Client(address, timeout=_DASK_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DaskError(f'no Dask scheduler answers at {address} ({error or type(error).__name__}); '
                        'start one with `dask scheduler` and give its address, such as tcp://host:8786') from None
    if not client.nthreads():
        client.close()
        raise DaskError(f'the Dask scheduler at {address} has no workers; start some with `dask worker {address}`')
    return client


def _is_address(text: str) -> bool:
    """Whether it is [protocol://]host:port; Dask takes anything, and talks of it in tracebacks after the end."""
    match = re.fullmatch(r'(?:[a-z]+://)?(?:[\w.-]+|\[[0-9a-fA-F:.]+\]):(\d{1,5})', text)
    return match is not None and 0 < int(match[1]) < 65536


_DASK_TIMEOUT = 10   # seconds
