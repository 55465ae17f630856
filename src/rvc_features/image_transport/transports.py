"""How images travel: one class for each transport. A new one is derived from `Transport` and entered in TRANSPORTS."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
import rospy
import sensor_msgs.msg

from rvc_features.brief import shown
from rvc_features.cfg import CompressedPublisherConfig
from rvc_features.image_transport.compressed import COMPRESSED_FORMATS, to_compressed_message
from rvc_features.image_transport.encodings import ImageError
from rvc_features.image_transport.messages import Image, to_array, to_image_message, unpack
from rvc_features.reconfigure import ReconfigureServer


class Transport(ABC):
    """A way for images to travel. To add one, derive a class and enter it in TRANSPORTS under its name.

    There is one instance for each publisher and each subscriber; those of publishers may have parameters.
    """

    name: ClassVar[str]
    message_class: ClassVar[type]

    def topic(self, base_topic: str) -> str:
        """Name of the transport's topic; `base_topic` is resolved."""
        return f'{base_topic}/{self.name}'

    def start_publishing(self, topic: str) -> None:   # noqa: B027  (many transports need none)
        """Called once before the first `encode`; parameters belong under `topic`."""

    def stop_publishing(self) -> None:   # noqa: B027
        """Called once after the last `encode`."""

    def start_subscribing(self, namespace: str) -> None:   # noqa: B027
        """Called once before the first `decode`; parameters belong under `namespace`, such as ~compressed."""

    @abstractmethod
    def encode(self, image: sensor_msgs.msg.Image) -> Any:
        """The message to send for an image, None where none is to be sent, ImageError where there can be none."""

    @abstractmethod
    def decode(self, message: Any) -> sensor_msgs.msg.Image:
        """The image that a message holds; ImageError where there is none."""


class RawTransport(Transport):
    """The image as it is."""

    name = 'raw'
    message_class = Image

    def topic(self, base_topic: str) -> str:
        return base_topic

    def encode(self, image: sensor_msgs.msg.Image) -> sensor_msgs.msg.Image:
        return image

    def decode(self, message: sensor_msgs.msg.Image) -> sensor_msgs.msg.Image:
        return message


_MODES = {'unchanged': '', 'gray': 'mono8', 'color': 'bgr8'}   # C++'s names, and the encoding that each makes


class CompressedTransport(Transport):
    """JPEG or PNG, with the parameters of cfg/CompressedPublisher.cfg under the topic."""

    name = 'compressed'
    message_class = sensor_msgs.msg.CompressedImage
    _mode = 'unchanged'

    def start_publishing(self, topic: str) -> None:
        self._topic = topic
        self._parameters = dict(CompressedPublisherConfig.defaults)
        self._server: ReconfigureServer | None = None
        try:
            self._server = ReconfigureServer(CompressedPublisherConfig, self.update_config, topic)
        except rospy.service.ServiceException:
            rospy.logwarn(f'{topic} is advertised twice in this node; only the parameters of the first can be changed')

    def stop_publishing(self) -> None:
        if self._server is not None:
            self._server.set_service.shutdown('image topic withdrawn')
            self._server.descr_topic.unregister()
            self._server.update_topic.unregister()

    def update_config(self, config: Any, level: int) -> Any:
        """Callback of dynamic_reconfigure, which has checked the numbers."""
        if config['format'] not in COMPRESSED_FORMATS:
            rospy.logwarn(f'format must be one of {", ".join(COMPRESSED_FORMATS)}; got {shown(config["format"])}, '
                          f'{self._parameters["format"]!r} stays')
            config['format'] = self._parameters['format']
        self._parameters = {name: config[name] for name in self._parameters}
        return config

    def encode(self, image: sensor_msgs.msg.Image) -> sensor_msgs.msg.CompressedImage | None:
        parameters = dict(self._parameters)
        if not parameters.pop('enable'):
            return None
        array, encoding = unpack(image)
        try:
            return to_compressed_message(array, encoding, image.header, **parameters)
        except ImageError as error:
            cure = 'it travels raw' if array.dtype != np.uint8 or parameters['format'] == 'png' else \
                f'rosrun dynamic_reconfigure dynparam set {self._topic} format png'
            raise ImageError(f'{error} ({cure})') from None

    def start_subscribing(self, namespace: str) -> None:
        asked = str(rospy.get_param(f'{namespace}/mode', self._mode))
        if asked in _MODES:
            self._mode = asked
        else:
            rospy.logwarn(f'{namespace}/mode must be one of {", ".join(_MODES)}; got {shown(asked)}, '
                          f'{self._mode!r} is used')

    def decode(self, message: sensor_msgs.msg.CompressedImage) -> sensor_msgs.msg.Image:
        encoding = _MODES[self._mode]
        array, encoding = (to_array(message, encoding), encoding) if encoding else unpack(message)
        return to_image_message(array, encoding, message.header)


TRANSPORTS: dict[str, type[Transport]] = {'raw': RawTransport, 'compressed': CompressedTransport}


def create(name: Any) -> Transport:
    """A transport by its name; ValueError with the known names otherwise."""
    if not isinstance(name, str) or name not in TRANSPORTS:
        raise ValueError(f'unknown image transport {shown(name)}; there are {", ".join(sorted(TRANSPORTS))}')
    return TRANSPORTS[name]()
