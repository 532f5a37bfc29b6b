"""A file is written whole or not at all, by however many processes at once."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from pathlib import Path


def write_whole(data: bytes, path: Path, *, durable: bool = False) -> None:
    """Write a file whole or not at all; a link is followed. `durable`: it is on the disk when
    this returns.

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
        _write_beside(data, path.resolve(), durable)
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
        os.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
