"""Newest item wins; nothing is lost uncounted; the thread ends."""

import gc
import sys
import threading
import time
import weakref

import pytest

from rvc_features.nodes.newest_worker import NewestWorker

SECONDS = 10   # far more than any of this takes


def fail(error):
    raise error


def test_newest_item_wins_while_the_worker_is_busy():
    begun, go_on, done, seen = threading.Event(), threading.Event(), threading.Event(), []

    def work(item):
        seen.append(item)
        begun.set()
        assert go_on.wait(SECONDS)
        if item == 'last':
            done.set()

    worker = NewestWorker(work, fail)
    worker.put('first')
    assert begun.wait(SECONDS)
    for item in (1, 2, 3, 'last'):
        worker.put(item)
    go_on.set()
    assert done.wait(SECONDS)
    worker.stop()
    assert seen == ['first', 'last']
    assert (worker.received, worker.dropped) == (5, 3)


def test_an_item_may_be_none():
    seen = threading.Event()
    worker = NewestWorker(lambda item: seen.set(), fail)
    worker.put(None)
    assert seen.wait(SECONDS)
    worker.stop()


def test_stop_ends_the_thread():
    before = threading.active_count()
    worker = NewestWorker(lambda item: None, fail)
    assert threading.active_count() == before + 1
    worker.stop()
    assert threading.active_count() == before


@pytest.mark.parametrize('way_to_fail', [lambda item: 1 / 0, sys.exit, lambda item: memoryview(b'').cast('Q')[item]])
def test_whatever_the_work_raises_the_thread_goes_on(way_to_fail):
    errors, done = [], threading.Event()

    def failed(error):
        errors.append(error)
        done.set()

    worker = NewestWorker(way_to_fail, failed)
    for count in (1, 2):
        done.clear()
        worker.put(5)
        assert done.wait(SECONDS)
        assert len(errors) == count
        assert isinstance(errors[-1], (ZeroDivisionError, SystemExit, IndexError))
    worker.stop()


def test_an_item_is_let_go_when_its_work_is_done():
    class Large:
        pass

    item, done = Large(), threading.Event()
    gone = weakref.ref(item, lambda reference: done.set())
    worker = NewestWorker(lambda item: None, fail)
    gc.disable()
    try:
        worker.put(item)
        del item
        assert done.wait(SECONDS)
    finally:
        gc.enable()
    assert gone() is None
    worker.stop()


def test_how_long_an_item_has_been_at_work():
    begun, go_on = threading.Event(), threading.Event()

    def work(item):
        begun.set()
        assert go_on.wait(SECONDS)

    worker = NewestWorker(work, fail)
    assert worker.busy_since is None
    before = time.monotonic()
    worker.put(1)
    assert begun.wait(SECONDS)
    assert before <= worker.busy_since <= time.monotonic()
    go_on.set()
    worker.stop()
    assert worker.busy_since is None


def test_a_worker_that_hangs_is_replaced_and_what_it_brings_later_is_not_wanted():
    gate, begun, late, seen, ended = (threading.Event(), threading.Event(), threading.Event(), [], threading.Event())

    def work(item):
        if item == 'hangs':
            begun.set()
            assert gate.wait(SECONDS)
            late.set()
            worker.check()
            seen.append('late')   # never
        seen.append(item)
        ended.set()

    worker = NewestWorker(work, fail)
    worker.put('hangs')
    assert begun.wait(SECONDS)
    assert worker.busy_since is not None
    assert worker.renew()
    assert (worker.busy_since, worker.abandoned()) == (None, 1)
    worker.put('next')
    assert ended.wait(SECONDS)
    gate.set()
    assert late.wait(SECONDS)
    deadline = time.monotonic() + SECONDS
    while worker.abandoned():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    worker.check()   # anybody else's thread
    worker.stop()
    assert seen == ['next']
    assert worker.busy_since is None


def test_only_so_many_threads_are_given_up():
    gate, begun = threading.Event(), threading.Semaphore(0)

    def work(item):
        begun.release()
        gate.wait(SECONDS)

    worker = NewestWorker(work, fail)
    for _ in range(3):
        worker.put('hangs')
        assert begun.acquire(timeout=SECONDS)
        assert worker.renew()
    worker.put('hangs')
    assert begun.acquire(timeout=SECONDS)
    assert not worker.renew()
    assert worker.abandoned() == 3
    gate.set()
    worker.stop()
