"""Every error this package raises on purpose.

Each message is one sentence that says what is wrong, where, and which value offends.
"""


class ImpactscopeError(Exception):
    """Base of all errors raised on purpose."""


class ConfigurationError(ImpactscopeError, ValueError):
    """A parameter, profile, limit set or test point is missing, unknown or out of range."""


class InputError(ImpactscopeError, ValueError):
    """Samples or records contradict their own description (shape, unit, rate, order)."""


class RecordingError(ImpactscopeError):
    """A recording cannot be read: missing, empty, of an unknown format, or not a recording."""


class TornRecordingError(RecordingError):
    """A recording ends in the middle; what was readable has been delivered before this."""


class MissingChannelError(RecordingError):
    """A recording or a stream lacks a channel or topic that was asked for."""


class EstimationError(ImpactscopeError):
    """The data cannot tell what was asked for; the message says why."""
