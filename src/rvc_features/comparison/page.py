"""The report as one HTML page that needs nothing else: no network, no script, no other file."""

from __future__ import annotations

import base64
from html import escape
from typing import Iterator, Sequence

import cv2

from rvc_features.comparison import charts, pictures
from rvc_features.comparison.contestants import Contestant
from rvc_features.comparison.datasets import Dataset, Pair
from rvc_features.comparison.pair_task import Settings
from rvc_features.comparison.results import Measured
from rvc_features.comparison.summary import Section
from rvc_features.comparison.tables import HIGH, LOW, NEITHER, Cell, Column, Table

MARKS = ('Green: the best of its column. Pale green with ≈: not told apart from the best by these data; the 95 % '
         'bootstrap interval of the difference, over the same pairs, includes zero. '
         'Small figures: the 95 % interval of the mean, drawn over pairs (for times: the quartiles).')


def page(title: str, sections: Sequence[Section], measured: Sequence[Measured], datasets: Sequence[Dataset],
         contestants: Sequence[Contestant], settings: Settings, shown_pairs: dict[str, Pair],
         shown: dict[str, list[pictures.Picture]], command: str) -> str:
    body = [f'<h1>{escape(title)}</h1>', f'<p class="lead">{escape(scope(contestants, settings))}</p>',
            *(f'<p class="small">{escape(line)}</p>' for line in origin(measured, command)),
            '<div class="short"><h2>In short</h2><ul>',
            *(f'<li><b>{escape(section.title)}.</b> {" ".join(_in_short(section))}</li>' for section in sections),
            '</ul></div>']
    if len(sections) > 1:
        links = (f'<a href="#{section.kind}">{escape(section.title)}</a>' for section in sections)
        body.append(f'<p class="contents">{" · ".join(links)} · <a href="#settings">Settings</a></p>')
    for section in sections:
        body += _section(section, datasets, shown_pairs, shown, settings)
    body += _settings_part(measured, contestants, settings)
    return (f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
            f'<style>{_STYLE}</style></head>\n<body>\n' + '\n'.join(body) + '\n</body></html>\n')


def scope(contestants: Sequence[Contestant], settings: Settings) -> str:
    return (f'{len(contestants)} detector settings on the same images, one after the other; '
            f'of each image the {settings.points} strongest points of each are compared.')


def origin(measured: Sequence[Measured], command: str) -> list[str]:
    """When, on what machine and by which command the numbers were made; the same for the same results."""
    dates = sorted({pair.result['date'] for pair in measured})
    machines = list(dict.fromkeys(pair.result['machine'] for pair in measured))
    versions = list(dict.fromkeys(pair.result['versions']['rvc_features'] for pair in measured))
    return [f'Measured on {" to ".join(dict.fromkeys((dates[0], dates[-1])))} on {"; ".join(machines)}, with '
            f'rvc_features {", ".join(versions)}.', f'Made by: {command}']


def _in_short(section: Section) -> Iterator[str]:
    """What the table says, in sentences; nothing that it does not say."""
    table = section.table
    if table.pairs == 1:
        yield 'One pair only: an example, not a result.'
    elif table.pairs == 0:
        yield 'No pair of images: nothing is compared from one to the other.'
    for i, column in enumerate(table.columns):
        if column.key.rstrip('0123456789.') not in ('repeatability_', 'found_again_', 'matching', 'time'):
            continue
        cells = [(label, row[i]) for label, row in zip(table.labels, table.rows)]
        best = [(label, cell) for label, cell in cells if cell.best]
        if not best:
            continue
        title = column.title[:1].upper() + column.title[1:]
        unit = f'&nbsp;{column.unit}' if column.unit else ''
        sentence = (f'{escape(title)}: <b>{" and ".join(escape(label) for label, _ in best)}</b> '
                    f'({column.text(best[0][1].value)}{unit})')
        equals = [escape(label) for label, cell in cells if cell.as_good]
        yield sentence + (f', not told apart from it: {"; ".join(equals)}.' if equals else '.')


