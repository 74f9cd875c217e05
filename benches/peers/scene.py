"""Native scenes, read for other renderers: only what scenes/bench uses, anything else is refused."""
import json
import os
import re

import numpy as np


def load(path):
    with open(path) as f:
        scene = json.load(f)
    scene["folder"] = os.path.dirname(path)
    for shape in scene["shapes"]:
        steps = {"scale": np.ones(3), "translate": np.zeros(3)}
        for step in shape.get("transform", []):
            (name, value), = step.items()
            if name == "scale" and steps["translate"].any():
                raise ValueError(f"{path}: only scale, then translate")
            steps[name] = np.array(value, float)
        shape["steps"] = steps
        if not np.all(steps["scale"] == steps["scale"][0]):
            raise ValueError(f"{path}: only uniform scales")
    return scene


def rgb(value):
    return [value] * 3 if np.isscalar(value) else list(value)


def triangles_of(quads):
    """n quads -> vertices and two triangles (0, 1, 2), (0, 2, 3) of each."""
    vertices = np.asarray(quads, np.float32).reshape(-1, 3)
    base = (4 * np.arange(len(quads), dtype=np.int32))[:, None]
    return vertices, np.concatenate([base + [0, 1, 2], base + [0, 2, 3]], axis=1).reshape(-1, 3)


FACE = np.dtype([("n", "u1"), ("i", "<i4", (3,))])


def mesh(scene, shape):
    """Vertices, in place, and triangles of a mesh that `generate-meshes -- bench` made."""
    with open(os.path.join(scene["folder"], shape["file"]), "rb") as f:
        head, body = f.read().split(b"end_header\n", 1)
    vertices, faces = (int(re.search(rb"element %s (\d+)" % name, head)[1]) for name in (b"vertex", b"face"))
    v = np.frombuffer(body[: 12 * vertices], "<f4").reshape(-1, 3)
    f = np.frombuffer(body[12 * vertices :], FACE)["i"]
    assert len(f) == faces
    steps = shape["steps"]
    return (v * steps["scale"] + steps["translate"]).astype(np.float32), np.ascontiguousarray(f)
