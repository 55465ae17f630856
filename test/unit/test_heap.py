"""Memory that large frames took is given back when smaller ones come, and not before."""

import ctypes
import gc
import subprocess
import sys
from pathlib import Path

import pytest

from rvc_features import heap

SOURCES = Path(__file__).resolve().parents[2] / 'src'


@pytest.fixture
def calls(monkeypatch):
    """What is asked of the C library, in place of it."""
    calls = []
    monkeypatch.setattr(heap, 'keep_large_blocks', lambda size=0: calls.append(size) or True)
    monkeypatch.setattr(heap, 'give_back', lambda: calls.append('give back'))
    return calls


def test_what_is_kept_grows_at_once_and_shrinks_after_fifty_smaller_frames(calls):
    frames = heap.FrameHeap()
    frames.note(1_000_000)
    frames.note(900_000)
    frames.note(25_000_000)
    for _ in range(49):
        frames.note(1_000_000)
    assert calls == [1_000_000, 25_000_000]
    frames.note(900_000)
    assert calls[2:] == [1_000_000, 'give back']
    for _ in range(200):
        frames.note(1_000_000)
    assert len(calls) == 4


def test_large_frames_now_and_then_keep_what_they_need(calls):
    frames = heap.FrameHeap()
    for _ in range(20):
        frames.note(25_000_000)
        for _ in range(40):
            frames.note(1_000)
    assert calls == [25_000_000]


def test_tidying_gives_back_what_no_frame_accounts_for(calls, monkeypatch):
    resident, now = [100 << 20], [1000.0]
    monkeypatch.setattr(heap, 'resident_bytes', lambda: resident[0])
    monkeypatch.setattr(heap.time, 'monotonic', lambda: now[0])
    frames = heap.FrameHeap()
    frames.tidy()
    assert calls == []
    resident[0] = 600 << 20
    frames.tidy()
    assert calls == ['give back']
    frames.tidy()   # it is in use, then: not again at once, until there is more
    assert calls == ['give back']
    resident[0] = 900 << 20
    frames.tidy()
    assert calls == ['give back'] * 2


def test_what_was_in_use_at_a_peak_is_given_back_afterwards(calls, monkeypatch):
    """140 MB stayed for good, which nothing but the next peak would have found."""
    resident, now = [100 << 20], [1000.0]
    monkeypatch.setattr(heap, 'resident_bytes', lambda: resident[0])
    monkeypatch.setattr(heap.time, 'monotonic', lambda: now[0])
    frames = heap.FrameHeap()
    resident[0] = 300 << 20
    for _ in range(60):   # seconds, of which none brings anything new
        frames.tidy()
        now[0] += 1
    assert 18 <= len(calls) <= 30, 'every few seconds: it may be free at any time, and was kept for minutes once'
    resident[0] = 110 << 20   # as the last of them found
    calls.clear()
    for _ in range(60):
        frames.tidy()
        now[0] += 1
    assert calls == []


GROWS_AND_SHRINKS = '''
from rvc_features import heap
import numpy as np
heap.keep_large_blocks()
frames = heap.FrameHeap()
frames.note(1000)
before = heap.resident_bytes()
frames.note(20_000_000)
blocks = [np.ones(20_000_000, np.uint8) for _ in range(10)]
last = np.ones(1000, np.uint8)   # at the end of the heap, where it holds all the rest
del blocks
kept = heap.resident_bytes() - before
for _ in range(50):
    frames.note(1000)
print(kept, heap.resident_bytes() - before)
'''


def test_in_a_process_of_its_own_memory_really_goes_down():
    if heap._c_function('malloc_trim') is None or not hasattr(ctypes.CDLL(None), 'mallopt'):
        pytest.skip('not glibc')
    result = subprocess.run([sys.executable, '-c', GROWS_AND_SHRINKS], capture_output=True, text=True, timeout=60,
                            env={'PYTHONPATH': str(SOURCES)}, check=True)
    kept, after = map(int, result.stdout.split())
    assert kept > 190e6
    assert after < 20e6


def test_resident_bytes_are_those_of_this_process():
    assert 5e6 < heap.resident_bytes() < 1e11


def test_what_is_there_when_all_is_loaded_is_not_looked_through_for_garbage():
    kept = [[number] for number in range(10_000)]
    gc.disable()
    try:
        heap.settle()
        assert gc.isenabled()
        assert gc.get_freeze_count() > len(kept)
        assert len(gc.get_objects()) < 1000
    finally:
        gc.enable()
        gc.unfreeze()
