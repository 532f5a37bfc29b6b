"""Where numba keeps compiled kernels, and when it compiles them again.

With `cache=True` numba keeps the machine code of a function on the disk, and compiles it again when
the file that holds the function has changed. It does not look at the files from which that function
takes others, whose code is in the same machine code. All kernels of a folder are therefore stamped
with one digest of all files of the folder.

The places stay numba's own: the folder NUMBA_CACHE_DIR where that is set, else `__pycache__` beside
the kernels, else, where that cannot be written, a folder of the user.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from numba.core import caching


@cache
def digest(folder: Path) -> str:
    """SHA-256 of the names and contents of all Python files of a folder, read once a process."""
    found = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        found.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()


def watch_package(path: Iterable[str]) -> None:
    """Compile every cached function of a package again after any file of its folder has changed.

    `path` is the `__path__` of the package.

    The locators of numba find a place for the cache of a function and the stamp that its source
    has. One that is put before them answers for the functions of the folder, and for no others.
    """
    folder = Path(next(iter(path)))

    class FolderStamp:
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
