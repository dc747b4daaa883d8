"""The command line ``impactscope``.

Exit codes: 0 done, and where something was judged it is PASS or CONDITIONAL_PASS; 1 FAIL or
CONDITIONAL_FAIL; 2 wrong usage or configuration; 3 a recording cannot be read, or not to its
end; 4 INVALID; 5 INCOMPLETE.
"""

from impactscope.cli.program import app, main

__all__ = ['app', 'main']
