"""The offline workbench that compares detectors on any images: `compare_detectors`, and docs/comparison.md.

    homographies   reading, checking and applying ground truth
    warps       one photograph under known rotations, zooms, tilts, blur, noise, JPEG and light
    datasets    what is compared on: pairs of images, with or without a homography between them
    contestants    what is compared: detectors with their parameters, from the command line or a YAML file
    measures    the numbers; each is a pure function of points, images and a homography
    pair_task   everything measured on one pair, as one job for one process
    runner      jobs through an executor, results kept on disk one by one
    summary     results of pairs gathered into tables, with confidence intervals
    charts, pictures, report   the page
    command     the command line
    live        the same side by side on images as they come; the node is rvc_features.nodes.compare_node
"""
