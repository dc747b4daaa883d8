import json
import re
from html.parser import HTMLParser

import pytest
from rich.console import Console

from impactscope.errors import ConfigurationError
from impactscope.paper import main, render_paper
from impactscope.paper.page import difference_text, value_text
from impactscope.paper.row import Basis, row


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp('paper')
    console = Console(record=True, width=160, file=(folder / 'out.txt').open('w'))
    code = main(folder / 'paper.json', folder / 'paper.html', console)
    return code, folder, console.export_text()


def test_command_prints_and_writes(made):
    code, folder, text = made
    assert code == 0
    content = json.loads((folder / 'paper.json').read_text(encoding='utf-8'))
    assert f'{len(content["rows"])} rows' in text
    assert '50.12' in text
    assert all(isinstance(item['computed'], float) for item in content['rows'])


def test_a_narrow_terminal_gets_the_numbers_without_remarks(tmp_path):
    console = Console(record=True, width=100, file=(tmp_path / 'out.txt').open('w'))
    assert main(None, None, console) == 0
    text = console.export_text()
    assert '50.12' in text
    assert '…' not in text
    assert 'it is the sum' not in text.lower()


def test_page_draws_every_figure_of_the_paper(made):
    page = (made[1] / 'paper.html').read_text(encoding='utf-8')
    for figure in ('6a', '6b', '6c', '7', '8', '9', '10', '11a', '11b', '12', '13'):
        assert f'<h4>Fig. {figure} ' in page, figure
    assert 'Map of the peak error' in page
    for anchor in ('32.85', '50.12', '175', '32.1 Hz', '2.68'):
        assert anchor in page


class _Checker(HTMLParser):
    """Every element is closed, in order; every id is there once."""

    VOID = frozenset({'meta', 'br', 'link', 'img', 'input', 'hr'})

    def __init__(self):
        super().__init__()
        self.open, self.ids = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        self.ids += [value for key, value in attrs if key == 'id']

    def handle_startendtag(self, tag, attrs):
        self.ids += [value for key, value in attrs if key == 'id']

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_well_formed_and_stands_alone(made):
    page = (made[1] / 'paper.html').read_text(encoding='utf-8')
    checker = _Checker()
    checker.feed(page)
    assert checker.open == []
    assert len(checker.ids) == len(set(checker.ids))
    assert not re.search(r'(src|href)="(?!#|https://doi\.org)', page)
    assert 'NaN' not in page
    assert 'nan' not in re.sub(r'<[^>]*>', '', page).lower().split()


def test_page_escapes_what_a_row_says():
    hostile = row('2.1:x', '<script>a_b</script>', 'kg', '1', 3.0, '"><img src=x> ω_n')
    page = render_paper({'<b>part</b>': [hostile]})
    assert '<script>a' not in page
    assert '<img' not in page
    assert '<b>part' not in page
    assert 'ω<sub>n</sub>' in page


def test_a_file_that_cannot_be_written_is_an_error_of_usage(tmp_path):
    console = Console(file=(tmp_path / 'out.txt').open('w'))
    with pytest.raises(ConfigurationError, match='cannot be written'):
        main(tmp_path / 'no_such_folder' / 'paper.json', None, console)


def test_numbers_keep_more_digits_than_the_paper_prints():
    assert value_text(row('3:a', 'q', 'Hz', '50.12', 50.121273)) == '50.121'
    assert value_text(row('3:a', 'q', 'N', '10', 10.0, basis=Basis.GIVEN)) == '10'
    assert difference_text(row('3:a', 'q', 'Hz', '', 1.0)) == ''
    assert difference_text(row('3:a', 'q', 'Hz', '50', 51.0)) == '+1 (+2 %)'
