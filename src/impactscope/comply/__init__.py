"""Compliance: from a blow to a verdict against the limits of the body region that was tested."""

from impactscope.comply.compliance import Compliance, final_verdicts, judge_recording
from impactscope.comply.limits import LimitSet
from impactscope.comply.rules import JudgementRules
from impactscope.comply.severity import worst

__all__ = [
    'Compliance',
    'JudgementRules',
    'LimitSet',
    'final_verdicts',
    'judge_recording',
    'worst',
]
