"""Registry of objects by name: those of this program, and those of installed packages by their entry points.

Nothing is imported before it is used. Installed packages are searched only for a name that this program does not have,
because the search reads the metadata of every package.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ObjectT = TypeVar("ObjectT")


class PackageError(RuntimeError):
    """An installed package cannot be used; the text names the package, the reason and the remedy."""


class Registry(Mapping[str, ObjectT]):
    """Objects of one kind by name.

    `own` contains the objects of this program, each as "module:attribute"; no package can replace them. A package adds
    an object by an entry point `kind.name` of the group.
    """

    def __init__(self, group: str, kind: str, own: Mapping[str, str], expected: type[ObjectT], interface: int) -> None:
        """Define the kind; `expected` is the class of an object, `interface` its required version."""
        self.own = own
        self.kind = kind
        self._group = group
        self._expected = expected
        self._interface = interface
        self._loaded: dict[str, ObjectT] = {}

    def __getitem__(self, name: str) -> ObjectT:
        """Import and return an object; raise KeyError for an unknown name, PackageError for an unusable package."""
        if name not in self._loaded:
            module, _, attribute = self.own.get(name, "").partition(":")
            self._loaded[name] = getattr(import_module(module), attribute) if module else self._load_installed(name)
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names, those of this program first."""
        yield from self.own
        yield from (name for name in self._installed if name not in self.own)

    def __len__(self) -> int:
        """Return the number of objects."""
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        """Return whether this program or an installed package has an object of this name; it is not imported."""
        return name in self.own or name in self._installed

    def package_of(self, name: str) -> str:
        """Return name and version of the package that provides an object; empty for an object of this program."""
        return "" if name in self.own else _package(self._installed[name][0])

    @functools.cached_property
    def _installed(self) -> Mapping[str, list[EntryPoint]]:
        """The entry points of this kind by name."""
        from importlib.metadata import entry_points  # noqa: PLC0415 - only for a name that is not our own

        points: dict[str, list[EntryPoint]] = {}
        for point in entry_points(group=self._group):
            kind, _, name = point.name.partition(".")
            if kind == self.kind and name and point not in points.setdefault(name, []):
                points[name].append(point)
        return points

    def _load_installed(self, name: str) -> ObjectT:
        points = self._installed.get(name, [])
        if not points:
            raise KeyError(name)
        packages = sorted({_package(point) for point in points})
        if len(points) > 1:
            raise PackageError(
                f"several packages provide {self.kind} {name}: {', '.join(packages)}; remove all but one"
            )
        (package,) = packages
        try:
            obj: Any = points[0].load()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - code of another author
            text = f"{type(error).__name__}: {error}"[:120]
            raise PackageError(f"package {package}: {points[0].value}: {text}; correct or remove it") from None
        if not isinstance(obj, self._expected):
            raise PackageError(f"package {package}: {points[0].value} is not a {self._expected.__name__}; update it")
        if (interface := getattr(obj, "interface", None)) != self._interface:
            raise PackageError(
                f"package {package} is for interface version {interface}, this program has version {self._interface}; "
                "install another version of the package"
            )
        return obj


def find_unused_entry_points(group: str, registries: Mapping[str, Registry[Any]]) -> list[str]:
    """Return a text for each entry point of a group that is never used: of an unknown kind, or with an own name.

    `registries` are those of the group by kind.
    """
    from importlib.metadata import entry_points  # noqa: PLC0415 - only for checks

    texts = []
    for point in entry_points(group=group):
        kind, _, name = point.name.partition(".")
        if kind not in registries:
            kinds = ", ".join(registries)
            texts.append(f"package {_package(point)}: {point.name} is not used; its kind must be one of {kinds}")
        elif name in registries[kind].own:
            texts.append(f"package {_package(point)}: {point.name} is not used; this program has a {kind} {name}")
    return texts


def _package(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "without a name"
