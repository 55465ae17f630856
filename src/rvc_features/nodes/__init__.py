"""The nodes, and what nodes need: the only room that knows both detectors and ROS."""

import os

# OpenCV's threads spin while they wait for work, and its caller while it waits for them: a third of the processor time
# that a frame of VGA takes, all of it for nothing. OpenCV reads this when it is loaded, which the nodes do after this.
for _waiting in ('OPENCV_THREAD_POOL_ACTIVE_WAIT_WORKER', 'OPENCV_THREAD_POOL_ACTIVE_WAIT_MAIN'):
    os.environ.setdefault(_waiting, '0')
