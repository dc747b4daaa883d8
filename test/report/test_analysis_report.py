import base64
import dataclasses
import enum
import hashlib
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from impactscope.errors import InputError
from impactscope.records import (
    Estimate,
    Quality,
    Verdict,
)
from impactscope.report import render_report, write_report

VOID = {'meta'}
HOSTILE = (
    '<script>alert(1)</script>',
    '"></div></table></section>',
    "' onload='alert(1)",
    '</title></style></script><img src=x onerror=alert(1)>',
    'javascript:alert(1)',
    '{{ 7 * 7 }}{% raw %}',
    ']]><!--',
    'a\x00b\u202e\ud800',
)


class Page(HTMLParser):
    """What a browser would make of a page, and whether its elements nest."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.raw: dict[str, list[str]] = {'style': [], 'script': []}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in self.raw:
            self.raw[self.open[-1]].append(data)
        else:
            self.text.append(data)

    @property
    def words(self) -> str:
        return re.sub(r'\s+', ' ', ' '.join(self.text))


def check_page(text: str) -> Page:
    """Hold every promise that a page makes whatever it reports."""
    page = Page(text)
    text.encode()
    ids = [a['id'] for _, a in page.elements if 'id' in a]
    assert len(ids) == len(set(ids))
    for tag, attributes in page.elements:
        assert tag not in {'img', 'iframe', 'object', 'embed', 'link', 'form', 'base', 'image'}
        assert not any(name.startswith('on') for name in attributes)
        assert 'src' not in attributes
        assert 'style' not in attributes  # the policy would refuse it
        if 'href' in attributes:
            assert attributes['href'][0] == '#'
            assert attributes['href'][1:] in ids
        if tag == 'svg' and 'figure' in (attributes.get('class') or ''):
            assert attributes['aria-label']
    (policy,) = (
        a['content'] for t, a in page.elements if a.get('http-equiv') == 'Content-Security-Policy'
    )
    assert policy.startswith("default-src 'none'")
    for kind in ('style', 'script'):
        (content,) = page.raw[kind]
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
        assert not re.search(r'https?://(?!www\.w3\.org/2000/svg)|@import|url\(', content)
    assert 'not a safety function' in page.words
    assert 'never commands a robot' in page.words
    return page


def poisoned(value, text):
    """The same record with every string replaced and every mapping poisoned."""
    if isinstance(value, str):
        return text
    if isinstance(value, dict):
        changed = {k: poisoned(v, text) for k, v in value.items()}
        return {**changed, text: next(iter(changed.values()), text)}
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value)]
        return dataclasses.replace(value, **{n: poisoned(getattr(value, n), text) for n in names})
    if type(value) is tuple:
        return tuple(poisoned(v, text) for v in value)
    return value


def without_numbers(value, number):
    """The same record with every float replaced by ``number``."""
    if isinstance(value, Estimate):
        return Estimate(number, number)
    if isinstance(value, enum.Enum | bool):
        return value
    if isinstance(value, float):
        return number
    if isinstance(value, np.ndarray):
        return np.full_like(value, number)
    if isinstance(value, dict):
        return {k: without_numbers(v, number) for k, v in value.items()}
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value)]
        return dataclasses.replace(
            value, **{n: without_numbers(getattr(value, n), number) for n in names}
        )
    if type(value) is tuple:
        return tuple(without_numbers(v, number) for v in value)
    return value


def test_a_pass_shows_everything_a_reader_needs(make_event, make_result):
    result = make_result(tuple(make_event(i) for i in (1, 2, 3)))
    text = render_report(result)
    page = check_page(text)
    words = page.words
    assert text.index('<p class="word">PASS</p>') < text.index('<table')  # the verdict first
    for expected in (
        'The transient force of 196 N lies 84 N below the limit of 280 N for hands / fingers.',
        'pendulum_campaign.mcap', 'ab' * 32, 'Impactscope 0.1.0', 'ISO/TS 15066:2016 Annex A 1',
        'impactscope_default 1', 'ILAC-G8:09/2019', 'k = 2', 'Example Cobot 10, firmware 5.14.2',
        '(75.00 ± 0.80) N/mm', 'constrained', '32.340 ± 0.042', '0.0692 ± 0.0013',
        'Natural frequency', 'R² of the fit', 'longest_wait', 'threshold_sigma',
        'measurement_profile.transient_window', 'licence', 'transient limit', '280 N',
        'quasi-static limit', '140 N', 'Acceleration, plate', 'Free oscillation and fit',
        'Amplitude spectrum', 'every peak is kept', '2026-11-18 11:06:50.000 UTC',
        'Simulated recording',
    ):  # fmt: skip
        assert expected in words, expected
    assert text == render_report(result)  # same result, same page


def drawn_curve(text: str, title: str) -> list[str]:
    part = text[text.index(f'<h4>{title}</h4>') :]
    return re.findall(
        r'<path class="(?:curve|limit|rule) ([\w-]+)"', part[: part.index('</figure>')]
    )


def test_figures_hold_limits_phases_and_fit(make_event, make_result):
    text = render_report(make_result((make_event(1),)))
    whole = drawn_curve(text, 'Force over the whole event')
    assert {'measured', 'transient-limit', 'quasi-static-limit'} <= set(whole)
    assert 'fit' in drawn_curve(text, 'Free oscillation and fit')
    assert 'fit' in drawn_curve(text, 'Amplitude spectrum of the free oscillation')
    for phase in ('before', 'transient', 'contact', 'ring-down', 'guard'):
        assert f'<rect class="{phase}"' in text
    assert '<rect class="quasi-static"' not in text  # contact had ended within the window
    held = render_report(make_result((make_event(1, held=90.0, duration=2.5),)))
    assert '<rect class="quasi-static"' in held


@pytest.mark.parametrize('verdict', list(Verdict))
def test_every_verdict_is_said_in_word_colour_and_reason(make_event, make_result, verdict):
    event = make_event(1, rate=1000.0, verdict=verdict, reasons=('A reason of its own.',))
    text = render_report(make_result((event,), verdict))
    page = check_page(text)
    css = verdict.name.lower().replace('_', '-')
    assert f'class="verdict v-{css}"' in text
    banner = text[text.index('class="verdict') : text.index('class="facts"')]
    assert 'A reason of its own.' in banner
    assert f'<p class="word">{verdict.name.replace("_", " ")}</p>' in banner
    assert verdict.name.replace('_', ' ') in page.words


def test_zero_events(make_result):
    page = check_page(render_report(make_result((), Verdict.INCOMPLETE)))
    assert 'No blow was found' in page.words
    assert 'INCOMPLETE' in page.words
    assert not re.search(r'\bPASS\b', page.words[: page.words.index('How to read', 300)])


@pytest.mark.parametrize('text', HOSTILE)
def test_hostile_strings_are_only_text(make_event, make_result, text):
    honest = make_result((make_event(1, rate=1000.0), make_event(2, rate=1000.0)), Verdict.FAIL)
    hostile = poisoned(honest, text)
    assert hostile.events[0].event.channels[0].name == text
    drawn = render_report(hostile)
    page = check_page(drawn)
    assert len(page.raw['script']) == 1
    assert '<h1>49' not in drawn  # no template is run from a recording
    structure = {'section', 'table', 'h2', 'script', 'style', 'figure'}
    reference = check_page(render_report(poisoned(honest, 'plain')))
    assert [t for t, _ in page.elements if t in structure] == [
        t for t, _ in reference.elements if t in structure
    ]


@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf, 0.0, -1.0, 1e30])
def test_numbers_that_say_nothing(make_event, make_result, number):
    result = without_numbers(make_result((make_event(1, rate=1000.0),)), number)
    text = render_report(result)
    check_page(text)
    assert not re.search(r'="[^"]*\b(?:nan|inf)\b', text)


def test_samples_partly_missing(make_event, make_result):
    item = make_event(1, quality=Quality.GAP_BEFORE | Quality.NOT_FINITE)
    values = item.event.values.copy()
    values[0, 1500:1600] = np.nan
    values[1] = np.nan
    values[2, 100] = np.inf
    event = dataclasses.replace(item.event, values=values)
    text = render_report(make_result((dataclasses.replace(item, event=event),)))
    words = check_page(text).words
    assert 'samples were lost' in words
    assert 'No finite samples here.' in words


def test_an_event_without_samples_or_channels(make_event, make_result):
    item = make_event(1)
    empty = dataclasses.replace(item.event, values=item.event.values[:, :0])
    bare = dataclasses.replace(empty, channels=(), values=np.empty((0, 0), np.float32))
    for event in (empty, bare):
        result = make_result((dataclasses.replace(item, event=event),), Verdict.INVALID)
        assert 'no samples to draw' in check_page(render_report(result)).words


def test_values_must_match_their_channels(make_event, make_result):
    item = make_event(7)
    event = dataclasses.replace(item.event, values=item.event.values[:2])
    with pytest.raises(InputError, match='event 7'):
        render_report(make_result((dataclasses.replace(item, event=event),)))


def test_a_signal_that_is_not_a_force_gets_no_limits(make_event, make_result):
    item = make_event(1, verdict=Verdict.INVALID)
    channels = tuple(dataclasses.replace(c, name='angle', unit='rad') for c in item.event.channels)
    event = dataclasses.replace(item.event, channels=channels)
    text = render_report(make_result((dataclasses.replace(item, event=event),), Verdict.INVALID))
    check_page(text)
    assert set(drawn_curve(text, 'angle')) == {'measured'}
    assert '<rect class="transient"' not in text
    assert 'Peak, rad' in text
    assert 'Peak, N' not in text


def test_what_is_missing_is_said_to_be(make_event, make_result):
    item = make_event(1)
    bare = dataclasses.replace(item.verdict.test_point, robot='', device='', speed=math.nan)
    verdict = dataclasses.replace(item.verdict, test_point=bare)
    text = render_report(make_result((dataclasses.replace(item, verdict=verdict),)))
    check_page(text)
    assert text.count('class="missing"') == 3


def test_many_events_are_all_there_and_listed(make_event, make_result):
    items = tuple(make_event(i, rate=1000.0) for i in range(1, 51))
    page = check_page(render_report(make_result(items)))
    links = [a['href'] for t, a in page.elements if t == 'a']
    for position in range(1, 51):
        assert links.count(f'#event-{position}') >= 3  # contents, test point, summary


def test_the_same_event_number_in_two_streams(make_event, make_result):
    twice = (make_event(1), make_event(1))
    check_page(render_report(make_result(twice)))


def test_huge_windows_stay_small_and_keep_their_peak(make_event, make_result):
    item = make_event(1, rate=51_200.0, duration=7.0)
    values = item.event.values.copy()
    values[0, 200_001] = 431.0  # one sample, far from the contacts
    event = dataclasses.replace(item.event, values=values)
    text = render_report(make_result((dataclasses.replace(item, event=event),)))
    check_page(text)
    assert len(text) < 250_000
    assert '358400 samples drawn as 2400 points' in text
    part = text[text.index('<h4>Force over the whole event</h4>') :]
    top = float(re.search(r'data-y1="([\d.e+-]+)"', part).group(1))
    bottom = float(re.search(r'data-y0="([\d.e+-]+)"', part).group(1))
    path = re.search(r'class="curve measured" data-name[^>]* d="([^"]*)"', part).group(1)
    numbers = [int(n) for n in re.findall(r'-?\d+', path)]
    rows = np.cumsum(numbers[1::2])
    assert top - (top - bottom) * rows.min() / 8000 == pytest.approx(431.0 - 2.5, rel=1e-3)


def test_without_a_stated_window_the_default_profile_speaks(make_event, make_result):
    named = render_report(make_result((make_event(1),), parameters={}))
    assert '<rect class="transient"' in named
    item = make_event(1)
    other = dataclasses.replace(item.verdict, measurement_profile='own 3')
    text = render_report(
        make_result((dataclasses.replace(item, verdict=other),), parameters={'a': {}})
    )
    check_page(text)
    assert '<rect class="transient"' not in text
    assert 'length of the transient window is not stated' in text


def test_writing_is_all_or_nothing(tmp_path, make_event, make_result, monkeypatch):
    path = tmp_path / 'report.html'
    path.write_text('what stood here')
    result = make_result((make_event(1),))

    def full(_descriptor):
        raise OSError(28, 'No space left on device')

    with monkeypatch.context() as patch:
        patch.setattr('impactscope.report.page.os.fsync', full)
        with pytest.raises(OSError, match='No space'):
            write_report(result, path)
    assert path.read_text() == 'what stood here'
    write_report(result, path)
    assert path.read_text(encoding='utf-8') == render_report(result)
    assert [p.name for p in tmp_path.iterdir()] == ['report.html']
