"""JSON Schemas of files, by which editors complete and check them: made from the tables of keys that readers use.

A schema refuses what no file may have: unknown and missing keys, wrong types, shapes and kinds, and numbers outside of
their range. Rules that involve several keys are left to ``jaxball validate``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jaxball.files.scenario.body import BODIES
from jaxball.files.scenario.classical import CLASSICAL, RESISTED
from jaxball.files.scenario.files import CLASSICAL_KEYS, KEYS, RESISTED_KEYS
from jaxball.files.scenario.grounds import AnglesOfPlate
from jaxball.files.scenario.own import Function
from jaxball.files.scenario.table import REQUIRED, Key, Keys
from jaxball.files.scenario.values import (
    Choice,
    Flag,
    Indices,
    Integer,
    Kind,
    Names,
    Nested,
    Numbers,
    Text,
    WholeNumber,
    unread,
)
from jaxball.numerics.declare import (
    BETWEEN_0_AND_1,
    FROM_1,
    FULL_TURN,
    NOT_NEGATIVE,
    POSITIVE,
    QUARTER_TURN,
    ROUNDED,
    Rule,
)
from jaxball.studies.design.files import (
    CONTROL_KEYS,
    CONTROL_TABLE,
    LIST,
    OBJECTIVES_OF_CONTROL,
    SEARCH_KEYS,
    SHARED,
    control_table,
)
from jaxball.studies.design.kinds import CONSTRAINTS, EITHER, OBJECTIVES
from jaxball.studies.sweep.study import KEYS as STUDY
from tests.support.keys import meaning, unit

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]
_OWN = {"type": "string", "pattern": r"^[\w.]+:[\w.]+$"}  # a class or a function of users
# By what a rule allows, which rules in other words share.
_RANGES: dict[Callable[..., Any], Schema] = {
    POSITIVE.allows: {"exclusiveMinimum": 0},
    NOT_NEGATIVE.allows: {"minimum": 0},
    FROM_1.allows: {"minimum": 1},
    BETWEEN_0_AND_1.allows: {"minimum": 0, "maximum": 1},
    **{
        rule.allows: {"minimum": -limit - ROUNDED, "maximum": limit + ROUNDED}
        for rule, limit in ((QUARTER_TURN, math.pi / 2), (FULL_TURN, 2 * math.pi))
    },
}


def _scenario_schema() -> Schema:
    """Returns the JSON Schema of scenario files, whose keys depend on the ``kind`` of the system."""
    writer = _Writer()
    keys = {**dict.fromkeys(BODIES, KEYS), **dict.fromkeys(CLASSICAL, CLASSICAL_KEYS)}
    keys |= dict.fromkeys(RESISTED, RESISTED_KEYS)
    tables = {kind: writer.table(_of_system(kind, keys_of_kind)) for kind, keys_of_kind in keys.items()}
    return writer.document("scenario", _by("kind", tables))


def _of_system(kind: str, keys: Keys) -> Keys:
    """Returns the keys with those of ``body`` and ``initial`` for one kind of system."""
    body, initial = keys["body"], keys["initial"]
    assert isinstance(body.kind, Nested)
    assert isinstance(initial.kind, Nested)
    # An orientation is given in one of two ways, and may be left out.
    start = {name: replace(key, default=None) for name, key in initial.kind.tables[kind].items()}
    of_body = body.kind.tables[kind]
    required = REQUIRED if any(key.default is REQUIRED for key in of_body.values()) else None
    return {
        **keys,
        "body": replace(body, kind=replace(body.kind, tables={"": of_body}), default=required),
        "initial": replace(initial, kind=replace(initial.kind, tables={"": start})),
    }


def schemas() -> dict[str, Schema]:
    """Returns the JSON Schemas of files by what they are; those of problems are of a ball or a disk."""
    objectives, constraints = SHARED["objectives"], SHARED["constraints"]
    wanted = {
        "objectives": replace(objectives, kind=unread(LIST, OBJECTIVES.keys(EITHER), forms=("list",))),
        "constraints": replace(constraints, kind=unread(LIST, CONSTRAINTS.keys(EITHER), forms=("list",))),
    }
    control = {
        "objectives": replace(OBJECTIVES_OF_CONTROL["objectives"], kind=wanted["objectives"].kind),
        CONTROL_TABLE: replace(CONTROL_KEYS[CONTROL_TABLE], kind=control_table(EITHER)),
    }
    return {
        "scenario": _scenario_schema(),
        "study": _schema_of("study", STUDY),
        "problem": _schema_of("problem", {**SEARCH_KEYS, **wanted}),
        "control": _schema_of("control problem", {**CONTROL_KEYS, **wanted, **control}),
    }


def _schema_of(title: str, keys: Keys) -> Schema:
    writer = _Writer()
    return writer.document(title, writer.table(keys))


class _Writer:
    """Describes values, and tables that stand in several places once, under ``$defs``."""

    def __init__(self) -> None:
        self.described: list[tuple[Nested, Schema]] = []

    def document(self, title: str, schema: Schema) -> Schema:
        definitions = {f"table{index}": table for index, (_, table) in enumerate(self.described)}
        return {"$schema": DIALECT, "title": f"A {title} file of jaxball", **schema, "$defs": definitions}

    def table(self, keys: Keys) -> Schema:
        return {
            "type": "object",
            "properties": {name: self._key(key) for name, key in keys.items()},
            "required": [name for name, key in keys.items() if key.default is REQUIRED],
            "additionalProperties": False,
        }

    def _key(self, key: Key) -> Schema:
        described = {**self._value(key.kind), "description": _description(key)}
        if key.default is not REQUIRED and key.default is not None and np.all(np.isfinite(_numbers_in(key.default))):
            described["default"] = np.asarray(key.default).tolist() if np.size(key.default) else []
        return described

    def _value(self, kind: Kind) -> Schema:
        if isinstance(kind, Nested):
            return self._reference(kind)
        others: tuple[Kind, ...] = getattr(kind, "others", ())
        return _any_of([_schema(kind), *map(self._value, others)])

    def _reference(self, nested: Nested) -> Schema:
        for index, (described, _) in enumerate(self.described):
            if described is nested:
                return {"$ref": f"#/$defs/table{index}"}
        schema: Schema = {}
        self.described.append((nested, schema))  # before what is in it, which may have it as well
        index = len(self.described) - 1
        item = _any_of([self._tables(nested), *map(self._value, nested.others)])
        of_form = {
            "item": item,
            "list": {"type": "array", "items": item},
            "by name": {"type": "object", "additionalProperties": item},
        }
        schema.update(_any_of([of_form[form] for form in nested.forms]))
        return {"$ref": f"#/$defs/table{index}"}

    def _tables(self, nested: Nested) -> Schema:
        tables = {choice: self.table(keys) for choice, keys in nested.tables.items()}
        if not tables:
            return {"type": "object"}
        own = [{"type": "object", "properties": {"kind": _OWN}, "required": ["kind"]}] if nested.own else []
        # Of one that has a key of its own name, the key says which it is.
        if all(choice in nested.tables[choice] for choice in tables if choice):
            return _any_of([*tables.values(), *own])
        return _by(nested.by, tables)


def _description(key: Key) -> str:
    """What an editor shows of a key: what it means, what its value must be, and the unit."""
    return f"{meaning(key)} ({', '.join(filter(None, [key.kind.words, unit(key.kind)]))})"


def _schema(kind: Kind) -> Schema:
    match kind:
        case Numbers():
            return _array(kind.shape, kind.rule)
        case WholeNumber():
            return {"type": "number", "multipleOf": 1, "minimum": kind.least, "maximum": kind.most}
        case Integer():
            return {"type": "integer", "minimum": kind.least, "maximum": kind.most}
        case Flag():
            return {"type": "boolean"}
        case Choice():
            names = {"enum": list(kind.names)}
            return names if type(kind) is Choice else {"anyOf": [names, _OWN]}
        case Names():
            return {"type": "array", "items": {"type": "string"}, "minItems": 1}
        case Indices():
            item = {"type": "integer", "minimum": 0}
            return {"type": "array", "items": item, "uniqueItems": True, "minItems": 0 if kind.empty else 1}
        case Function():
            return _OWN
        case Text():
            return {"type": "string"}
        case AnglesOfPlate():
            return {"type": "array", "items": {"enum": list(kind.names)}, "uniqueItems": True, "minItems": 1}
    return {}


def _by(name: str, tables: Mapping[str, Schema]) -> Schema:
    """Describes a table whose key ``name`` says which of the ``tables`` it is; a class of users has any keys."""
    kinds = [kind for kind in tables if kind]
    key = {"anyOf": [{"enum": kinds}, _OWN]}
    cases = [
        {
            "if": {"properties": {name: {"const": kind}}, "required": [name]}
            if kind
            else {"not": {"required": [name]}},
            "then": {**table, "properties": {**({name: {"const": kind}} if kind else {}), **table["properties"]}},
        }
        for kind, table in tables.items()
    ]
    required = [] if "" in tables else [name]
    return {"type": "object", "properties": {name: key}, "required": required, "allOf": cases}


def _any_of(schemas: list[Schema]) -> Schema:
    return schemas[0] if len(schemas) == 1 else {"anyOf": schemas} if schemas else {}


def _array(shape: tuple[int | None, ...], rule: Rule) -> Schema:
    if not shape:
        return {"type": "number", **_RANGES.get(rule.allows, {})}
    length, *inner = shape
    limits = {"minItems": 1} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": _array(tuple(inner), rule), **limits}


def _numbers_in(value: Any) -> Any:
    return value if not isinstance(value, str) and np.size(value) else 0.0
