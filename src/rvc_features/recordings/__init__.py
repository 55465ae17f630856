"""Images from files, videos and bags, and bags made of them. Knows nothing of detectors."""
