"""A file is written whole or not at all, by however many processes at once."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
import time
from pathlib import Path

REPLACE_ATTEMPTS = 5
"""Number of attempts to replace a file, because on Windows it may be open for a moment."""

REPLACE_PAUSE = 0.02
"""Seconds between two attempts to replace a file."""


def write_whole(data: bytes, path: Path, *, durable: bool = False, follow: bool = True) -> None:
    """Write a file whole or not at all. `durable`: it is on the disk when this returns. `follow`:
    what a link names is written; otherwise the file takes the place of the link.

    The bytes go to a file of its own name beside it, hidden, which then takes its place: two that
    write one file never mix. What dies in between (`kill -9`) leaves that hidden file behind.

    Raises
    ------
    OSError
        With the name of the file that was asked for; nothing is left then.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "Is a folder, expected a file name", str(path))
    try:
        _write_beside(data, path.resolve() if follow else path, durable)
    except OSError as error:  # it would name the hidden file, or none
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _write_beside(data: bytes, path: Path, durable: bool) -> None:
    handle, part = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with open(handle, "wb") as file:
            file.write(data)
            file.flush()
            if durable:
                os.fsync(file.fileno())
        os.chmod(part, 0o666 & ~_umask())
        _replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise


def _replace(part: str, path: Path) -> None:
    """Put the file `part` in the place of `path`.

    Windows refuses this while any other program, such as a virus scanner, has `path` open, which
    is usually over soon; other systems never refuse it for that reason.
    """
    for _ in range(REPLACE_ATTEMPTS - 1):
        try:
            return os.replace(part, path)
        except PermissionError:
            time.sleep(REPLACE_PAUSE)
    os.replace(part, path)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
