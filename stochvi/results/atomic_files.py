"""Writing of files: each is written whole or not at all, even by several processes at once."""

from __future__ import annotations

import contextlib
import errno
import os
import time
import uuid
from pathlib import Path

REPLACE_ATTEMPTS = 5
"""Number of attempts to replace a file, which on Windows another program may have open briefly."""

REPLACE_PAUSE = 0.02
"""Seconds between two attempts to replace a file."""


def write_whole(data: bytes, path: Path, *, durable: bool = False, follow: bool = True) -> None:
    """Write a file whole or not at all.

    With `durable`, the file is on the disk when this function returns. With `follow`, the target of
    a symbolic link is written; otherwise the file replaces the link.

    The bytes are first written to a hidden file in the same folder, which then replaces the file.
    Two processes that write the same file never mix their bytes. A process that is killed in
    between (`kill -9`) leaves the hidden file behind.

    Raises
    ------
    OSError
        It names the file that was asked for. No hidden file remains.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "Is a folder, expected a file name", str(path))
    try:
        _write_then_replace(data, Path(os.path.realpath(path)) if follow else path, durable)
    except OSError as error:  # this error names the hidden file, or no file
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _write_then_replace(data: bytes, path: Path, durable: bool) -> None:
    part = path.with_name(f".{path.name}.{uuid.uuid4().hex[:16]}")
    try:
        with open(part, "xb") as file:  # with the permissions that the user gives new files
            file.write(data)
            file.flush()
            if durable:
                os.fsync(file.fileno())
        _replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise


def _replace(part: Path, path: Path) -> None:
    """Put the file `part` in place of `path`.

    Windows refuses this while any other program, such as a virus scanner, has `path` open, which
    is usually over soon; other systems never refuse it for that reason.
    """
    for _ in range(REPLACE_ATTEMPTS - 1):
        try:
            return os.replace(part, path)
        except PermissionError:
            time.sleep(REPLACE_PAUSE)
    os.replace(part, path)
