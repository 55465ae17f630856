"""What an odometry needs beyond positions: stages of their own, without ROS, each of use alone.

masks: where no point may lie. tracks: points followed from frame to frame by `flow`, and `trails`, their drawing. rays:
the directions that pixels look in. descriptors: what its surroundings look like. covariance:
how certain a position is. docs/odometry.md has it all.
"""
