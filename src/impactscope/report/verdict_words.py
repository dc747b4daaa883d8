"""How verdicts and quality flags read: word, meaning, sign, colour class."""

from __future__ import annotations

from dataclasses import dataclass

from impactscope.records import ContactKind, Quality, Verdict

__all__ = ['CONTACT_WORDS', 'VerdictWords', 'quality_sentences', 'verdict_words']


@dataclass(frozen=True, slots=True)
class VerdictWords:
    """A verdict for the eye; ``sign`` is an SVG path in a box of 24 by 24."""

    word: str
    meaning: str
    css: str
    sign: str


_TICK = 'M5 12.5l5 5 9-11'
_CROSS = 'M6 6l12 12M18 6l-12 12'
_QUESTION = 'M8 9a4 4 0 1 1 5.5 3.7c-1 .5-1.5 1.1-1.5 2.3v.5M12 19v.5'

_WORDS = {
    Verdict.PASS: VerdictWords(
        'PASS', 'Every judged force lies below its limit by more than the guard band.',
        'pass', _TICK,
    ),
    Verdict.CONDITIONAL_PASS: VerdictWords(
        'CONDITIONAL PASS',
        'Below every limit, but by less than the guard band: within the measurement '
        'uncertainty of a limit.',
        'conditional-pass', 'M4 9.5l4.5 4.5 8-9M4 20h16',
    ),
    Verdict.CONDITIONAL_FAIL: VerdictWords(
        'CONDITIONAL FAIL',
        'Above a limit, but by less than the guard band: within the measurement uncertainty '
        'of that limit.',
        'conditional-fail', 'M12 4v10M12 19v.5',
    ),
    Verdict.FAIL: VerdictWords(
        'FAIL',
        'Above a limit by more than the guard band, or contact with this body region is not '
        'permitted.',
        'fail', _CROSS,
    ),
    Verdict.INVALID: VerdictWords(
        'INVALID', 'The recording or the test cannot be judged; this is not a pass.',
        'invalid', _QUESTION,
    ),
    Verdict.INCOMPLETE: VerdictWords(
        'INCOMPLETE', 'Something that a judgement needs is not there; this is not a pass.',
        'incomplete', 'M5 12v.5M12 12v.5M19 12v.5',
    ),
}  # fmt: skip

_QUALITY = {
    Quality.CLIPPED: 'Clipped: samples at or beyond the range of the channel; the true peak '
    'is not known and is at least as large as the one shown.',
    Quality.GAP_BEFORE: 'Gap: samples were lost; what happened there is not known.',
    Quality.STALLED: 'Stalled: the device delivered late.',
    Quality.CLOCK_JUMP: 'Clock jump: the clock of the device was not continuous; times across '
    'the jump are not reliable.',
    Quality.NOT_FINITE: 'Not finite: NaN or infinite values were recorded.',
    Quality.MISSING: 'Missing: a channel has no samples here.',
    Quality.TORN: 'Torn: the stream began or ended inside the window of the event.',
    Quality.OVERLAPPING: 'Overlapping: another blow began before this one had come to rest.',
    Quality.COLD_START: 'Cold start: no quiet stretch before the blow, so that zero level and '
    'noise floor are not known.',
    Quality.HELD: 'Held: contact lasted beyond the longest hold of the measurement profile; '
    'what came later is not judged.',
}

CONTACT_WORDS = {
    ContactKind.UNKNOWN: 'not stated',
    ContactKind.CONSTRAINED: 'constrained (the body part cannot move away)',
    ContactKind.FREE: 'free (the body part can move away)',
}


def verdict_words(verdict: Verdict) -> VerdictWords:
    """Word, meaning and sign of a verdict."""
    return _WORDS[verdict]


def quality_sentences(quality: Quality) -> list[str]:
    """One sentence for each flag that is set, unknown ones included."""
    sentences = [text for flag, text in _QUALITY.items() if quality & flag]
    unknown = int(quality) & ~sum(int(flag) for flag in _QUALITY)
    if unknown:
        sentences.append(f'Unknown quality flags {unknown:#x}, set by another version.')
    return sentences
