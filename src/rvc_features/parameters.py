"""What a detector's parameters may be: each one declares its kind and range once, and everything else follows.

A detector is a frozen dataclass; each field is a `parameter` with a default and a specification (Integer, Real, Flag
or Choice). `validate` checks an instance against them and says in its error what was given and what is accepted.
`Specification.nearest` maps any value, however odd, to the nearest accepted one: what a slider or a launch file gives
is treated that way, what a programmer writes is not.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from rvc_features.brief import shown


@dataclasses.dataclass(frozen=True)
class Specification:
    """Base of the four kinds; `description` is one plain sentence, shown as tooltip and in error texts."""

    description: str

    def accepted(self) -> str:
        """What is accepted, in words that finish the sentence "must be ..."."""
        raise NotImplementedError

    def checked(self, value: Any) -> Any:
        """`value` as a plain Python object of the right type; TypeError or ValueError where it isn't one."""
        raise NotImplementedError

    def nearest(self, value: Any, previous: Any) -> Any:
        """The accepted value nearest to `value`, coming from `previous`; ValueError where there is none."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class Integer(Specification):
    low: int
    high: int | None = None
    odd: bool = False

    def accepted(self) -> str:
        kind = 'an odd integer' if self.odd else 'an integer'
        return f'{kind} of at least {self.low}' if self.high is None else f'{kind} from {self.low} to {self.high}'

    def checked(self, value: Any) -> int:
        if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
            raise TypeError(self.accepted())
        if value < self.low or (self.high is not None and value > self.high) or (self.odd and value % 2 == 0):
            raise ValueError(self.accepted())
        return int(value)

    def nearest(self, value: Any, previous: Any) -> int:
        given = _finite(value)
        if not self.odd:
            number = round(given)
        elif given % 2 == 0:
            # In the direction of the change: a slider that goes 13, 12 must arrive at 11, not stick at 13.
            number = int(given) + (-1 if given < previous else 1)
        else:
            number = 2 * round((given - 1) / 2) + 1
        number = max(number, self.low)
        return number if self.high is None else min(number, self.high)


@dataclasses.dataclass(frozen=True)
class Real(Specification):
    low: float
    high: float = math.inf
    above_low: bool = False   # low itself is not accepted

    def accepted(self) -> str:
        low = f'above {self.low:g}' if self.above_low else f'of at least {self.low:g}'
        return f'a finite number {low}' if self.high == math.inf else f'a finite number {low}, at most {self.high:g}'

    def checked(self, value: Any) -> float:
        if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.integer, np.floating)):
            raise TypeError(self.accepted())
        if not math.isfinite(value) or value < self.low or value > self.high or (self.above_low and value == self.low):
            raise ValueError(self.accepted())
        return float(value)

    def nearest(self, value: Any, previous: Any) -> float:
        number = float(min(max(_finite(value), self.low), self.high))
        if self.above_low and number == self.low:
            raise ValueError(self.accepted())
        return number


@dataclasses.dataclass(frozen=True)
class Flag(Specification):
    def accepted(self) -> str:
        return 'True or False'

    def checked(self, value: Any) -> bool:
        if not isinstance(value, (bool, np.bool_)):
            raise TypeError(self.accepted())
        return bool(value)

    def nearest(self, value: Any, previous: Any) -> bool:
        if isinstance(value, str) and value.strip().lower() in ('true', 'false'):
            return value.strip().lower() == 'true'
        number = _finite(value)
        if number not in (0, 1):
            raise ValueError(self.accepted())
        return bool(number)


@dataclasses.dataclass(frozen=True)
class Choice(Specification):
    choices: tuple[str, ...]

    def accepted(self) -> str:
        return 'one of ' + ', '.join(repr(choice) for choice in self.choices)

    def checked(self, value: Any) -> str:
        if not isinstance(value, str):
            raise TypeError(self.accepted())
        if value not in self.choices:
            raise ValueError(self.accepted())
        return str(value)

    def nearest(self, value: Any, previous: Any) -> str:
        for choice in self.choices:
            if str(value).strip().lower() == choice:
                return choice
        raise ValueError(self.accepted())


def parameter(default: Any, specification: Specification) -> Any:
    """Dataclass field of a detector's parameter."""
    return dataclasses.field(default=default, metadata={'specification': specification})


def specifications(owner: Any) -> dict[str, Specification]:
    """The declared parameters of a detector (class or instance) by name, in order of declaration."""
    return {field.name: field.metadata['specification'] for field in dataclasses.fields(owner)
            if 'specification' in field.metadata}


def defaults(owner: Any) -> dict[str, Any]:
    """The declared default of each parameter by name, in order of declaration."""
    return {field.name: field.default for field in dataclasses.fields(owner) if 'specification' in field.metadata}


def check(name: str, value: Any, specification: Specification) -> Any:
    """`value` as `specification` wants it, or a TypeError or ValueError that names both sides."""
    try:
        return specification.checked(value)
    except (TypeError, ValueError) as error:
        raise type(error)(f'{name} must be {error}; got {shown(value)} ({type(value).__name__})') from None


def validate(instance: Any) -> None:
    """Check every declared field of a frozen dataclass and store it as a plain Python object.

    Raises
    ------
    TypeError, ValueError
        With the field's name, what is accepted and what was given.
    """
    for name, specification in specifications(instance).items():
        object.__setattr__(instance, name, check(name, getattr(instance, name), specification))


def _finite(value: Any) -> float:
    """`value` (a number, a bool, or text that spells a number) as a finite float; ValueError otherwise."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError('a number') from None
    except OverflowError:   # an integer beyond what a float can hold
        raise ValueError('a finite number') from None
    if not math.isfinite(number):
        raise ValueError('a finite number')
    return number
