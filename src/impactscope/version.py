"""The version of this software, as it stands in package.xml and in every report."""

__version__ = '0.1.0'
