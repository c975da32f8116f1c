"""The JSON Schema of a recipe."""

from saf_gen.core.config.json_schema import OPEN, PARAMETER, Schema, define_schema, model_schema
from saf_gen.generate.recipe import Recipe
from saf_gen.plugins.lights import COMMON_KEYS, UNITS

COMMON: dict[str, Schema] = {
    "offset": {"type": "number", "minimum": 0},
    "unit": {"enum": list(UNITS)},
    "lux_at_gain_1": {"type": "number", "exclusiveMinimum": 0},
}
"""Schemas of the keys that every light schedule accepts."""


def recipe_schema() -> Schema:
    """Return the JSON Schema (draft 2020-12) of a recipe, with every registered light schedule and lens motion."""
    schema = model_schema(Recipe, "saf_gen recipe")
    common = {key: {"anyOf": [COMMON[key], OPEN], "description": text} for key, text in COMMON_KEYS.items()}
    light = define_schema(schema, "lights", common=common)
    by_group = {
        "type": "object",
        "description": "A schedule for each light group by its name; a group that is not named stays at gain 1.",
        "not": {"anyOf": [{"required": [key]} for key in ("kind", "choice")]},
        "additionalProperties": light,
    }
    schema["properties"]["lights"]["additionalProperties"] = {"anyOf": [light, by_group]}
    schema["properties"]["scene_params"]["additionalProperties"] = {"type": "object", "additionalProperties": PARAMETER}
    focus, exposure = schema["$defs"]["FocusSettings"]["properties"], schema["$defs"]["ExposureSettings"]["properties"]
    focus["motion"] = {**define_schema(schema, "motions"), "description": focus["motion"]["description"]}
    rate = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}
    exposure["mean_rate"]["anyOf"] = [rate, OPEN, {"type": "null"}]
    return schema
