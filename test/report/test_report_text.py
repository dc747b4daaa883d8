import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impactscope.records import ContactKind, Quality, Verdict
from impactscope.report.plain_text import flatten, printable
from impactscope.report.verdict_words import CONTACT_WORDS, quality_sentences, verdict_words


@pytest.mark.parametrize(
    ('text', 'shown'),
    [
        ('Prüfstand 3, Höhe 0,42 m 測試', 'Prüfstand 3, Höhe 0,42 m 測試'),
        ('a\x00b\x1b[31m', 'a[U+0000]b[U+001B][31m'),
        ('PASS\u202eLIAF', 'PASS[U+202E]LIAF'),  # would read backwards
        ('\ud800', '[U+D800]'),  # half a surrogate pair: no file can hold it
        ('two\nlines', 'two\nlines'),
    ],
)
def test_hidden_characters_are_shown(text, shown):
    assert printable(text) == shown


@given(st.text(st.characters(), max_size=50))
def test_whatever_is_printed_can_be_written(text):
    printable(text).encode()


def test_long_texts_are_cut_and_say_so():
    assert printable('x' * 5000, 100) == 'x' * 100 + ' ... (4900 more characters)'


def test_parameters_are_flattened():
    rows = flatten(
        {
            'a': {'b': 1.5, 'c': {'d': True}},
            'e': [1, 2],
            'f': None,
            'g': list(range(300)),
            'h': 'x',
        }
    )
    assert rows[:4] == [('a.b', '1.5'), ('a.c.d', 'yes'), ('e', '1, 2'), ('f', 'none')]
    assert rows[4][1].endswith('(100 more)')
    assert rows[5] == ('h', 'x')
    assert flatten({'n': np.float64(0.25)}) == [('n', '0.25')]


def test_every_verdict_has_its_own_word_sign_and_colour():
    words = [verdict_words(v) for v in Verdict]
    for part in ('word', 'sign', 'css', 'meaning'):
        assert len({getattr(w, part) for w in words}) == len(Verdict)
    for verdict in (Verdict.INVALID, Verdict.INCOMPLETE):
        assert 'not a pass' in verdict_words(verdict).meaning
    assert set(CONTACT_WORDS) == set(ContactKind)


def test_every_flag_has_a_sentence():
    for flag in Quality:
        assert len(quality_sentences(flag)) == (flag != Quality.NONE)
    assert len(quality_sentences(Quality.CLIPPED | Quality.HELD)) == 2
    assert 'Unknown quality flags 0x4000' in quality_sentences(Quality(0x4000 | 1))[1]
