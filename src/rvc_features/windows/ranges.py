"""What a slider's positions mean: whole steps from 0 to `steps`, each a value that reads well (no Tk here)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

_STEPS = 200            # about as many as a slider has pixels
_MOST_WHOLE = 5000      # of whole numbers: up to here each is a step of its own
_BOUNDLESS = 2 ** 31 - 1
_WIDE = 1000            # times the default: from here on the positions are spread over the orders of magnitude


@dataclass(frozen=True)
class Range:
    """The values of one number; `steps` is 0 where it has no bounds and so no slider."""

    low: float
    high: float
    step: float
    steps: int
    whole: bool
    logarithmic: bool = False

    def value(self, position: float) -> Any:
        """The value at a position of the slider."""
        position = min(max(round(position), 0), self.steps)
        if not self.logarithmic:
            number = self.low + position * self.step
        else:
            share = (position - 1) / (self.steps - 1)
            number = _two_digits(self.step * (self.high / self.step) ** share) if position else 0.0
        number = min(number, self.high)
        return round(number) if self.whole else round(number, 10)

    def position(self, value: float) -> int:
        """The position of the slider nearest to a value."""
        if not self.steps:
            return 0
        if not self.logarithmic:
            position = (value - self.low) / self.step
        elif value < self.step:
            position = 0
        else:
            position = 1 + (self.steps - 1) * math.log(value / self.step) / math.log(self.high / self.step)
        return min(max(round(position), 0), self.steps)

    def read(self, text: str) -> Any:
        """The value that somebody typed; ValueError with what is accepted."""
        try:
            value = int(text) if self.whole else float(text)
        except ValueError:
            raise ValueError(f'{"a whole number" if self.whole else "a number"} is wanted; got {text!r}') from None
        if not self.low <= value <= self.high:   # NaN, too
            raise ValueError(f'{self.low:g} to {self.high:g} is accepted; got {text}')
        return value


def of_number(low: float, high: float, default: float, whole: bool) -> Range:
    """The range of a number as dynamic_reconfigure describes it."""
    bounded = math.isfinite(low) and math.isfinite(high) and -_BOUNDLESS <= low < high < _BOUNDLESS
    if not bounded:
        return Range(low, high, 1, 0, whole)
    if whole and high - low <= _MOST_WHOLE:
        return Range(low, high, 1, round(high - low), True)
    if low >= 0 and 0 < default * _WIDE < high:
        return Range(low, high, max(default / _WIDE, low, 1 if whole else 0), _STEPS, whole, logarithmic=True)
    step = _good_step((high - low) / _STEPS)
    step = max(1, round(step)) if whole else step
    return Range(low, high, step, math.ceil(round((high - low) / step, 6)), whole)


def _good_step(step: float) -> float:
    """The greatest of 1, 2 and 5 times a power of ten that is not above `step`."""
    power = 10.0 ** math.floor(math.log10(step))
    return power * max(factor for factor in (1, 2, 5) if factor * power <= step * (1 + 1e-9))


def _two_digits(number: float) -> float:
    return float(f'{number:.2g}')
