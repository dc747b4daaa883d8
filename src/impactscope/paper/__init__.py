"""The published numbers and figures of the paper, computed anew beside what it prints."""

from impactscope.paper.command import main
from impactscope.paper.page import render_paper
from impactscope.paper.row import Basis, PaperRow, Standing
from impactscope.paper.table import rows

__all__ = ['Basis', 'PaperRow', 'Standing', 'main', 'render_paper', 'rows']
