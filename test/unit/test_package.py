"""What a release is made of: package.xml and CHANGELOG.rst tell the same, in the forms that catkin and bloom read."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

pytest.importorskip('catkin_pkg', reason='ROS is not installed')

from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package

ROOT = Path(__file__).parents[2]


@pytest.mark.filterwarnings('ignore::PendingDeprecationWarning')   # of docutils, in catkin_pkg
def test_the_version_has_its_entry_in_the_changelog():
    warnings = []
    package = parse_package(str(ROOT), warnings=warnings)
    assert warnings == []
    versions = [(version, date) for version, date, _ in get_changelog_from_path(str(ROOT)).foreach_version()
                if version != 'forthcoming']
    assert versions[0][0] == package.version
    assert versions[0][1] is not None
    items, = get_changelog_from_path(str(ROOT)).get_content_of_version(package.version)
    assert len(items.bullets) > 20   # of which debian/changelog is made


@pytest.mark.parametrize('path', sorted([*ROOT.glob('launch/*.launch'), *ROOT.glob('test/*.test')]),
                         ids=lambda path: path.name)
def test_dirname_is_not_used_inside_an_include(path):
    """There it is the folder of the included file before roslaunch 1.15.15, which Ubuntu 22.04 has not."""
    inside = [value for include in ElementTree.parse(path).iter('include') for child in include
              for value in child.attrib.values()]
    assert not [value for value in inside if '$(dirname)' in value]
