"""What is told of effects that only stand in for an unknown one."""

from impactscope.discrepancy.answer import stand_ins_told


def test_stand_ins_are_named_once_and_are_no_finding():
    (note,) = stand_ins_told(iter(['quantisation', 'zero_drift', 'quantisation']))
    assert note.count('quantisation') == 1
    assert 'zero_drift' in note
    assert 'no finding' in note


def test_nothing_is_told_where_nothing_stands_in():
    assert stand_ins_told([]) == ()
