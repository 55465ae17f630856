"""Image messages decoded in a process of their own, so that a crash is a finding and not the end of the tests.

As a script it is that process: on its input a number (4 bytes, little endian) and as many bytes, which are tried as
the data of a CompressedImage; on its output, for each, one line.
"""

import resource
import struct
import subprocess
import sys
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[2] / 'src'


class DecoderProcess:
    """Decodes in a process of its own; to be used as a context."""

    def __enter__(self):
        self._process = subprocess.Popen([sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.communicate()

    def outcome(self, data):
        """('ok' or 'refused', a text, seconds of processor time, peak of memory in MB) for one image's data."""
        self._process.stdin.write(struct.pack('<I', len(data)) + data)
        self._process.stdin.flush()
        line = self._process.stdout.readline().decode()
        assert line.endswith('\n'), f'the decoder died of {data[:300].hex()}, status {self._process.wait()}'
        kind, seconds, megabytes, text = line.rstrip('\n').split(' ', 3)
        return kind, text, float(seconds), float(megabytes)


def _serve():
    sys.path.insert(0, str(SOURCES))
    import sensor_msgs.msg

    from rvc_features.image_transport.encodings import ImageError
    from rvc_features.image_transport.messages import to_array

    while True:
        size = sys.stdin.buffer.read(4)
        if not size:
            return
        data = sys.stdin.buffer.read(struct.unpack('<I', size)[0])
        before = resource.getrusage(resource.RUSAGE_SELF)
        try:
            image = to_array(sensor_msgs.msg.CompressedImage(format='jpeg', data=data), 'bgr8')
            text = f'ok {image.shape[1]} x {image.shape[0]}'
        except ImageError as error:
            text = f'refused {error}'
        after = resource.getrusage(resource.RUSAGE_SELF)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        outcome, _, said = text.partition(' ')
        print(outcome, f'{seconds:.3f}', f'{after.ru_maxrss / 1024:.0f}', ' '.join(said.split()), flush=True)


if __name__ == '__main__':
    _serve()
