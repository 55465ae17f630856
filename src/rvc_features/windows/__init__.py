"""Windows on a screen: the parameters of any node, and a viewer for an image topic."""
