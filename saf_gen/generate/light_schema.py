"""The JSON Schema of the lights of a recipe."""

from saf_gen.core.config.json_schema import CHOICE, OPEN, Schema, define_schema
from saf_gen.core.spectrum import FORMS, NAMES
from saf_gen.plugins.lights import COMMON_KEYS, PRODUCT, UNITS

SPECTRA: list[Schema] = [
    {"enum": list(NAMES)},
    *(
        {
            "type": "object",
            "properties": {form: {"type": "number", "minimum": low, "maximum": high}},
            "required": [form],
            "additionalProperties": False,
        }
        for form, (low, high) in FORMS.items()
    ),
    {"type": "object", "properties": {"file": {"type": "string"}}, "required": ["file"], "additionalProperties": False},
]
COMMON: dict[str, Schema] = {
    "offset": {"type": "number", "minimum": 0},
    "unit": {"enum": list(UNITS)},
    "lux_at_gain_1": {"type": "number", "exclusiveMinimum": 0},
    "spectrum": {"$ref": "#/$defs/Spectrum"},
}
"""Schemas of the keys that every light schedule accepts."""


def define_lights(schema: Schema) -> Schema:
    """Add definitions of every registered light schedule and of products, and return the schema of a light."""
    schema["$defs"]["Spectrum"] = {"anyOf": SPECTRA}
    common = {key: {"anyOf": [COMMON[key], OPEN], "description": text} for key, text in COMMON_KEYS.items()}
    light = define_schema(schema, "lights", common=common)
    kinds = schema["$defs"]["lights"]["anyOf"]
    schema["$defs"]["lights.product"] = {
        "type": "object",
        "description": "The gain is the product of the gains of its factors at each moment.",
        "properties": {
            PRODUCT: {
                "type": "array",
                "minItems": 2,
                "items": {"anyOf": kinds},
                "description": "Schedules by their kind, each without the keys that belong to the product.",
            },
            **common,
        },
        "required": [PRODUCT],
        "additionalProperties": False,
    }
    each = [*kinds[:-1], {"$ref": "#/$defs/lights.product"}]  # the last of the kinds is a choice among them
    choice = {**CHOICE, "properties": {"choice": {"type": "array", "minItems": 1, "items": {"anyOf": each}}}}
    schema["$defs"]["lights"] = {"anyOf": [*each, choice]}
    several = {"type": "array", "minItems": 1, "items": light, "description": "Schedules whose lights add up."}
    by_group = {
        "type": "object",
        "description": "A schedule for each light group by its name or its role; any other group stays at gain 1.",
        "not": {"anyOf": [{"required": [key]} for key in ("kind", PRODUCT, "choice")]},
        "additionalProperties": {"anyOf": [light, several]},
    }
    return {"anyOf": [light, several, by_group]}