def _section(section: Section, datasets: Sequence[Dataset], shown_pairs: dict[str, Pair],
             shown: dict[str, list[pictures.Picture]], settings: Settings) -> Iterator[str]:
    own = [dataset for dataset in datasets if dataset.kind == section.kind]
    yield f'<h2 id="{section.kind}">{escape(section.title)}</h2><p>{escape(section.introduction)}</p><ul class="data">'
    for dataset in own:
        yield f'<li><b>{escape(dataset.name)}</b>: {escape(dataset.description)}</li>'
    yield '</ul>'
    yield _html_table(section.table, f'Mean over {section.table.basis()}')
    yield f'<p class="small">{escape(MARKS)}</p>'
    if section.notes:
        yield '<ul class="notes">' + ''.join(f'<li>{escape(note)}</li>' for note in section.notes) + '</ul>'
    yield '<dl class="small">' + ''.join(
        f'<dt>{escape(column.heading)}{_arrow(column)}</dt><dd>{escape(column.explanation)}</dd>'
        for column in section.table.columns) + '</dl>'

    yield '<h3>Curves</h3>' + charts.legend(section.table.labels) + '<div class="charts">'
    if section.epsilon_curve is not None:
        yield charts.lines(section.epsilon_curve, section.table.labels, evenly=False)
    yield charts.times(section.times, section.sweeps, section.table.labels) + '</div>'
    if any(section.sweeps):
        yield ('<p class="small">Time against points: the lines ask for ever more points on the first image of each '
               'of the data above, and show the medians; large dots are the medians over all images.</p>')
    if section.change_curves:
        yield (f'<h3>{escape(section.table.columns[0].title[:1].upper() + section.table.columns[0].title[1:])} '
               'over the size of the change</h3>' + charts.legend(section.table.labels) + '<div class="charts">')
        for curve in section.change_curves:
            yield charts.lines(curve, section.table.labels, evenly=True)
        yield '</div>'
    if section.epsilon_curve is not None and any(value is not None for value in section.epsilon_curve.chance):
        yield '<p class="small">Dotted: what points strewn at random would reach.</p>'

    for table in section.breakdowns:
        yield f'<details><summary>{escape(table.title)}, one by one</summary>{_html_table(table, "")}</details>'
    for dataset in own:
        if dataset.name in shown:
            yield from _pictures(dataset, shown_pairs[dataset.name], shown[dataset.name], settings)


def _pictures(dataset: Dataset, pair: Pair, drawn: Sequence[pictures.Picture], settings: Settings) -> Iterator[str]:
    yield f'<h3>The points on {escape(pair.group)}, {escape(pair.name)}</h3>'
    if pair.homography is not None:
        yield ('<p class="small">The second image of the pair. <span class="again">Blue</span>: found in the first '
               f'image too, within {min(settings.epsilons):g} px; <span class="not-again">orange</span>: not; grey: '
               'outside what the first image sees.</p>')
    yield '<div class="pictures">'
    for picture in drawn:
        _, data = cv2.imencode('.jpg', picture.image, [cv2.IMWRITE_JPEG_QUALITY, 80])
        yield (f'<figure><img alt="points of {escape(picture.label)}" src="data:image/jpeg;base64,'
               f'{base64.b64encode(data.tobytes()).decode()}"><figcaption><b>{escape(picture.label)}</b><br>'
               f'{escape(picture.caption)}</figcaption></figure>')
    yield '</div>'


def _html_table(table: Table, caption: str) -> str:
    head = ''.join(f'<th title="{escape(column.explanation)}">{escape(column.title)}'
                   f'{f"<br><small>{escape(column.unit)}</small>" if column.unit else ""}{_arrow(column)}</th>'
                   for column in table.columns)
    rows = []
    for number, (label, row) in enumerate(zip(table.labels, table.rows)):
        cells = ''.join(_html_cell(column, cell) for column, cell in zip(table.columns, row))
        rows.append(f'<tr><th><span class="swatch" style="background:{charts.colour(number)}"></span>{escape(label)}'
                    f'</th>{cells}</tr>')
    title = f'<caption>{escape(caption)}</caption>' if caption else ''
    return (f'<div class="scroll"><table>{title}<thead><tr><th></th>{head}</tr></thead>'
            f'<tbody>{"".join(rows)}</tbody></table></div>')


def _html_cell(column: Column, cell: Cell) -> str:
    kind = ' class="best"' if cell.best else ' class="as-good"' if cell.as_good else ''
    text = ('≈ ' if cell.as_good else '') + column.text(cell.value)
    if cell.low is not None and cell.high is not None and column.better != NEITHER:
        text += f'<small>{column.text(cell.low)} … {column.text(cell.high)}</small>'
    if cell.chance is not None:
        text += f'<small class="chance">chance {column.text(cell.chance)}</small>'
    return f'<td{kind} data-measure="{escape(column.heading)}"><span>{text}</span></td>'


def _arrow(column: Column) -> str:
    return {HIGH: ' <span class="arrow" title="higher is better">▲</span>',
            LOW: ' <span class="arrow" title="lower is better">▼</span>'}.get(column.better, '')


