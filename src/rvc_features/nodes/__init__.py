"""The nodes, and what nodes need: the only room that knows both detectors and ROS."""
