"""Newest item wins; nothing is lost uncounted; the thread ends."""

import threading

from rvc_features.nodes.newest_worker import NewestWorker

SECONDS = 10   # far more than any of this takes


def test_newest_item_wins_while_the_worker_is_busy():
    begun, go_on, done, seen = threading.Event(), threading.Event(), threading.Event(), []

    def work(item):
        seen.append(item)
        begun.set()
        assert go_on.wait(SECONDS)
        if item == 'last':
            done.set()

    worker = NewestWorker(work)
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
    worker = NewestWorker(lambda item: seen.set())
    worker.put(None)
    assert seen.wait(SECONDS)
    worker.stop()


def test_stop_ends_the_thread():
    before = threading.active_count()
    worker = NewestWorker(lambda item: None)
    assert threading.active_count() == before + 1
    worker.stop()
    assert threading.active_count() == before
