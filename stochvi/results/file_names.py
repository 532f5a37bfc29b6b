"""Names of files made from names that a user chose: the only place where that is done."""

from __future__ import annotations

import hashlib
import unicodedata
from collections import Counter
from collections.abc import Iterable

LONGEST = 120
"""Largest length of a file name, bytes: file systems allow 255, some encrypted ones 143, and a file
has a name ten bytes longer while it is being written."""

RESERVED = {"con", "prn", "aux", "nul", "conin$", "conout$"} | {
    f"{port}{number}" for port in ("com", "lpt") for number in "0123456789¹²³"
}
"""Names, in small letters, that Windows reserves for devices, whatever follows the first point."""

PUNCTUATION = " _-.,+=()"
"""Characters that a file name may have besides letters, their marks and digits: no operating system
and no common shell gives them another meaning within a name."""

DIGEST_LENGTH = 8
"""Number of hexadecimal digits of the digest that tells apart names with the same cleaned name."""


def file_names(names: Iterable[str], ending: str) -> dict[str, str]:
    """A file name for each of these names, without folders, safe on every system.

    A name without unusual characters is kept. Separators, control characters and other punctuation
    become "_", leading points and hyphens are removed, and a long name is cut. Names that would be
    the same file on a system that ignores case get a digest of the whole name after "~".

    Parameters
    ----------
    names
        All the names that one writer writes into one folder.
    ending
        End of the file names, such as ".png".

    Examples
    --------
    >>> file_names(["stops.velocity_std", "../../escape", "nul.rate"], ".png")
    {'stops.velocity_std': 'stops.velocity_std.png', '../../escape': '_.._escape.png', \
'nul.rate': '_nul.rate.png'}
    >>> file_names(["A", "a"], ".csv")
    {'A': 'A~559aead0.csv', 'a': 'a~ca978112.csv'}
    """
    cleaned = {name: _cleaned(name) for name in names}
    sharing = Counter(_alike(found) for found in cleaned.values())
    return {
        name: _cut(found, ending, _digest(name), sharing[_alike(found)] > 1)
        for name, found in cleaned.items()
    }


def _cleaned(name: str) -> str:
    """The name with "_" for every character that a system could treat specially."""
    letters = unicodedata.normalize("NFC", name)
    kept = "".join(letter if _is_plain(letter) else "_" for letter in letters)
    kept = kept.lstrip(" .-") or "_"
    return f"_{kept}" if kept.split(".")[0].strip().casefold() in RESERVED else kept


def _is_plain(letter: str) -> bool:
    return letter in PUNCTUATION or unicodedata.category(letter)[0] in "LMN"


def _alike(name: str) -> str:
    """A form that is the same for all names that some file system does not distinguish."""
    return unicodedata.normalize("NFKC", name).casefold()


def _digest(name: str) -> str:
    whole = hashlib.sha256(name.encode("utf-8", "surrogatepass"))
    return f"~{whole.hexdigest()[:DIGEST_LENGTH]}"


def _cut(name: str, ending: str, digest: str, shared: bool) -> str:
    """The file name; with the digest if others share the name, or if the name was too long."""
    room = LONGEST - len(ending.encode())
    letters = name.encode()
    if len(letters) > room - (len(digest) if shared else 0):
        name, shared = letters[: room - len(digest)].decode("utf-8", "ignore"), True
    return f"{name}{digest if shared else ''}{ending}"
