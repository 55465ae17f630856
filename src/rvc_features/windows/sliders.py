"""Sliders for the dynamic parameters of a node, of any package: what rqt_reconfigure does, where there is none.

    rosrun rvc_features sliders [NODE]

Without NODE the window lists the nodes that have parameters. Whatever is moved is sent at once; what the node makes of
it (it may refuse or round) comes back and is shown. *Save* writes plain YAML, which this window, `dynparam load`,
`rosparam load` and `feature_detector.launch config:=FILE` read; *Load* reads what any of them writes. The window needs
Tk (Debian: python3-tk) and a screen. It stays when the node ends, and goes on when one of that name starts again.
"""

from __future__ import annotations

import argparse
import functools
import queue
import sys
import threading
import time
import tkinter
from tkinter import filedialog, ttk
from typing import Any, Callable

import rospy
from dynamic_reconfigure import DynamicReconfigureException, find_reconfigure_services
from dynamic_reconfigure.client import Client

from rvc_features import presets
from rvc_features.nodes import settings
from rvc_features.windows.panel import Panel

_POLL = 30          # milliseconds between two looks at what came from the node
_PATIENCE = 2.0     # seconds to wait for a node before saying that it isn't there
_SETTLING = 0.5     # seconds after the last movement until the node's answer is shown
_FILES = [('YAML', '*.yaml *.yml'), ('all files', '*')]


class Connection:
    """The dynamic parameters of one node. All talking to ROS is done in a thread of its own: no call of these blocks.

    Parameters
    ----------
    node : str
    tell : callable
        Called, from any thread, with this connection and ('descriptions', list), ('values', dict) or
        ('problem', str).
    """

    def __init__(self, node: str, tell: Callable[[Connection, str, Any], None]) -> None:
        self.node, self._tell = node, functools.partial(tell, self)
        self._changes: dict[str, Any] = {}
        self._wake = threading.Condition()
        self._open = True
        threading.Thread(target=self._serve, name=f'parameters of {node}', daemon=True).start()

    def send(self, changes: dict[str, Any]) -> None:
        """Send changes as soon as possible; of several for one parameter the last counts."""
        with self._wake:
            self._changes.update(changes)
            self._wake.notify()

    def close(self) -> None:
        with self._wake:
            self._open = False
            self._wake.notify()

    def _serve(self) -> None:
        client = self._connect()
        while self._open:
            with self._wake:
                self._wake.wait_for(lambda: self._changes or not self._open)
                changes, self._changes = self._changes, {}
            try:
                if changes and client is not None:
                    client.update_configuration(changes)
            except (DynamicReconfigureException, rospy.ROSException, rospy.ServiceException) as error:
                self._tell('problem', f'{self.node} does not take {", ".join(changes)}: {error}')
        if client is not None:
            client.close()

    def _connect(self) -> Client | None:
        while self._open and not rospy.is_shutdown():
            try:
                return Client(self.node, timeout=_PATIENCE, config_callback=lambda values: self._tell('values', values),
                              description_callback=lambda descriptions: self._tell('descriptions', descriptions))
            except rospy.ROSException:
                self._tell('problem', f'waiting for {self.node}, which is not running or has no dynamic parameters')
        return None


