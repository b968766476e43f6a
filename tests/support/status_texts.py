"""All STATUSTEXTs of the firmware, found by a static search of the source for the calls that create them."""

import ast
import re
from functools import cache
from pathlib import Path

import firmware_py

ROOT = Path(firmware_py.__file__).parent
PLACEHOLDER = "<>"
_MAX_DEPTH = 8
_CONSOLE_ONLY = {"cli", "install", "vehicle.py"}  # these send no STATUSTEXT
# Functions and classes with a text argument: its position and its keyword.
TEXT_ARGUMENTS = {
    "Event": (1, "text"),
    "send_text": (2, "text"),
    "send_text_limited": (2, "text"),
    "send_text_all": (1, "text"),
    "Answer": (1, "text"),
    "deny": (0, "reason"),
    "Refusal": (2, "text"),
    "PlanProblem": (2, "text"),
    "ParameterError": (0, ""),
    "Calibration": (2, "text"),
    "say": (0, "text"),
    "_say": (0, "text"),
    "report": (0, "text"),
    "_report": (0, "text"),
    "report_retry": (0, "text"),
    "notify": (0, "text"),
    "State": (99, "greeting"),
    "replace": (99, "greeting"),
    "request_or_warn": (2, "intent"),
    "StoreError": (0, ""),
    "WatchdogError": (0, ""),
    "finish_when_stored": (2, "text"),
}
_SECOND_TEXT_ARGUMENTS = {"finish_when_stored": (3, "failure")}  # functions with a second text argument
_TEXT_ATTRIBUTES = {"note", "start_problem"}  # attributes that store a text


def status_texts():
    """Yield each text, with a placeholder for each value, and its location in the source."""
    for path in sorted(ROOT.rglob("*.py")):
        if path.relative_to(ROOT).parts[0] not in _CONSOLE_ONLY:
            for node, scopes in _calls_of(path):
                for argument in _texts_of(node):
                    forms = dict.fromkeys(
                        re.sub("(<>)+", PLACEHOLDER, form) for form in _Forms(path, scopes).of(argument)
                    )
                    yield from ((form, f"{path.relative_to(ROOT)}: {ast.unparse(argument)}") for form in forms if form)


@cache
def _tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def _calls_of(path):
    return list(_calls(_tree(path), ()))


def _calls(node, scopes):
    """Yield each call and each assignment to a text attribute, with the enclosing functions."""
    enclosing = (*scopes, node) if isinstance(node, ast.FunctionDef | ast.Lambda) else scopes
    if isinstance(node, ast.Call) or (isinstance(node, ast.Assign) and _stores_text(node)):
        yield node, enclosing
    for child in ast.iter_child_nodes(node):
        yield from _calls(child, enclosing)


def _name(function):
    return getattr(function, "id", getattr(function, "attr", ""))


def _stores_text(node):
    return isinstance(node.targets[0], ast.Attribute) and node.targets[0].attr in _TEXT_ATTRIBUTES


def _texts_of(call):
    if isinstance(call, ast.Assign):
        yield call.value
        return
    for table in (TEXT_ARGUMENTS, _SECOND_TEXT_ARGUMENTS):
        position, keyword = table.get(_name(call.func), (99, ""))
        yield from call.args[position : position + 1]
        yield from (argument.value for argument in call.keywords if argument.arg == keyword)


