"""The demo: real frames through the node, headless, with a report."""
