"""The concealed examination of the search for missing physics.

Shares no code with the simulator or the search it examines. ``python -m impactscope.proof``
draws campaigns, seals what is hidden in them, has them explained, and scores the answers.
"""
