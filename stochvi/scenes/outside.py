"""Parts of other packages beside those that ship: laws, excitations, structures, profiles, readers
of files, and commands."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

from stochvi.notices import PartWarning

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from numpy.typing import ArrayLike

Part = TypeVar("Part")

PACKAGES: dict[str, str] = {}
"""Name and version of each package whose parts were loaded, by the module that holds them."""


class Parts(dict[str, Part]):
    """The parts of a group by their names: those that ship, and those of other packages.

    A package names its part as an entry point, of the group "stochvi.laws" and so on. Only a name
    that is not known here is looked for among entry points: that takes time, and runs code of
    others. What ships keeps its name.

    Parameters
    ----------
    group
        The group, as "laws".
    own
        The parts that ship.
    checked
        Returns the part that an entry point of a name holds, or raises what is wrong with it.
    """

    def __init__(
        self, group: str, own: Mapping[str, Part], checked: Callable[[str, Any], Part]
    ) -> None:
        super().__init__(own)
        self.group = f"stochvi.{group}"
        self.checked = checked
        self._tried: set[tuple[str, str]] = set()

    def __contains__(self, name: object) -> bool:
        if not super().__contains__(name):
            self._take(each for each in entry_points(self.group) if each.name == name)
        return super().__contains__(name)

    def __missing__(self, name: str) -> Part:
        if name in self:
            return self[name]
        raise KeyError(name)

    def get(self, name: str, default: Any = None) -> Any:
        return super().get(name, default) if name in self else default

    def with_others(self) -> Self:
        """The same parts, with all of other packages."""
        self._take(entry_points(self.group))
        return self

    def _take(self, entries: Iterable[EntryPoint]) -> None:
        for entry in entries:
            if (entry.name, entry.value) in self._tried:
                continue
            self._tried.add((entry.name, entry.value))
            origin = f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.module
            try:
                if super().__contains__(entry.name):
                    raise ValueError("another part has this name")
                self[entry.name] = self.checked(entry.name, entry.load())
            except (Exception, SystemExit) as error:
                # whatever ails a part of others, the commands that do not need it go on
                warnings.warn(
                    f"{entry.name} of {origin} ({self.group}) was left out: "
                    f"{type(error).__name__}: {error}",
                    PartWarning, stacklevel=3,
                )  # fmt: skip
            else:
                PACKAGES[entry.module.partition(".")[0]] = origin


@cache
def entry_points(group: str) -> list[EntryPoint]:
    """The entry points of a group, by the names of their packages: the order of installation does
    not matter."""
    if not _named_anywhere(group):
        return []
    import logging
    from importlib import metadata

    found = metadata.entry_points(group=group)
    logging.getLogger(__name__).debug("parts of other packages, %s: %s", group, found.names)
    return sorted(found, key=lambda each: (each.dist.name if each.dist else "", each.name))


def _named_anywhere(group: str) -> bool:
    """Whether a file of entry points holds the name of a group: `importlib.metadata` takes longer
    than all else of `stochvi --help`. Where packages lie in archives, it must look itself."""
    folders = [Path(each) for each in sys.path]
    try:
        return any(each.is_file() for each in folders) or any(
            group.encode() in file.read_bytes()
            for folder in folders
            for file in folder.glob("*-info/entry_points.txt")
        )
    except OSError:
        return True


def origin_of(part: object) -> str:
    """The package, or else the module, that a part is from; empty of one that ships."""
    module = (getattr(part, "__module__", None) or type(part).__module__).partition(".")[0]
    return "" if module == "stochvi" else PACKAGES.get(module, module)


Reader = Callable[[Path], "Mapping[str, ArrayLike]"]
"""Reads a file: its columns by their headings, which state units as those of a text file do."""


def _reader_called(name: str, given: Any) -> Reader:
    """The reader of another package."""
    if not callable(given):
        raise TypeError(f"must be a function of a path, got {given!r}")
    reader: Reader = given
    return reader


READERS: Parts[Reader] = Parts("readers", {}, _reader_called)
"""Readers of other packages by the ending of a name; formats that are read here keep theirs."""