class SlidersWindow:
    """The window: the choice of a node above, its parameters below, and a line that tells."""

    def __init__(self, root: tkinter.Tk, node: str = '') -> None:
        self.root = root
        ttk.Style(root).theme_use('clam')   # on X11 the default is Motif's of 1990
        root.configure(background=ttk.Style(root).lookup('TFrame', 'background'))
        self.panel: Panel | None = None
        self.connection: Connection | None = None
        self.values: dict[str, Any] = {}
        self._descriptions: list[dict[str, Any]] = []
        self._moved: dict[str, float] = {}   # when somebody moved a parameter last
        self._take: dict[str, Callable[[Any], None]] = {
            'descriptions': self._describe, 'values': self._show, 'problem': lambda text: self.status.set(text)}
        self._news: queue.Queue = queue.Queue()
        self.status = tkinter.StringVar(root)
        self._make_bar()
        ttk.Label(root, textvariable=self.status, anchor='w', padding=4).pack(side='bottom', fill='x')
        root.protocol('WM_DELETE_WINDOW', self.close)
        self.refresh()
        if node or self.nodes['values']:
            self.connect(node or self.nodes['values'][0])
        self._poll()

    def refresh(self) -> None:
        """List the nodes that have dynamic parameters."""
        try:
            self.nodes['values'] = find_reconfigure_services()
        except Exception as error:   # rosservice has its own kinds; the window goes on
            self.status.set(f'the master does not answer: {error}')
        if not self.nodes['values']:
            self.status.set('no node with dynamic parameters is running; start one and press Refresh')

    def connect(self, node: str) -> None:
        """Show the parameters of another node."""
        if self.connection is not None:
            self.connection.close()
        self._forget()
        self.nodes.set(node)
        self.root.title(f'{node}: parameters')
        self.status.set(f'waiting for {node}')
        self.connection = Connection(node, lambda *news: self._news.put(news))

    def reset(self) -> None:
        """Send the defaults of all parameters."""
        self._send({entry['name']: entry['default'] for entry in self._descriptions}, 'defaults')

    def load(self, path: str) -> None:
        """Send the values in a file, whoever wrote it."""
        try:
            values = settings.read(path, self.nodes.get())
        except settings.SettingsError as error:
            self.status.set(str(error))
            return
        known = {name: value for name, value in values.items() if name in self.values}
        unknown = sorted(set(values) - set(known))
        left_out = f', but for {", ".join(unknown)}, which {self.nodes.get()} has not' if unknown else ''
        self._send(known, path + left_out)

    def take_preset(self, name: str) -> None:
        """Send the values of one of our presets; only a feature detector has them all."""
        self._send(settings.of_preset(name), f'{name}. {presets.get(name).purpose} {presets.get(name).cost}')

    def save(self, path: str) -> None:
        """Write the values that are in force."""
        try:
            settings.write(path, {entry['name']: self.values[entry['name']] for entry in self._descriptions})
            self.status.set(f'saved in {path}')
        except settings.SettingsError as error:
            self.status.set(str(error))

    def close(self) -> None:
        if self.connection is not None:
            self.connection.close()
        self.root.destroy()

    def _make_bar(self) -> None:
        bar = ttk.Frame(self.root)
        self.nodes = ttk.Combobox(bar, state='readonly')
        self.nodes.bind('<<ComboboxSelected>>', lambda _: self.connect(self.nodes.get()))
        self.nodes.pack(side='left', fill='x', expand=True)
        ttk.Button(bar, text='Refresh', command=self.refresh).pack(side='left')
        self.buttons = {}
        for text, command in (('Load', lambda: self._with_file(filedialog.askopenfilename, self.load)),
                              ('Save', lambda: self._with_file(filedialog.asksaveasfilename, self.save)),
                              ('Reset', self.reset)):
            self.buttons[text] = ttk.Button(bar, text=text, command=command)
            self.buttons[text].pack(side='left')
        self.presets = ttk.Combobox(bar, state='disabled', values=presets.names(), width=12)
        self.presets.bind('<<ComboboxSelected>>', lambda _: self.take_preset(self.presets.get()))
        self.presets.pack(side='left')
        bar.pack(fill='x', padx=4, pady=4)

    def _with_file(self, ask: Callable[..., str], use: Callable[[str], None]) -> None:
        path = ask(parent=self.root, filetypes=_FILES, defaultextension='.yaml')
        if path:
            use(path)

    def _send(self, values: dict[str, Any], what: str) -> None:
        if self.connection is not None and values:
            self.connection.send(values)
        self.status.set(f'sent: {what}')

    def _change(self, name: str, value: Any) -> None:
        self.values[name], self._moved[name] = value, time.monotonic()
        if self.connection is not None:
            self.connection.send({name: value})

    def _forget(self) -> None:
        self.values, self._descriptions, self._moved = {}, [], {}
        if self.panel is not None:
            self.panel.destroy()
            self.panel = None

    def _poll(self) -> None:
        """Take over what came from the node, in the thread that Tk wants."""
        if rospy.is_shutdown():
            self.close()
            return
        while not self._news.empty():
            connection, kind, what = self._news.get()
            if connection is self.connection:
                self._take[kind](what)
        self.root.after(_POLL, self._poll)

    def _describe(self, descriptions: list[dict[str, Any]]) -> None:
        if descriptions == self._descriptions:
            return   # the same node, started again
        values = self.values
        self._forget()
        self._descriptions = descriptions
        ours = set(settings.of_preset(presets.names()[0])) <= {entry['name'] for entry in descriptions}
        self.presets.configure(state='readonly' if ours else 'disabled')
        self.presets.set('preset' if ours else '')
        self.panel = Panel(self.root, descriptions, self._change, self.status.set)
        self.panel.pack(fill='both', expand=True)
        self._show(values)

    def _show(self, values: dict[str, Any]) -> None:
        self.values = {name: value for name, value in values.items() if name != 'groups'}
        self._show_settled()

    def _show_settled(self) -> None:
        """Show what is in force; what somebody is just moving a little later, for answers lag behind the hand."""
        if self.panel is None:
            return
        moving = {name for name, when in self._moved.items() if time.monotonic() < when + _SETTLING}
        self.panel.show({name: value for name, value in self.values.items() if name not in moving})
        if moving:
            self.root.after(round(1000 * _SETTLING), self._show_settled)


def main() -> int:
    """Show the window until it is closed; the exit status."""
    parser = argparse.ArgumentParser(prog='sliders', description=__doc__.partition('\n')[0],
                                     epilog=__doc__.partition('\n\n')[2],
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('node', nargs='?', default='', metavar='NODE', help='such as /feature_detector; none: choose')
    arguments = parser.parse_args(rospy.myargv()[1:])
    try:
        root = tkinter.Tk(className='sliders')
    except tkinter.TclError as error:
        print(f'sliders: no screen to show a window on: {error}', file=sys.stderr)
        return 1
    rospy.init_node('sliders', anonymous=True)
    SlidersWindow(root, rospy.resolve_name(arguments.node) if arguments.node else '')
    root.mainloop()
    return 0
