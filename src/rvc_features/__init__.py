"""Key point detection: a detector half that knows no ROS, and a ROS half that knows no image mathematics.

Detector half (OpenCV, NumPy, and Numba where it is installed)
    detectors: the registry, the way in. feature_detector: the interface; harris_detector and opencv_detectors: what
    is behind it. response, maxima, filters, orientation: the steps of Harris; kernels, and vectors below them: their
    fast twins. key_points, drawing, parameters: what all detectors share. image_sources: frames from files and videos.
    comparison: the workbench. What the node needs but ROS doesn't: detector_config, newest_worker, node_statistics,
    heap.
ROS half
    feature_detector_node: the node; compare_node: detectors side by side. image_transport, image_messages, republish,
    lazy_input, whole_reads: images in and out. reconfigure: parameters while running. bags, make_bag: bags. demo,
    private_master. spin: how nodes run.
"""
