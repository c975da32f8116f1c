"""The docstrings of fields: the text below a field of a model or dataclass says what the field is.

Python forgets them, so they are read from the source when somebody asks. Reference pages and JSON Schemas show them.
"""

import ast
import inspect
from functools import cache
from itertools import pairwise
from textwrap import dedent


@cache
def config_field_docs(cls: type) -> dict[str, str]:
    """Return what the docstring below each annotated field of a class says, on one line, by the field's name.

    Fields of base classes come first; a class may say anew what a field of its base is. Fields without a docstring
    are left out.
    """
    said = {}
    for one in reversed(cls.__mro__):
        if one.__module__.startswith(("pydantic", "builtins", "abc")):
            continue
        (body,) = ast.parse(dedent(inspect.getsource(one))).body
        statements = body.body if isinstance(body, ast.ClassDef) else []
        for field, below in pairwise(statements):
            text = below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else None
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, str):
                said[field.target.id] = " ".join(text.split())
    return said
