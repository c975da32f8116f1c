"""The JSON Schema of a scene card."""

from saf_gen.core.config.json_schema import PARAMETER, Schema, model_schema
from saf_gen.scene.picture_card import PictureCard
from saf_gen.scene.scene_folder import SceneCard


def card_schema() -> Schema:
    """Return the JSON Schema (draft 2020-12) of a scene card, ``scene.yaml``, of rendered scenes and of given ones."""
    schema, given = model_schema(SceneCard, "saf_gen scene card"), model_schema(PictureCard, "")
    schema["properties"]["params"]["additionalProperties"] = PARAMETER
    schema["$defs"] |= given["$defs"]
    schema["properties"]["pictures"] = given["properties"]["pictures"]
    schema["anyOf"] = [{"required": schema.pop("required")}, {"required": given["required"]}]
    return schema
