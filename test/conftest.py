"""Every run has a ROS domain of its own, on this machine alone."""

import os

from hypothesis import settings

os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
if 'PYTEST_XDIST_WORKER' in os.environ:  # others have the cores: threads would wait for each other
    os.environ.setdefault('IMPACTSCOPE_THREADS', '1')
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)

# The first call of a compiled function takes longer than any deadline.
settings.register_profile('compiled', deadline=None)
settings.load_profile('compiled')
