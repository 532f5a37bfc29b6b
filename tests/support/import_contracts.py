"""Contracts on imports that see what `import-linter` does not: names that are imported lazily.

A module also imports what it hands to `import_module`, and the stub of a package (`__init__.pyi`)
names what `lazy_loader` imports for it when it is asked for.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output

PACKAGE = Path(__file__).parents[2] / "stochvi"


class NoCircles(Contract):  # type: ignore[misc]
    """No module is imported, directly or by way of others, by what it imports itself."""

    allowed = fields.ListField(subfield=fields.StringField(), required=False)

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        imports = {each: graph.find_modules_directly_imported_by(each) for each in graph.modules}
        for importer, imported in lazy_imports(PACKAGE):
            imports[importer] = imports[importer] | {imported}
        for line in self.allowed or []:
            importer, imported = line.split(" -> ")
            imports[importer] = imports[importer] - {imported}
        found = circles(imports)
        return ContractCheck(kept=not found, metadata={"circles": found})

    def render_broken_contract(self, check: ContractCheck) -> None:
        for circle in check.metadata["circles"]:
            output.print_error(f"{len(circle)} modules import each other: {', '.join(circle)}")


def lazy_imports(package: Path) -> Iterator[tuple[str, str]]:
    """Pairs of a module and another one that it imports by name only."""
    files = {_name(file): file for file in package.rglob("*.py")}
    for name, file in files.items():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for call in (each for each in ast.walk(tree) if isinstance(each, ast.Call)):
            if ast.unparse(call.func).endswith("import_module") and call.args:
                first = call.args[0]
                if isinstance(first, ast.Constant) and first.value in files:
                    yield name, first.value
        stub = file.with_suffix(".pyi")
        for line in ast.parse(stub.read_text(encoding="utf-8")).body if stub.exists() else ():
            if isinstance(line, ast.ImportFrom):
                origin = f"{name}.{line.module}" if line.module else name
                for each in line.names:
                    inner = f"{origin}.{each.name}"
                    yield name, inner if inner in files else origin


def _name(file: Path) -> str:
    parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def circles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other, the largest first.

    Modules that import nothing of the rest, or that nothing of the rest imports, are in no circle.
    """
    found = []
    rest = {name: set(others) for name, others in imports.items()}
    while rest:
        start = next(iter(rest))
        ahead = _reached(start, rest)
        behind = _reached(start, _reversed(rest))
        group = ahead & behind
        if len(group) > 1:
            found.append(sorted(group))
        for name in group:
            del rest[name]
        for others in rest.values():
            others -= group
    return sorted(found, key=len, reverse=True)


def _reached(start: str, imports: dict[str, set[str]]) -> set[str]:
    reached, open_ends = {start}, [start]
    while open_ends:
        new = imports.get(open_ends.pop(), set()) & imports.keys() - reached
        reached |= new
        open_ends += new
    return reached


def _reversed(imports: dict[str, set[str]]) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {name: set() for name in imports}
    for name, others in imports.items():
        for other in others & found.keys():
            found[other].add(name)
    return found
