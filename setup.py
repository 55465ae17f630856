"""Tells catkin where the Python package is. Not for direct use: build with catkin, or with ./run."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import find_packages, setup

packages = find_packages('src')
setup(**generate_distutils_setup(packages=packages, package_dir={'': 'src'}))
