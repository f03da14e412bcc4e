"""The exceptions of evrig; their texts are those of the command line."""

from __future__ import annotations


class Error(Exception):
    """Anything that evrig refuses or cannot do."""


class ArgumentError(Error, ValueError):
    """An argument is wrong: the text names it, what was expected and what was given."""


class FileError(Error):
    """A file cannot be read or written, or is not what it should be."""


class SessionError(Error):
    """A directory is not a session, or the session lacks what is asked of it."""


class AnalysisError(Error):
    """The data do not allow the analysis: the text says what is missing and what to do."""


for _kind in (Error, ArgumentError, FileError, SessionError, AnalysisError):
    _kind.__module__ = "evrig"
