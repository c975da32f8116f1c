"""A chequered plane 0.5 m in front of the lens, lit by a lamp beside the lens and by the room."""

import mitsuba as mi


def build(params):
    t = mi.ScalarTransform4f()
    return {
        "plane": {
            "type": "rectangle",
            "to_world": t.translate([0, 0, 0.5]).rotate([0, 1, 0], 180).scale(0.5),
            "bsdf": {
                "type": "diffuse",
                "reflectance": {
                    "type": "checkerboard",
                    "color0": {"type": "rgb", "value": 0.1},
                    "color1": {"type": "rgb", "value": 0.7},
                    "to_uv": mi.ScalarTransform4f().scale(60),
                },
            },
        },
        "lamp": {
            "type": "rectangle",
            "to_world": t.translate([0.3, 0.2, -0.1]).scale(0.1),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 20.0}},
        },
        "room": {"type": "constant", "radiance": {"type": "rgb", "value": 0.5}},
    }
