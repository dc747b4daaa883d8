"""Missing physics of driven systems, prescribed motions, free motions and measuring chains."""

from impactscope.discrepancy.driven.explain import explain_driven

__all__ = ['explain_driven']
