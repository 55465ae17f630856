"""Lines stay short and few, whatever comes, and nothing goes uncounted."""

import re

import pytest

from rvc_features.brief import Reporter, cut, shown


class Log:
    """Lines with the second in which each was written."""

    def __init__(self):
        self.now, self.lines = 0.0, []

    def write(self, line):
        self.lines.append((self.now, line))


@pytest.fixture
def log():
    return Log()


@pytest.fixture
def reporter(log):
    return Reporter(lambda: log.now)


def test_values_are_cut():
    assert shown('abc') == "'abc'"
    assert shown('x' * 20_000_000) == "'" + 'x' * 60 + "'... (20,000,000 characters)"
    assert shown(bytes(1000)).endswith('... (1,000 bytes)')
    assert shown(1e-310) == '1e-310'
    for value in ([list(range(1000))] * 1000, {str(i): 'y' * 1000 for i in range(1000)}, 10 ** 3000, object()):
        assert len(shown(value)) < 1000


def test_texts_are_cut_to_one_line_with_begin_and_end():
    assert cut('two\n lines ') == 'two lines'
    line = cut('begin ' + 'x\n' * 1_000_000 + ' end')
    assert len(line) <= 160
    assert line.startswith('begin x')
    assert line.endswith('x end')


def test_trouble_that_comes_alone_is_said_at_once(log, reporter):
    reporter.say(log.write, 'images', 'one')
    reporter.say(log.write, 'parameters', 'another')
    reporter.catch_up()
    assert log.lines == [(0.0, 'one'), (0.0, 'another')]


def test_constant_trouble_costs_a_few_lines_a_minute_and_each_case_is_counted(log, reporter):
    for frame in range(20 * 600):   # ten minutes at 20 Hz
        log.now = frame / 20
        reporter.say(log.write, 'images', f'image {frame} is bad: ' + 'x' * 1000)
        reporter.catch_up()
    log.now += 100
    reporter.catch_up()
    for begin in range(540):
        lines = [line for second, line in log.lines if begin <= second <= begin + 60]
        assert 1 <= len(lines) <= 2
        assert sum(map(len, lines)) <= 320
    more = sum(int(count.replace(',', '')) for _, line in log.lines
               for count in re.findall(r'and ([\d,]+) more in \d+ s', line))
    assert more + len(log.lines) == 20 * 600
    assert 'image 11999 is bad' in log.lines[-1][1]   # the last one too


def test_after_a_pause_it_is_said_at_once_again(log, reporter):
    for log.now in (0, 1, 11, 31, 200):
        reporter.say(log.write, 'images', f'at {log.now}')
    assert log.lines == [(0, 'at 0'), (11, 'at 11 (and 1 more in 11 s)'), (200, 'at 200 (and 1 more in 189 s)')]
    log.now = 266
    reporter.say(log.write, 'images', 'at 266')
    assert log.lines[-1] == (266, 'at 266')
