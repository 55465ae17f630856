"""Tells catkin where the Python package is. Not for direct use: build with catkin, or with ./run."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=['rvc_features', 'rvc_features.comparison'], package_dir={'': 'src'}))
