"""The JSON Schema of a scene card."""

from saf_gen.core.config.json_schema import PARAMETER, Schema, model_to_json_schema
from saf_gen.scene.scene_folder import SceneCard


def make_scene_card_schema() -> Schema:
    """Return the JSON Schema (draft 2020-12) of a scene card, ``scene.yaml``."""
    schema = model_to_json_schema(SceneCard, "saf_gen scene card")
    schema["properties"]["params"]["additionalProperties"] = PARAMETER
    return schema
