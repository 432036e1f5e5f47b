"""Parts of the software by name: packaged, of an installed package, or `module:Class`.

A part of an installed package is known by the name of its entry point. A part is a callable, as
a class is: it is called with one argument and returns the object that does the work.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any


class PartError(ValueError):
    """A part cannot be used; the message names it, the reason and the choices."""


@dataclass(frozen=True)
class PartKind:
    """One kind of part.

    what: its word in messages. group: of entry points. packaged: name → module:callable of those
    that come with this software. methods: a class needs all methods of one of these sets.
    """

    what: str
    group: str
    packaged: Mapping[str, str]
    methods: tuple[frozenset[str], ...] = ()

    def names(self) -> list[str]:
        """Return the packaged names and those of installed packages."""
        return [*self.packaged, *(n for n in self._installed() if n not in self.packaged)]

    def check(self, name: str) -> str:
        """Return the name where its part can be used; a packaged one is not imported.

        Raises:
            PartError: as `load`.
        """
        if name not in self.packaged:
            self.load(name)
        return name

    def load(self, name: str) -> Callable[..., Any]:
        """Return the part of this name.

        Raises:
            PartError: no such name, no such module or class, or it lacks a method.
        """
        target = self.packaged.get(name) or self._installed().get(name) or name
        module, colon, path = target.partition(":")
        if not colon:
            raise PartError(self._unknown(name))
        try:
            found: Any = importlib.import_module(module)
        except Exception as error:  # whatever the user's module raises while it is imported
            raise PartError(
                f"{target}: {module} cannot be imported: {type(error).__name__}: {error}; install "
                "its package, or name its folder in PYTHONPATH"
            ) from error
        for part in path.split("."):
            if not hasattr(found, part):
                there = [n for n, v in vars(found).items() if isinstance(v, type) and n[0] != "_"]
                raise PartError(
                    f"{target}: no {part!r} in {module}; it has {', '.join(there) or 'no classes'}"
                )
            found = getattr(found, part)
        self._check_shape(target, found)
        return found  # type: ignore[no-any-return]

    def _installed(self) -> dict[str, str]:
        """Return the parts of installed packages: name → module:callable."""
        return {e.name: e.value for e in entry_points(group=self.group)}

    def _unknown(self, name: str) -> str:
        close = difflib.get_close_matches(name, self.names(), 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        return f"no {self.what} {name!r}; {hint}valid: {', '.join(self.names())}, or module:Class"

    def _check_shape(self, target: str, found: Any) -> None:
        if not callable(found):
            raise PartError(f"{target}: is no class or function")
        if not isinstance(found, type) or not self.methods:
            return
        complete = [m for m in self.methods if all(callable(getattr(found, n, None)) for n in m)]
        if not complete:
            wanted = " or ".join(", ".join(sorted(m)) for m in self.methods)
            raise PartError(f"{target}: a {self.what} has the methods {wanted}")
