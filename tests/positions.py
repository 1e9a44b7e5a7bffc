"""Finds the places that read a record, a NamedTuple of the package, by position.

The type of an expression follows from annotations, from calls of records and of functions, and from
fields. A method, an attribute or a function is known by its bare name, and only if all of this name
agree. So fewer places are found than by a type checker, which takes minutes for it.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_CONTAINERS = {
    'list', 'tuple', 'set', 'deque', 'Sequence', 'Iterable', 'Iterator', 'Collection',
}  # fmt: skip
_MAPPINGS = {'dict', 'Mapping', 'MutableMapping', 'defaultdict'}
#: Functions that return the elements of their last argument.
_SAME_ELEMENTS = {'list', 'tuple', 'sorted', 'reversed', 'iter', 'filter', 'deque'}


@dataclass(frozen=True)
class Kind:
    """The type of an expression: a record, or a container."""

    record: str = ''
    elements: Kind | None = None  #: of a sequence; the values of a mapping
    is_mapping: bool = False


_Kinds = dict[str, 'Kind | None']


def positions(sources: Mapping[str, str]) -> list[str]:
    """Return file, line and record of each reading by position in the sources of a package."""
    trees = {file: ast.parse(source) for file, source in sources.items()}
    package = _Package(trees.values())
    places = []
    for file, tree in trees.items():
        readings = _Readings(package, tree)
        readings.visit(tree)
        places += [f'{file}:{line}: {record}' for line, record in sorted(readings.found)]
    return places


class _Package:
    """What the names of a package stand for."""

    def __init__(self, trees: Sequence[ast.Module]) -> None:
        self.records = {
            node.name
            for tree in trees
            for node in ast.walk(tree)
            if isinstance(node, ast.ClassDef) and 'NamedTuple' in map(_name, node.bases)
        }
        self._functions: defaultdict[str, set[Kind | None]] = defaultdict(set)
        self._methods: defaultdict[str, set[Kind | None]] = defaultdict(set)
        self._attributes: defaultdict[str, set[Kind | None]] = defaultdict(set)
        for tree in trees:
            annotated = _Annotations(self.records, tree)
            for node in ast.walk(tree):
                self._collect(node, annotated)
            for node in tree.body:
                if isinstance(node, ast.FunctionDef):
                    self._functions[node.name].add(annotated.kind(node.returns))

    def _collect(self, node: ast.AST, annotated: _Annotations) -> None:
        """Note the types of a class's methods and attributes."""
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Attribute):
            self._attributes[node.target.attr].add(annotated.kind(node.annotation))
        for member in node.body if isinstance(node, ast.ClassDef) else []:
            if isinstance(member, ast.AnnAssign) and isinstance(member.target, ast.Name):
                self._attributes[member.target.id].add(annotated.kind(member.annotation))
            elif isinstance(member, ast.FunctionDef):
                is_property = any('property' in _name(each) for each in member.decorator_list)
                table = self._attributes if is_property else self._methods
                table[member.name].add(annotated.kind(member.returns))

    def function(self, name: str) -> Kind | None:
        """Return what the functions of this name return."""
        return _only(self._functions[name])

    def method(self, name: str) -> Kind | None:
        """Return what the methods of this name return."""
        return _only(self._methods[name])

    def attribute(self, name: str) -> Kind | None:
        """Return the type of the attributes of this name."""
        return _only(self._attributes[name])


