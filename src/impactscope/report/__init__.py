"""The report of an analysis: one self-contained HTML file."""

from impactscope.report.analysis_report import render_report, write_report

__all__ = ['render_report', 'write_report']
