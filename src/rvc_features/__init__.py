"""Key point detection: what the exercise sheet teaches lies here, at the top; rooms hold the rest.

Top (OpenCV and NumPy, in the order of the sheet)
    detectors: the registry, the way in. feature_detector: the interface. harris_detector: our own; opencv_detectors:
    the others. response, maxima, filters, orientation: the steps of Harris; two_scales, contrast: the corner strength
    and ranking of the preset `repeatable`. key_points, drawing, parameters: what all detectors share. Beside them, for
    rooms that need it: heap (memory), reconfigure (safe sliders, ROS).
Rooms
    kernels: the compiled twins of the steps. still_images: JPEG and PNG from outside, checked and decoded.
    image_transport: images in and out over topics. nodes: the nodes, the only room that knows both detectors and ROS.
    recordings: files, videos, bags. odometry: masks, tracks, rays, descriptors. comparison: the workbench.
    exercise: the course's examiner. demo.

Imports go one way: nodes, comparison, demo -> odometry -> recordings -> image_transport -> still_images; all of them ->
the top; the top -> kernels. docs/architecture.md says more, and a test holds it.
"""