class _Annotations:
    """The annotations of a file."""

    def __init__(self, records: set[str], tree: ast.Module) -> None:
        classes = {node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
        #: The modules and names of the package that the file imports.
        self.imported = {
            alias.asname or alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('barc_sim')
            for alias in node.names
        }
        self.records = records & (classes | self.imported)

    def kind(self, annotation: ast.expr | None) -> Kind | None:
        """Return the type that an annotation names."""
        if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
            annotation = ast.parse(annotation.value, mode='eval').body
        if isinstance(annotation, ast.BinOp):
            return self.kind(annotation.left) or self.kind(annotation.right)
        if isinstance(annotation, ast.Subscript):
            return self._subscripted(annotation)
        name = _name(annotation)
        return Kind(record=name) if name in self.records else None

    def _subscripted(self, annotation: ast.Subscript) -> Kind | None:
        inside = annotation.slice
        arguments = inside.elts if isinstance(inside, ast.Tuple) else [inside]
        name = _name(annotation.value)
        if name == 'Annotated':
            return self.kind(arguments[0])
        if name in _MAPPINGS:
            return Kind(elements=self.kind(arguments[-1]), is_mapping=True)
        is_pair = name == 'tuple' and len(arguments) > 1 and not _is_ellipsis(arguments[1])
        if name in _CONTAINERS and not is_pair:
            return Kind(elements=self.kind(arguments[0]))
        return None


class _Readings(ast.NodeVisitor):
    """Collects the readings by position in a file."""

    def __init__(self, package: _Package, tree: ast.Module) -> None:
        self.found: set[tuple[int, str]] = set()
        self._package = package
        self._annotated = _Annotations(package.records, tree)
        self._scope: _Kinds = {}

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        self._visit_inside(
            node, {each.arg: self._annotated.kind(each.annotation) for each in arguments}
        )

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self._visit_inside(node, {each.arg: None for each in node.args.args})

    def visit_ListComp(self, node: ast.ListComp) -> None:
        self._visit_inside(node, {}, node.generators)

    def visit_SetComp(self, node: ast.SetComp) -> None:
        self._visit_inside(node, {}, node.generators)

    def visit_DictComp(self, node: ast.DictComp) -> None:
        self._visit_inside(node, {}, node.generators)

    def visit_GeneratorExp(self, node: ast.GeneratorExp) -> None:
        self._visit_inside(node, {}, node.generators)

    def _visit_inside(
        self, node: ast.AST, names: _Kinds, generators: Sequence[ast.comprehension] = ()
    ) -> None:
        """Visit what has a scope of its own."""
        outside = self._scope
        self._scope = outside | names
        for generator in generators:
            self._iterate(generator.target, generator.iter)
        self.generic_visit(node)
        self._scope = outside

    def visit_Assign(self, node: ast.Assign) -> None:
        self.visit(node.value)
        for target in node.targets:
            self._bind(target, self._kind(node.value))

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)
        self._bind(node.target, self._annotated.kind(node.annotation))

    def visit_NamedExpr(self, node: ast.NamedExpr) -> None:
        self.visit(node.value)
        self._bind(node.target, self._kind(node.value))

    def visit_For(self, node: ast.For) -> None:
        self._iterate(node.target, node.iter)
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self._note(node, self._kind(node.value))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        for argument in node.args:
            if isinstance(argument, ast.Starred):
                self._note(argument, self._kind(argument.value))
        self.generic_visit(node)

    def _note(self, node: ast.expr, kind: Kind | None) -> None:
        if kind and kind.record:
            self.found.add((node.lineno, kind.record))

    def _bind(self, target: ast.expr, kind: Kind | None) -> None:
        """Note the type of a target, or that a record is unpacked into several."""
        if isinstance(target, ast.Name):
            self._scope[target.id] = kind
        elif isinstance(target, (ast.Tuple, ast.List)):
            self._note(target, kind)
            for element in target.elts:
                self._bind(element, None)

    def _iterate(self, target: ast.expr, iterated: ast.expr) -> None:
        """Bind the target of a loop."""
        kinds = self._kinds_in_turn(iterated)
        if len(kinds) == 1:
            self._bind(target, kinds[0])
        elif isinstance(target, ast.Tuple) and len(target.elts) == len(kinds):
            for element, kind in zip(target.elts, kinds, strict=True):
                self._bind(element, kind)

    def _kinds_in_turn(self, iterated: ast.expr) -> list[Kind | None]:
        """Return the type of what a loop takes; several if it takes tuples of them."""
        if isinstance(iterated, ast.Call):
            name = _name(iterated.func)
            if name == 'items' and isinstance(iterated.func, ast.Attribute):
                return [None, self._elements(iterated.func.value)]
            if name == 'values' and isinstance(iterated.func, ast.Attribute):
                return [self._elements(iterated.func.value)]
            if name == 'enumerate':
                return [None, self._elements(iterated.args[0])]
            if name == 'zip' and len(iterated.args) > 1:
                return [self._elements(each) for each in iterated.args]
        kind = self._kind(iterated)
        return [kind.elements if kind and not kind.is_mapping else None]

    def _elements(self, node: ast.expr) -> Kind | None:
        kind = self._kind(node)
        return kind.elements if kind else None

    def _kind(self, node: ast.expr) -> Kind | None:
        """Return the type of an expression; None: unknown."""
        if isinstance(node, ast.Name):
            return self._scope.get(node.id)
        if isinstance(node, ast.Attribute):
            return self._package.attribute(node.attr)
        if isinstance(node, ast.NamedExpr):
            return self._kind(node.value)
        if isinstance(node, ast.IfExp):
            return self._kind(node.body) or self._kind(node.orelse)
        if isinstance(node, ast.Subscript):
            whole = self._kind(node.value)
            return whole if isinstance(node.slice, ast.Slice) else self._elements(node.value)
        return self._called(node) if isinstance(node, ast.Call) else None

    def _called(self, call: ast.Call) -> Kind | None:
        """Return the type of what a call returns."""
        name = _name(call.func)
        if name in self._annotated.records:
            return Kind(record=name)
        if isinstance(call.func, ast.Attribute):
            owner = call.func.value
            if name == '_replace':
                return self._kind(owner)
            is_module = _name(owner) in self._annotated.imported
            return self._package.function(name) if is_module else self._package.method(name)
        if name in _SAME_ELEMENTS and call.args:
            return self._kind(call.args[-1])
        return None if name in self._scope else self._package.function(name)


def _name(node: ast.expr | None) -> str:
    """Return the last part of a dotted name."""
    if isinstance(node, ast.Name):
        return node.id
    return node.attr if isinstance(node, ast.Attribute) else ''


def _is_ellipsis(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is ...


def _only(kinds: set[Kind | None]) -> Kind | None:
    """Return the one type of several, if they agree."""
    return next(iter(kinds)) if len(kinds) == 1 else None
