"""Charts as SVG text, to stand in the page itself: nothing to load, sharp at any size, values under the pointer."""

from __future__ import annotations

import math
from html import escape
from typing import Sequence, Tuple

from rvc_features.comparison.summary import Curve

# Okabe and Ito's colours, told apart by colour-blind readers too; after the last they start over, with dashes.
COLOURS = '#0072b2', '#d55e00', '#009e73', '#cc79a7', '#56b4e9', '#e69f00', '#5b4bb3', '#7a7a7a'
DASHES = '', '6 3', '2 3'

WIDTH, HEIGHT = 400, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 14, 30, 44   # margins


def colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def legend(labels: Sequence[str]) -> str:
    """Labels with their colours, for all charts below it."""
    items = []
    for number, label in enumerate(labels):
        items.append(f'<span class="key"><svg width="26" height="10" aria-hidden="true"><line x1="0" y1="5" x2="26" '
                     f'y2="5" {_stroke(number)}/></svg> {escape(label)}</span>')
    return f'<p class="legend">{"".join(items)}</p>'


def lines(curve: Curve, labels: Sequence[str], evenly: bool) -> str:
    """Shares from 0 to 1 over what changes; `evenly` puts the steps of x at equal distances, in their order."""
    x_values = list(range(len(curve.x))) if evenly else list(curve.x)
    low, high = (min(x_values), max(x_values)) if evenly else (0.0, max(x_values))

    def x_of(value: float) -> float:
        return _LEFT + (value - low) / ((high - low) or 1) * (WIDTH - _LEFT - _RIGHT)

    def y_of(value: float) -> float:
        return HEIGHT - _BOTTOM - value * (HEIGHT - _TOP - _BOTTOM)

    parts = _frame(curve.title, curve.x_title, '')
    for tick in (0, 0.25, 0.5, 0.75, 1):
        parts.append(_grid(y_of(tick), f'{tick:g}'))
    for value, text in zip(x_values, curve.x_labels):
        parts.append(_tick(x_of(value), text))
    if any(value is not None for value in curve.chance):
        parts.append(_path([(x_of(x), y_of(y)) for x, y in zip(x_values, curve.chance) if y is not None],
                           'stroke="#999" stroke-width="1.5" stroke-dasharray="1 4"', 'chance level'))
    for number, (label, line) in enumerate(zip(labels, curve.lines)):
        known = [(x, text, y) for x, text, y in zip(x_values, curve.x_labels, line) if y is not None]
        parts.append(_path([(x_of(x), y_of(y)) for x, _, y in known], _stroke(number), label))
        parts += [_dot(x_of(x), y_of(y), 3, number, f'{label}: {y:.3f} at {text}') for x, text, y in known]
    return _svg(parts, curve.title)


Times = Sequence[Sequence[Tuple[float, float]]]   # by detector: points found, milliseconds


def times(points: Times, sweeps: Times, labels: Sequence[str]) -> str:
    """Milliseconds over points found.

    A line for one image and rising numbers of points, a faint dot for each other image, and a large one for the
    median of a detector.
    """
    drawn = [_evenly_chosen(each, _MOST_DOTS) for each in points]
    everything = [point for each in (*drawn, *sweeps) for point in each if point[1] > 0]
    if not everything:
        return ''
    least, most = (choose(ms for _, ms in everything) for choose in (min, max))
    bottom, top = math.floor(math.log10(least) * 3) / 3, math.ceil(math.log10(most) * 3) / 3
    widest = _round_up(max(found for found, _ in everything) * 1.04 or 1)

    def x_of(found: float) -> float:
        return _LEFT + found / widest * (WIDTH - _LEFT - _RIGHT)

    def y_of(ms: float) -> float:
        return HEIGHT - _BOTTOM - (math.log10(ms) - bottom) / ((top - bottom) or 1) * (HEIGHT - _TOP - _BOTTOM)

    parts = _frame('time against points', 'points found in the image', 'ms, logarithmic')
    for tick in _logarithmic_ticks(bottom, top):
        parts.append(_grid(y_of(tick), f'{tick:g}'))
    for i in range(5):
        parts.append(_tick(x_of(widest * i / 4), f'{widest * i / 4:g}'))
    for number, sweep in enumerate(sweeps):
        ordered = sorted(sweep)
        parts.append(_path([(x_of(found), y_of(ms)) for found, ms in ordered if ms > 0], _stroke(number),
                           labels[number]))
    for number, dots in enumerate(drawn):
        parts += [_dot(x_of(found), y_of(ms), 2, number, '', 0.3) for found, ms in dots if ms > 0]
    for number, (label, each) in enumerate(zip(labels, points)):
        if each:
            found, ms = (_middle([point[i] for point in each]) for i in (0, 1))
            if ms > 0:
                parts.append(_dot(x_of(found), y_of(ms), 6, number, f'{label}: {found:.0f} points, {ms:.2f} ms'))
    return _svg(parts, 'time against points')


_MOST_DOTS = 60   # for each detector


def _svg(parts: Sequence[str], title: str) -> str:
    return (f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">'
            f'{"".join(parts)}</svg>')


def _frame(title: str, x_title: str, y_title: str) -> list[str]:
    middle = (_LEFT + WIDTH - _RIGHT) / 2
    parts = [f'<text x="{_LEFT}" y="15" class="title">{escape(title)}</text>',
             f'<text x="{middle:.0f}" y="{HEIGHT - 6}" text-anchor="middle">{escape(x_title)}</text>']
    if y_title:
        parts.append(f'<text x="{WIDTH - _RIGHT}" y="15" text-anchor="end">{escape(y_title)}</text>')
    return parts


def _grid(y: float, text: str) -> str:
    return (f'<line x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e4e4e4"/>'
            f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')


def _tick(x: float, text: str) -> str:
    return f'<text x="{x:.1f}" y="{HEIGHT - _BOTTOM + 16}" text-anchor="middle">{escape(text)}</text>'


def _path(points: Sequence[tuple[float, float]], stroke: str, title: str) -> str:
    places = ' '.join(f'{x:.1f},{y:.1f}' for x, y in points)
    return f'<polyline points="{places}" fill="none" {stroke}><title>{escape(title)}</title></polyline>'


def _dot(x: float, y: float, radius: float, number: int, title: str, opacity: float = 1) -> str:
    inner = f'<title>{escape(title)}</title>' if title else ''
    faint = f' opacity="{opacity:g}"' if opacity < 1 else ''
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{colour(number)}"{faint}>{inner}</circle>'


def _stroke(number: int) -> str:
    dash = DASHES[number // len(COLOURS) % len(DASHES)]
    return f'stroke="{colour(number)}" stroke-width="2"' + (f' stroke-dasharray="{dash}"' if dash else '')


def _logarithmic_ticks(bottom: float, top: float) -> list[float]:
    ticks = [digit * 10.0 ** power for power in range(math.floor(bottom), math.ceil(top) + 1) for digit in (1, 2, 5)]
    return [tick for tick in ticks if bottom - 1e-9 <= math.log10(tick) <= top + 1e-9]


def _round_up(value: float) -> float:
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 1.2, 1.6, 2, 2.4, 3, 4, 6, 8, 10) if step * power >= value)


def _evenly_chosen(values: Sequence[tuple[float, float]], most: int) -> list[tuple[float, float]]:
    if len(values) <= most:
        return list(values)
    return [values[i * (len(values) - 1) // (most - 1)] for i in range(most)]


def _middle(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]