class _Forms:
    """Possible values of an expression: constants, and placeholders for the rest."""

    def __init__(self, path, scopes, depth=0):
        self.path, self.scopes, self.depth = path, scopes, depth

    def of(self, node):
        """Return the forms of an expression."""
        if self.depth > _MAX_DEPTH:
            return [PLACEHOLDER]
        reader = {
            ast.Constant: lambda: [node.value if isinstance(node.value, str) else PLACEHOLDER],
            ast.JoinedStr: lambda: self._concatenations([getattr(part, "value", part) for part in node.values]),
            ast.BinOp: lambda: self._concatenations([node.left, node.right]),
            ast.IfExp: lambda: self.of(node.body) + self.of(node.orelse),
            ast.BoolOp: lambda: self._operands_of(node),
            ast.Subscript: lambda: self.of(node.value) if isinstance(node.slice, ast.Slice) else [PLACEHOLDER],
            ast.Name: lambda: self._values_of_name(node.id),
            ast.Call: lambda: self._returned_values(node),
        }.get(type(node))
        return [PLACEHOLDER] if reader is None else reader() or [PLACEHOLDER]

    def _concatenations(self, parts):
        forms = [""]
        for part in parts:
            suffixes = [part] if isinstance(part, str) else self.of(part)
            forms = [form + suffix for form in forms for suffix in suffixes]
        return forms

    def _operands_of(self, node):
        if isinstance(node.op, ast.Or):
            return [form for value in node.values for form in self.of(value)]
        return [*self.of(node.values[-1]), ""]

    def _nested(self, path, scopes):
        return _Forms(path, scopes, self.depth + 1)

    def _values_of_name(self, name):
        for number in range(len(self.scopes), 0, -1):
            scope = self.scopes[number - 1]
            inside = self._nested(self.path, self.scopes[:number])
            if values := _assigned_values(scope, name):
                return [form for value in values for form in inside.of(value)]
            if name in [argument.arg for argument in (*scope.args.args, *scope.args.kwonlyargs)]:
                return self._passed_values(scope, name)
        path, value = _constant(self.path, name)
        return [PLACEHOLDER] if value is None else self._nested(path, ()).of(value)

    def _passed_values(self, function, name):
        """Return the values that callers in the same module pass for a parameter."""
        names = [argument.arg for argument in function.args.args if argument.arg != "self"]
        forms = []
        for call, scopes in _calls_of(self.path):
            if (
                not isinstance(call, ast.Call)
                or isinstance(function, ast.Lambda)
                or _name(call.func) != function.name
                or function in scopes
            ):
                continue
            arguments = {keyword.arg: keyword.value for keyword in call.keywords} | dict(
                zip(names, call.args, strict=False)
            )
            if name in arguments:
                forms += self._nested(self.path, scopes).of(arguments[name])
        return forms

    def _returned_values(self, call):
        if _name(call.func) == "str":
            return [PLACEHOLDER]
        if _name(call.func) in {"format", "capitalize"}:
            return [re.sub(r"\{[^}]*\}", PLACEHOLDER, form) for form in self.of(call.func.value)]
        path, function = _function(self.path, _name(call.func))
        if function is None:
            return [PLACEHOLDER]
        inside = self._nested(path, (function,))
        values = [node.value for node in ast.walk(function) if isinstance(node, ast.Return) and node.value is not None]
        return [form for value in values for form in inside.of(value)]


@cache
def _assigned_values(scope, name):
    """Return the expressions assigned to a name in a function: by =, by := and by unpacking of a tuple."""
    values = []
    for node in ast.walk(scope):
        if isinstance(node, ast.NamedExpr) and node.target.id == name:
            values.append(node.value)
        if not isinstance(node, ast.Assign):
            continue
        branches = [node.value.body, node.value.orelse] if isinstance(node.value, ast.IfExp) else [node.value]
        for target in node.targets:
            if _name(target) == name and isinstance(target, ast.Name):
                values.append(node.value)
            elif isinstance(target, ast.Tuple):
                number = next((index for index, element in enumerate(target.elts) if _name(element) == name), None)
                if number is not None:
                    values += [value.elts[number] for value in branches if isinstance(value, ast.Tuple)]
    return values


@cache
def _origins(path):
    """Return the firmware modules from which a module imports, by imported name."""
    origins = {}
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("firmware_py"):
            module = ROOT.parent.joinpath(*node.module.split("."))
            file = next((path for path in (module.with_suffix(".py"), module / "__init__.py") if path.is_file()), None)
            origins |= {alias.asname or alias.name: file for alias in node.names if file is not None}
    return origins


def _constant(path, name):
    for node in _tree(path).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if name in [_name(target) for target in targets]:
            return path, node.value
    origin = _origins(path).get(name)
    return (path, None) if origin is None else _constant(origin, name)


@cache
def _function(path, name):
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.FunctionDef) and node.name == name:
            return path, node
    origin = _origins(path).get(name)
    return (path, None) if origin is None else _function(origin, name)
