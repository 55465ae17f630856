"""A row for each parameter: list, checkbox, slider and entry field. Knows Tk and descriptions, but no ROS."""

from __future__ import annotations

import ast
import re
import tkinter
from tkinter import ttk
from typing import Any, Callable

from rvc_features.windows import ranges

_NUMBER_WIDTH = 12   # characters
_TEXT_WIDTH = 40


class Panel(ttk.Frame):
    """All parameters of a node, one below the other, with a field above that finds some by name.

    Rows of a choice that is not taken are left out: where a parameter is a list, those whose names begin with another
    entry of it, or whose descriptions do (`orb_levels`, "Orb: levels of the pyramid", "Orb with pyramids: ..."), are of
    no use just then. Only one list chooses that way: the one with the most entries that names of parameters begin with.

    Parameters
    ----------
    parent : tkinter widget
    descriptions : list of dict
        As dynamic_reconfigure's client has them: name, type ('int', 'double', 'bool' or 'str'), min, max, default,
        description, edit_method.
    change : callable
        Called with (name, value) for whatever somebody moves, chooses or types.
    tell : callable
        Called with a sentence: the description of what the mouse is over, or what is wrong with what was typed.
    """

    def __init__(self, parent: tkinter.Misc, descriptions: list[dict[str, Any]], change: Callable[[str, Any], None],
                 tell: Callable[[str], None]) -> None:
        super().__init__(parent)
        self.rows: dict[str, Row] = {}
        self.wanted = tkinter.StringVar(self)
        self.wanted.trace_add('write', lambda *_: self._lay_out())
        top = ttk.Frame(self)
        ttk.Label(top, text='find').pack(side='left', padx=4)
        ttk.Entry(top, textvariable=self.wanted).pack(side='left', fill='x', expand=True)
        top.pack(fill='x', padx=4, pady=4)

        self._canvas = tkinter.Canvas(self, highlightthickness=0, width=680, height=480,
                                      background=ttk.Style(self).lookup('TFrame', 'background'))
        bar = ttk.Scrollbar(self, command=self._canvas.yview)
        self._canvas.configure(yscrollcommand=bar.set)
        bar.pack(side='right', fill='y')
        self._canvas.pack(side='left', fill='both', expand=True)
        self._table = ttk.Frame(self._canvas)
        self._table.columnconfigure(1, weight=1)
        inside = self._canvas.create_window(0, 0, window=self._table, anchor='nw')
        self._canvas.bind('<Configure>', lambda event: self._canvas.itemconfigure(inside, width=event.width))
        self._table.bind('<Configure>', lambda _: self._canvas.configure(scrollregion=self._canvas.bbox('all')))
        for event, units in (('<Button-4>', -1), ('<Button-5>', 1)):
            self.bind_all(event, lambda _, units=units: self._canvas.yview_scroll(units, 'units'))  # type: ignore[misc]

        def changed(name: str, value: Any) -> None:
            change(name, value)
            self._lay_out()

        for line, description in enumerate(descriptions):
            self.rows[description['name']] = _row(self._table, line, description, changed, tell)
        self._choosing = max(self.rows.values(), key=lambda row: sum(
            any(name.lower().startswith(f'{choice}_') for name in self.rows) for choice in row.choices()), default=None)
        self._lay_out()

    def show(self, values: dict[str, Any]) -> None:
        """Show values without calling `change`."""
        for name, value in values.items():
            if name in self.rows:
                self.rows[name].show(value)
        self._lay_out()

    def shown(self) -> list[str]:
        """Names of the rows that are laid out now."""
        return [name for name, row in self.rows.items() if row.is_visible]

    def _lay_out(self) -> None:
        idle = [choice for choice in self._choosing.choices() if choice != str(self._choosing.value).lower()] \
            if self._choosing else []
        for name, row in self.rows.items():
            useless = any(name.lower().startswith(f'{choice}_')
                          or re.match(rf'{re.escape(choice)}\b[^:.]*:', row.text, re.IGNORECASE) for choice in idle)
            row.set_visible(not useless and self.wanted.get().strip().lower() in name.lower())


class Row:
    """A parameter: label and widgets in one line of a grid. Subclasses make the widgets and know their values."""

    def __init__(self, parent: ttk.Frame, line: int, description: dict[str, Any],
                 change: Callable[[str, Any], None], tell: Callable[[str], None]) -> None:
        self.name, self.text = description['name'], description['description']
        self.is_visible = True
        self._change, self._tell = change, tell
        self._widgets: list[ttk.Widget] = []
        self.value = description['default']
        self._add(ttk.Label(parent, text=self.name), line, 0, sticky='w')
        self.make(parent, line, description)
        self.show(self.value)

    def make(self, parent: ttk.Frame, line: int, description: dict[str, Any]) -> None:
        """Add the widgets."""
        raise NotImplementedError

    def show(self, value: Any) -> None:
        """Show a value that came from elsewhere."""
        raise NotImplementedError

    def choices(self) -> list[str]:
        """Where this is a list: the values of its entries, in lower case."""
        return []

    def set_visible(self, visible: bool) -> None:
        if visible != self.is_visible:
            self.is_visible = visible
            for widget in self._widgets:
                widget.grid() if visible else widget.grid_remove()   # type: ignore[attr-defined]

    def set(self, value: Any) -> None:
        """Take over what somebody entered, and say so."""
        self.show(value)
        self._change(self.name, value)

    def _add(self, widget: ttk.Widget, line: int, column: int, **options: Any) -> None:
        widget.grid(row=line, column=column, padx=4, pady=1, **options)   # type: ignore[attr-defined]
        widget.bind('<Enter>', lambda _: self._tell(self.text))
        self._widgets.append(widget)


