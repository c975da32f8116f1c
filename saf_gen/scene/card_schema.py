"""The JSON Schema of a scene card."""

from saf_gen.core.config.json_schema import PARAMETER, Schema, model_schema
from saf_gen.scene.scene_folder import SceneCard


def card_schema() -> Schema:
    """Return the JSON Schema (draft 2020-12) of a scene card, ``scene.yaml``."""
    schema = model_schema(SceneCard, "saf_gen scene card")
    schema["properties"]["params"]["additionalProperties"] = PARAMETER
    return schema
