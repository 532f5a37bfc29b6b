"""Where numba keeps compiled kernels, when it compiles them again, and which process does.

With `cache=True` numba keeps the machine code of a function on the disk, and compiles it again when
the file that holds the function has changed. It does not look at the files of the functions
that this one calls, although their code is compiled into its own. All kernels of a folder are
therefore stamped with one digest of all files of the folder.

The places stay numba's own: the folder NUMBA_CACHE_DIR where that is set, else `__pycache__` beside
the kernels, else, where that cannot be written, a folder of the user.

Processes that start together need the same kernels. One of them compiles a kernel while the others
wait, and then they load it. With numba alone each of them compiles it; and where two write into the
index of a function at the same time, one entry is lost, or it names the machine code of the other.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import os
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cache
from pathlib import Path

from numba.core import caching, dispatcher
from numba.core.errors import NumbaError

try:
    import fcntl
except ImportError:  # Windows has no such locks: there every process compiles what it needs
    fcntl = None

PATIENCE = 120.0
"""Longest wait, s, for another process that compiles the same kernel: several times what the
largest kernel takes. A process that has waited so long compiles the kernel itself, because the
other one may have been suspended."""

BETWEEN_ATTEMPTS = 0.02
"""Time, s, between two attempts to get a lock that another process has."""


around_waiting: list[Callable[[], AbstractContextManager[Callable[[], None]]]] = [
    lambda: nullcontext(lambda: None)
]
"""What makes the context in which another process is waited for, as the only entry; the function
that the context gives is called before each attempt, and may end the waiting by an exception."""


@cache
def digest(folder: Path) -> str:
    """SHA-256 of the names and contents of all Python files of a folder, read once a process."""
    found = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        found.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()


class Watched:
    """Marks the places of caches whose functions are stamped with the digest of their folder."""


@cache
def lock_file(folder: str) -> int | None:
    """Descriptor of the file of locks on the caches of a folder, or None where there are no locks.

    The locks lie on bytes beyond its end. The system takes them back when a process ends, however
    it ends, and a process never waits for itself.
    """
    if fcntl is None:
        return None
    with suppress(OSError):
        return os.open(Path(folder) / "kernels.lock", os.O_RDWR | os.O_CREAT, 0o666)
    return None


def locked(file: int, byte: int) -> bool | None:
    """Whether this process has the lock now; None in a file system without locks."""
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return None
    return True


@contextmanager
def in_turn(kept, work: str) -> Iterator[None]:
    """Let other processes wait with the same work on the cache of a watched function."""
    watched = isinstance(kept, caching.FunctionCache) and isinstance(kept._impl.locator, Watched)
    file = lock_file(kept.cache_path) if watched else None
    if file is None:
        yield
        return
    byte = zlib.crc32(f"{kept._impl.filename_base} {work}".encode())
    if locked(file, byte) is False:  # another process has it
        end = time.monotonic() + PATIENCE
        with around_waiting[0]() as look:
            while locked(file, byte) is False and time.monotonic() < end:
                look()
                time.sleep(BETWEEN_ATTEMPTS)
    try:
        yield
    finally:
        with suppress(OSError):
            fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)


@contextmanager
def without_collections() -> Iterator[None]:
    """Let Python not search for garbage: of the time that numba compiles, a sixth went there."""
    collected = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collected:
            gc.enable()


def empty(kept) -> None:
    """Forget what the cache of a function holds; where that cannot be written, do without it."""
    try:
        kept.flush()
    except OSError:
        kept.disable()


@cache
def compile_in_turn() -> None:
    """Have numba wait for other processes that compile the same kernel or write the same index."""
    compile_alone = dispatcher.Dispatcher.compile
    save_alone = caching.FunctionCache.save_overload

    @functools.wraps(compile_alone)
    def compile(self, sig):
        with in_turn(self._cache, str(sig)), without_collections():
            try:
                return compile_alone(self, sig)
            except NumbaError:
                raise
            except Exception:  # what the cache holds cannot be loaded: anything may be raised
                empty(self._cache)
                return compile_alone(self, sig)

    @functools.wraps(save_alone)
    def save_overload(self, sig, data):
        with in_turn(self, "index"):
            save_alone(self, sig, data)

    dispatcher.Dispatcher.compile = compile
    caching.FunctionCache.save_overload = save_overload


def watch_package(path: Iterable[str]) -> None:
    """Compile every cached function of a package again after any file of its folder has changed.

    Of several processes that need it, one compiles it.

    `path` is the `__path__` of the package.

    The locators of numba find a place for the cache of a function and the stamp that its source
    has. One that is put before them answers for the functions of the folder, and for no others.
    """
    compile_in_turn()
    folder = Path(next(iter(path)))

    class FolderStamp(Watched):
        def get_source_stamp(self) -> str:
            return digest(folder)

        @classmethod
        def from_function(cls, function, file):
            inside = Path(file).parent == folder and folder.is_dir()
            return super().from_function(function, file) if inside else None

    # private names of numba: where a version lacks this class, its own rule stands
    stamped_by_file = getattr(caching, "_SourceFileBackedLocatorMixin", ())
    known = caching.CacheImpl._locator_classes
    known[:0] = [
        type(f"{each.__name__}OfFolder", (FolderStamp, each), {})
        for each in known
        if issubclass(each, stamped_by_file)
    ]