class _Flag(Row):
    def make(self, parent: ttk.Frame, line: int, description: dict[str, Any]) -> None:
        self._on = tkinter.BooleanVar(parent)
        self.box = ttk.Checkbutton(parent, variable=self._on, command=lambda: self.set(self._on.get()))
        self._add(self.box, line, 1, sticky='w')

    def show(self, value: Any) -> None:
        self.value = bool(value)
        self._on.set(self.value)


class _List(Row):
    """An enum. An entry whose name says more than its value shows both; `score_harris` for harris says no more."""

    def make(self, parent: ttk.Frame, line: int, description: dict[str, Any]) -> None:
        self._entries = ast.literal_eval(description['edit_method'])['enum']
        self.labels = [str(entry['value']) if f'_{entry["name"]}'.endswith(f'_{entry["value"]}')
                       else f'{entry["name"]} ({entry["value"]})' for entry in self._entries]
        self.box = ttk.Combobox(parent, values=self.labels, state='readonly')
        self.box.bind('<<ComboboxSelected>>', self._chosen)
        self._add(self.box, line, 1, sticky='we')

    def show(self, value: Any) -> None:
        self.value = value
        values = [entry['value'] for entry in self._entries]
        if value in values:
            self.box.current(values.index(value))
        else:
            self.box.set(str(value))

    def _chosen(self, _: Any) -> None:
        entry = self._entries[self.box.current()]
        self.set(entry['value'])
        self._tell(entry['description'])

    def choices(self) -> list[str]:
        return [str(entry['value']).lower() for entry in self._entries]


class _Entry(Row):
    """A field for typing: the value is taken with Return, or when the field is left."""

    def make(self, parent: ttk.Frame, line: int, description: dict[str, Any]) -> None:
        self._add_field(parent, line, 1, _TEXT_WIDTH)

    def read(self, text: str) -> Any:
        """The value that was typed; ValueError with what is accepted."""
        return text

    def show(self, value: Any) -> None:
        self.value = value
        self.field.delete(0, 'end')
        self.field.insert(0, f'{value:.10g}' if isinstance(value, float) else str(value))

    def _add_field(self, parent: ttk.Frame, line: int, column: int, width: int) -> None:
        self.field = ttk.Entry(parent, width=width)
        self.field.bind('<Return>', self._typed)
        self.field.bind('<FocusOut>', self._typed)
        self._add(self.field, line, column, sticky='w')

    def _typed(self, _: Any) -> None:
        try:
            value = self.read(self.field.get().strip())
        except ValueError as error:
            self._tell(f'{self.name}: {error}')
            self.show(self.value)
            return
        if value != self.value:
            self.set(value)


class _Number(_Entry):
    def make(self, parent: ttk.Frame, line: int, description: dict[str, Any]) -> None:
        self.range = ranges.of_number(description['min'], description['max'], description['default'],
                                      whole=description['type'] == 'int')
        self._add_field(parent, line, 2, _NUMBER_WIDTH)
        self.scale = ttk.Scale(parent, from_=0, to=self.range.steps, command=self._slid)
        if self.range.steps:
            self._add(self.scale, line, 1, sticky='we')
            for key, steps in (('<Left>', -1), ('<Right>', 1)):
                self.scale.bind(key, lambda _, steps=steps: self.move(steps))   # type: ignore[misc]

    def read(self, text: str) -> Any:
        return self.range.read(text)

    def show(self, value: Any) -> None:
        super().show(value)
        self.scale.configure(value=self.range.position(value))

    def move(self, steps: int) -> str:
        """Some steps to the right, as the arrow keys do."""
        self.set(self.range.value(self.range.position(self.value) + steps))
        return 'break'   # Tk's own step is one of another size

    def _slid(self, position: str) -> None:
        value = self.range.value(float(position))
        if value != self.value:
            self.set(value)


def _row(parent: ttk.Frame, line: int, description: dict[str, Any], change: Callable[[str, Any], None],
         tell: Callable[[str], None]) -> Row:
    kinds = {'bool': _Flag, 'int': _Number, 'double': _Number, 'str': _Entry}
    kind = _List if description['edit_method'] else kinds[description['type']]
    return kind(parent, line, description, change, tell)
