"""What can go wrong. The messages are those of the command: they name the file, the place and a remedy."""

from __future__ import annotations

from typing import Any

__all__ = [
    "BuildError",
    "ClosedError",
    "DamagedError",
    "Error",
    "FileError",
    "MissingFileError",
    "SelectionError",
    "ShortfallWarning",
]


class Error(Exception):
    """Whatever this package raises by itself."""


class FileError(Error, OSError):
    """A file could not be opened or read, or was changed while it was open. Has ``errno`` and ``filename`` where the system gave them."""

    def __init__(self, message: str, errno: int | None = None, filename: Any = None) -> None:
        super().__init__(message)
        self.errno = errno
        self.filename = filename

    def __str__(self) -> str:
        # What OSError would say of its number and name is in the message.
        return str(self.args[0]) if self.args else ""


class MissingFileError(FileError, FileNotFoundError):
    """There is no such file."""


class DamagedError(Error, ValueError):
    """The file is no .chpm file, or it is damaged."""


class ClosedError(Error, ValueError):
    """The file was closed."""


class SelectionError(Error, ValueError):
    """The request makes no sense, or the file does not have what it asks for."""


class BuildError(Error, ValueError):
    """A mesh cannot be built, verified or measured: what is wrong with it, or with what was asked for."""


class ShortfallWarning(UserWarning):
    """A file gives less than was asked for."""
