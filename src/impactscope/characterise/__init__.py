"""Constants of springs and damper layers from tests on a compression machine."""

from impactscope.characterise.command import main
from impactscope.characterise.static_test import StaticTest, read_static_test

__all__ = ['StaticTest', 'main', 'read_static_test']
