"""Docstrings of fields: the texts below the fields of a model or dataclass, which describe them.

Python discards them, so they are read from the source when needed. Reference pages and JSON Schemas show them.
"""

import ast
import inspect
from functools import cache
from itertools import pairwise
from textwrap import dedent


@cache
def field_docs(cls: type) -> dict[str, str]:
    """Return the docstring below each annotated field of a class, on one line, by the name of the field.

    Fields of base classes come first; a class may replace the docstring of a field of its base. Fields without a
    docstring are left out.
    """
    docs = {}
    for one in reversed(cls.__mro__):
        if one.__module__.startswith(("pydantic", "builtins", "abc")):
            continue
        (body,) = ast.parse(dedent(inspect.getsource(one))).body
        statements = body.body if isinstance(body, ast.ClassDef) else []
        for field, below in pairwise(statements):
            text = below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else None
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, str):
                docs[field.target.id] = " ".join(text.split())
    return docs
