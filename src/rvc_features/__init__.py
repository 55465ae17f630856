"""Key point detection: a detector half that knows no ROS, and a ROS half that knows no image mathematics.

Detector half (OpenCV, NumPy, optionally Numba)
    detectors, feature_detector, harris_detector, opencv_detectors, parameters, response, maxima, filters,
    orientation, key_points, drawing, image_sources; and what the node needs but ROS doesn't: detector_config,
    newest_worker, node_statistics
ROS half
    feature_detector_node, reconfigure, image_transport, image_messages, bags, make_bag, private_master, demo
"""
