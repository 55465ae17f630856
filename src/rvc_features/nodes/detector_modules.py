"""Modules of other people that register detectors: imported so that none can take the node with it. (No ROS here.)"""

from __future__ import annotations

import importlib
import threading
from typing import Any, Callable

from rvc_features.brief import cut, shown

PATIENCE = 30.0   # seconds for one module


def import_all(modules: Any, report: Callable[[str], Any] = lambda text: None, patience: float = PATIENCE) -> list[str]:
    """Import modules by their names, each in a thread of its own.

    Parameters
    ----------
    modules : list of str
        Or whatever else somebody has set the parameter to; a single name will do.
    report : callable
        Takes the name of each module when it begins, and an empty text in the end.
    patience : float
        Seconds for each module; one that takes longer goes on in its thread and is not waited for.

    Returns
    -------
    list of str
        A sentence for each that could not be imported: its detectors are missing, everything else works.
    """
    if isinstance(modules, str):
        modules = [modules]
    if not isinstance(modules, list) or not all(isinstance(module, str) for module in modules):
        return [f'~detector_modules must be a list of module names; got {shown(modules)}']
    problems = []
    for module in modules:
        report(module)
        problem = _import(module, patience)
        if problem:
            problems.append(f'~detector_modules: {shown(module)} {problem}')
    report('')
    return problems


def _import(module: str, patience: float) -> str:
    failures: list[str] = []

    def work() -> None:
        try:
            importlib.import_module(module)
        except BaseException as error:   # SystemExit, too: modules written as programs call it
            failures.append(f'can not be imported: {type(error).__name__}: {cut(str(error))}')

    thread = threading.Thread(target=work, name=f'import of {module}', daemon=True)
    thread.start()
    thread.join(patience)
    if thread.is_alive():
        return f'hangs while it is imported (for more than {patience:g} s): not waited for'
    return failures[0] if failures else ''
