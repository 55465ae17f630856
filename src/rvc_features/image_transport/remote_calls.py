"""How the node's other port, that of XML-RPC, is kept from being kept busy.

ROS's libraries take as much as is sent, for as long as it takes, and expand XML's entities: 1 kB becomes hundreds of MB
and minutes. Idle connections of peers that have vanished gather for ever.
"""

from __future__ import annotations

import functools
import http
import xmlrpc.client
from typing import Any

import rosgraph.xmlrpc

_SILENCE = 60.0           # seconds that a connection may be idle; C++ gives them up after 30
_MOST_BYTES = 10 << 20    # of a call; the longest there are carry parameters


class _Parser(xmlrpc.client.ExpatParser):
    """Refuses documents that declare anything: no call of ROS does, and entities are declared there."""

    def __init__(self, target: Any) -> None:
        super().__init__(target)
        self._parser.StartDoctypeDeclHandler = self._refuse   # type: ignore[attr-defined]

    def _refuse(self, *_: Any) -> None:
        raise ValueError('XML with a document type')


def limit_remote_calls() -> None:
    """Have this process's port of XML-RPC answer like that."""
    xmlrpc.client.ExpatParser = _Parser   # type: ignore[misc]
    handler = rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler
    handler.timeout = _SILENCE
    if not hasattr(handler.do_POST, '__wrapped__'):   # not done yet
        handler.do_POST = _limited(handler.do_POST)


def _limited(do_post: Any) -> Any:
    @functools.wraps(do_post)
    def post(handler: Any) -> None:
        length = handler.headers.get('Content-Length', '')
        if length.isdecimal() and int(length) <= _MOST_BYTES:
            do_post(handler)
        else:
            handler.close_connection = True
            handler.send_error(http.HTTPStatus.REQUEST_ENTITY_TOO_LARGE)

    return post
