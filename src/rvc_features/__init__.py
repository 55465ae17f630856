"""Key point detection: a detector half that knows no ROS, and a ROS half that knows no image mathematics.

Detector half (OpenCV, NumPy, optionally Numba)
    detectors, feature_detector, harris_detector, opencv_detectors, parameters, response, maxima, filters,
    orientation, key_points, drawing
ROS half
    feature_detector_node, image_transport, image_messages, reconfigure, make_bag
"""
