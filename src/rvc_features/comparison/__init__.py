"""The offline workbench that compares detectors on any images: `compare_detectors`, and docs/comparison.md.

What is compared on
    datasets: pairs of images, with or without a homography between them. inputs: from paths to data sets. sequences:
    pairs with ground truth; homographies: reading, checking and applying it. warps: one photograph under known changes.
    frame_pairs: recordings without ground truth.
What is compared
    contestants: detectors with their parameters, from the command line or a YAML file.
What is measured
    correspondences: which points of two images are the same. measures: the numbers, pure functions of points, images
    and a homography. survival: the same without ground truth. pair_task: everything on one pair, as one job.
How it is run
    runner: pairs through an executor. executors: this process, several, a Dask cluster. results: kept on disk one by
    one. command: the command line; compare: what it does.
What is told
    intervals: how far chance reaches. columns, tables, summary: results gathered. page with charts and pictures,
    text_tables, csv_tables: how they look. report: all of its files.
Live
    live: detectors side by side on images as they come; the node is rvc_features.nodes.compare_node.
"""
