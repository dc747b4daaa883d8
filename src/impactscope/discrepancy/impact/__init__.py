"""Missing physics of benches that are struck: taps, pendulums, robots, falling bodies."""

from impactscope.discrepancy.impact.explain import explain_impact

__all__ = ['explain_impact']