def _settings_part(measured: Sequence[Measured], contestants: Sequence[Contestant],
                   settings: Settings) -> Iterator[str]:
    yield ('<h2 id="settings">Settings</h2><p>Every parameter of every detector; bold where it is not the default.'
           '</p><div class="scroll"><table class="settings"><tbody>')
    for number, contestant in enumerate(contestants):
        changed = contestant.changed_settings()
        texts = (f'<b>{escape(name)}&nbsp;{escape(str(value))}</b>' if name in changed
                 else f'{escape(name)}&nbsp;{escape(str(value))}' for name, value in contestant.settings().items())
        yield (f'<tr><th><span class="swatch" style="background:{charts.colour(number)}"></span>'
               f'{escape(contestant.label)}</th><td class="text"><code>{escape(contestant.detector.name)}</code>: '
               f'{", ".join(texts)}</td></tr>')
    yield '</tbody></table></div><ul class="small">'
    yield (f'<li>{settings.points} strongest points; ε {", ".join(f"{e:g}" for e in settings.epsilons)} px; each '
           f'detector timed {settings.repeats} times on each image; seed {settings.seed}</li>')
    for what, values in (('Measured with', [_versions_text(pair.result['versions']) for pair in measured]),
                         ('Measured on', [pair.result['machine'] for pair in measured]),
                         ('Jobs at the same time', [str(pair.result['concurrent']) for pair in measured]),
                         ('Sizes of images', [f'{pair.shape[1]}x{pair.shape[0]}' for pair in measured])):
        yield f'<li>{what}: {escape("; ".join(dict.fromkeys(values)))}</li>'
    if any(pair.result['concurrent'] > 1 for pair in measured):
        yield '<li>Jobs ran at the same time and slowed each other down: compare times with care.</li>'
    yield '</ul>'


def _versions_text(versions: dict[str, str]) -> str:
    return ', '.join(f'{name} {version}' for name, version in versions.items())


_STYLE = '''
body { font: 16px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; color: #222; max-width: 1320px;
  margin: 2rem auto; padding: 0 1.5rem; background: #fff; }
h1 { font-size: 2rem; margin-bottom: .2rem; } h2 { margin-top: 2.8rem; border-bottom: 2px solid #eee; }
h3 { margin: 2rem 0 .4rem; } .lead { font-size: 1.1rem; color: #555; }
.short { background: #f4f7fa; border-left: 4px solid #0072b2; padding: .3rem 1.2rem; } .short h2 { margin: .6rem 0 0;
  border: 0; font-size: 1.2rem; }
code { overflow-wrap: anywhere; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: #555; padding-bottom: .3rem; }
th, td { padding: .35rem .55rem; text-align: right; border-bottom: 1px solid #e8e8e8; vertical-align: top; }
thead th { font-weight: 600; vertical-align: bottom; border-bottom: 2px solid #bbb; cursor: help; }
tbody th { text-align: left; font-weight: 600; white-space: nowrap; } td.text { text-align: left; }
td small { display: block; color: #777; font-size: .72rem; white-space: nowrap; } td small.chance { color: #999; }
td.best { background: #bfe5cf; font-weight: 700; } td.as-good { background: #eaf6ef; } td small { font-weight: 400; }
.arrow { color: #999; font-size: .7em; } .small { font-size: .85rem; color: #555; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; }
dt { font-weight: 600; } dd { margin: 0; }
.notes { background: #fff8e6; border-left: 4px solid #e69f00; padding: .5rem 1rem .5rem 2rem; font-size: .9rem; }
.swatch { display: inline-block; width: .8rem; height: .8rem; border-radius: 2px; margin-right: .5rem; }
.legend .key { margin-right: 1.2rem; white-space: nowrap; font-size: .85rem; }
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(380px, 100%), 1fr)); gap: 1rem; }
.chart { width: 100%; height: auto; } .chart text { font: 11px system-ui, "DejaVu Sans", sans-serif; fill: #666; }
.chart text.title { font-size: 13px; font-weight: 600; fill: #222; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(290px, 100%), 1fr)); gap: 1rem; }
figure { margin: 0; } figure img { width: 100%; display: block; } figcaption { font-size: .85rem; }
.again { color: #1e8ceb; font-weight: 600; } .not-again { color: #d96a00; font-weight: 600; }
details { margin: .5rem 0; } summary { cursor: pointer; font-weight: 600; } .settings td { font-size: .85rem; }
p, li, td.text { overflow-wrap: anywhere; }
@media (max-width: 760px) { body { padding: 0 .7rem; margin: 1rem auto; } .legend .key { white-space: normal; }
  dl, table, tbody, tr, caption { display: block; } thead { display: none; }
  tbody th { display: block; padding-top: 1rem; white-space: normal; border-bottom: 2px solid #bbb; }
  td { display: flex; justify-content: space-between; gap: 1rem; } td.text { display: block; }
  td::before { content: attr(data-measure); text-align: left; color: #555; font-weight: 400; }
  dd { margin-bottom: .5rem; } td small { white-space: normal; } }
@media print { details { display: block; } }
'''
