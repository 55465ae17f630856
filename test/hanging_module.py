"""A module of detectors whose import never ends."""

import threading

threading.Event().wait()
