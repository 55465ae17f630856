"""Detectors from the command line and from YAML, and what is said about bad ones."""

import pytest
from conftest import draw_square

from rvc_features import presets
from rvc_features.comparison import contestants
from rvc_features.comparison.contestants import ContestantError, parse, read_yaml, with_distinct_labels


def test_the_command_line_form():
    plain = parse('harris', 500)
    assert (plain.label, plain.detector.name, plain.changed_settings()) == ('harris', 'harris', {})
    full = parse('my corners=harris:window_size=7, octaves=3,window=box,subpixel=no,threshold=0.1', 500)
    assert full.label == 'my corners'
    assert full.changed_settings() == {'window_size': 7, 'octaves': 3, 'window': 'box', 'subpixel': False,
                                       'threshold': 0.1}
    assert parse('fast:type=5_8', 500).detector.type == '5_8'


@pytest.mark.parametrize(('text', 'expected'), [
    ('harriss', "unknown detector 'harriss'; there are fast, good_features_to_track, harris"),
    ('harris:windowsize=7', "harris has no parameter 'windowsize'; it has window_size, "),
    ('harris:window_size=8', "window_size must be an odd integer of at least 3"),
    ('harris:window_size=big', "window_size must be an odd integer of at least 3; got 'big' (str)"),
    ('harris:subpixel=maybe', "subpixel must be True or False; got 'maybe'"),
    ('fast:type=9', "type must be one of '5_8', '7_12', '9_16'; got '9'"),
    ('harris:window_size', "'window_size' is no parameter=value"),
    ('harris:octaves=1,octaves=2', 'octaves is given twice'),
    ('', 'write [label=]detector[:parameter=value,...]'),
    ('orb:thinned=x', "thinned must be a distance in pixels; got 'x'"),
])
def test_bad_ones_are_named_with_what_is_accepted(text, expected):
    with pytest.raises(ContestantError) as error:
        parse(text, 500)
    assert repr(text) in str(error.value)
    assert expected in str(error.value)


def test_more_points_are_asked_for_when_more_are_compared():
    assert parse('orb', 800).detector.number_of_points == 800
    assert parse('orb', 100).detector.number_of_points == 500
    assert parse('orb:number_of_points=50', 800).detector.number_of_points == 50


def test_yaml(tmp_path):
    path = tmp_path / 'detectors.yaml'
    path.write_text('detectors:\n'
                    '- orb\n'
                    '- {detector: fast, label: nine, parameters: {type: 9_16, threshold: 12}}\n'
                    '- detector: harris\n  parameters:\n    anms: true\n    anms_robustness: 0.8\n  thinned: 2\n')
    orb, nine, harris = read_yaml(str(path), 500)
    assert (orb.label, orb.detector.name) == ('orb', 'orb')
    assert nine.label == 'nine'
    assert (nine.detector.type, nine.detector.threshold) == ('9_16', 12)   # YAML 1.1 would have 9_16 be 916
    assert (harris.detector.anms, harris.detector.anms_robustness, harris.thinned) == (True, 0.8, 2)


@pytest.mark.parametrize(('text', 'expected'), [
    ('detectors: [', 'not YAML'),
    ('', 'no list of detectors in it'),
    ('- 1: 2', 'detector 1: it has no name under detector'),
    ('- {detector: harris, colour: red}', "detector 1: unknown key 'colour'"),
    ('- harris\n- {detector: fast, parameters: {threshold: 0}}', 'detector 2: threshold must be an integer from 1'),
    ('- {detector: harris, parameters: [1]}', 'parameters must be a mapping'),
    ('- surf', "unknown detector 'surf'"),
])
def test_bad_yaml_is_named_with_file_and_place(tmp_path, text, expected):
    path = tmp_path / 'detectors.yaml'
    path.write_text(text)
    with pytest.raises(ContestantError) as error:
        read_yaml(str(path), 500)
    assert str(path) in str(error.value)
    assert expected in str(error.value)


def test_a_missing_yaml_file(tmp_path):
    with pytest.raises(ContestantError, match=r'nothing\.yaml: no such file'):
        read_yaml(str(tmp_path / 'nothing.yaml'), 500)


def test_labels_differ():
    labels = [each.label for each in with_distinct_labels(
        [parse(text, 500) for text in ('harris', 'harris:window_size=7', 'fast', 'a=orb', 'a=orb', 'b=orb', 'b=fast')])]
    assert labels == ['harris (defaults)', 'harris (window_size 7)', 'fast', 'a', 'a #2', 'b (orb)', 'b (fast)']


@pytest.mark.parametrize('name', presets.names())
def test_presets_by_name(name):
    assert parse(name, 321).detector == presets.create(name, 321)
    assert parse(name, 321).label == name
    assert parse(f'{name}:octaves=2,number_of_points=40', 321).detector == presets.create(name, 40, octaves=2)
    assert parse(name, 0).detector == presets.create(name)      # as compare.launch takes it: the preset's own number
    with pytest.raises(ContestantError, match="no parameter 'levels'"):
        parse(f'{name}:levels=2', 321)


def test_the_standard_choice_asks_all_for_as_many_points():
    chosen = contestants.standard_choice(321)
    assert len({each.label for each in chosen}) == len(chosen) >= 7
    for each in chosen:
        if each.detector.name == 'harris':
            assert each.detector.anms or each.detector.fixed_number_of_points
        assert 321 in (each.detector.number_of_points, getattr(each.detector, 'anms_points', 0))


def test_a_contestant_survives_the_way_to_another_process():
    before = parse('orb:thinned=3,levels=4', 500)
    assert contestants.from_specification(*before.specification()) == before


def test_thinned_points_keep_their_distance():
    points = parse('harris:local_maxima=false,thinned=4', 500).detect(draw_square())
    assert 4 <= len(points) < 40
    gaps = [((a['x'] - b['x']) ** 2 + (a['y'] - b['y']) ** 2) ** 0.5 for a in points for b in points if a is not b]
    assert min(gap for gap in gaps if gap > 0) >= 4


def test_asked_for_more():
    assert parse('harris:fixed_number_of_points=1', 500).asked_for(50).detector.number_of_points == 50
    assert parse('harris:anms=1', 500).asked_for(50).detector.anms_points == 50
    assert parse('harris', 500).asked_for(50) is None   # its threshold decides
