"""image_transport for Python: images over topics, raw or compressed, exchangeable with C++ nodes.

    transport = ImageTransport()
    publisher = transport.advertise('camera/image')             # also camera/image/compressed
    publisher.publish(message)                                  # or publish_array(array, 'bgr8', header)
    subscriber = transport.subscribe('camera/image', callback)  # raw, or what ~image_transport says

Names, parameters and behaviour are those of the C++ package, in Python's spelling: docs/image_transport.md lists them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rvc_features.image_transport.encodings import ImageError
    from rvc_features.image_transport.image_transport import ImageTransport, TransportHints, known_transport
    from rvc_features.image_transport.publisher import Publisher
    from rvc_features.image_transport.subscriber import Subscriber
    from rvc_features.image_transport.transports import TRANSPORTS, CompressedTransport, RawTransport, Transport

__all__ = ['TRANSPORTS', 'CompressedTransport', 'ImageError', 'ImageTransport', 'Publisher', 'RawTransport',
           'Subscriber', 'Transport', 'TransportHints', 'known_transport']

_MODULES = ('encodings', 'image_transport', 'publisher', 'subscriber', 'transports')


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is: who only reads messages from a bag needs neither rospy nor a build."""
    if name in __all__:
        for module in _MODULES:
            found = vars(importlib.import_module(f'{__name__}.{module}'))
            if name in found:
                globals()[name] = found[name]
                return found[name]
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
