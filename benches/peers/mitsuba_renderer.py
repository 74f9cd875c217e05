"""Mitsuba 3 (llvm) on scenes of scenes/bench: one thread, in this process."""
import os
import tempfile
import time

import numpy as np

import scene as native


class Mitsuba:
    def __init__(self, path, sampler):
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        import drjit as dr

        dr.set_thread_count(1)
        self.mi, self.dr, self.sampler = mi, dr, sampler
        self.version = mi.__version__
        self.files = tempfile.TemporaryDirectory()
        self.scene = mi.load_dict(self.translate(native.load(path)), parallel=False)

    def translate(self, s):
        mi = self.mi
        t = mi.ScalarTransform4f
        camera, film = s["camera"], s["film"]
        segments = s["settings"]["method"]["max_depth"] + 1
        out = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": segments, "rr_depth": 5},
            "sensor": {
                "type": "perspective", "fov": camera["fov"], "fov_axis": camera.get("fov_axis", "x"),
                "near_clip": 1e-3, "far_clip": 1e5,
                "to_world": t().look_at(origin=camera["position"], target=camera["target"],
                                        up=camera.get("up", [0, 1, 0])),
                "sampler": {"type": self.sampler, "sample_count": 4},
                "film": {"type": "hdrfilm", "width": film["width"], "height": film["height"], "pixel_format": "rgb",
                         "component_format": "float32", "rfilter": {"type": "box"}},
            },
        }
        for name, m in s["materials"].items():
            out["m_" + name] = self.bsdf(m) | {"id": "m_" + name}
        flat = {}
        for i, shape in enumerate(s["shapes"]):
            bsdf = {"type": "ref", "id": "m_" + shape["material"]}
            glow = {}
            if "emission" in shape:
                glow = {"emitter": {"type": "area", "radiance": self.colour(shape["emission"])}}
            if shape["type"] == "sphere":
                out[f"s{i}"] = {"type": "sphere", "center": shape["center"], "radius": shape["radius"],
                                "bsdf": bsdf} | glow
            elif shape["type"] == "mesh":
                out[f"s{i}"] = self.mesh(*native.mesh(s, shape), {"bsdf": bsdf} | glow)
            elif glow:  # a lamp: a rectangle, so that it is sampled as one
                v = np.array(shape["vertices"], float)
                e1, e2 = (v[1] - v[0]) / 2, (v[3] - v[0]) / 2
                n = np.cross(e1, e2)
                m = np.eye(4)
                m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = e1, e2, n / np.linalg.norm(n), v.mean(0)
                out[f"s{i}"] = {"type": "rectangle", "to_world": t(m), "bsdf": bsdf} | glow
            else:
                flat.setdefault(shape["material"], []).append(shape["vertices"])
        for name, quads in flat.items():
            out["q_" + name] = self.mesh(*native.triangles_of(quads), {"bsdf": {"type": "ref", "id": "m_" + name}})
        if "environment" in s:
            assert s["environment"]["type"] == "constant"
            out["sky"] = {"type": "constant", "radiance": self.colour(s["environment"]["radiance"])}
        return out

    def colour(self, value):
        return {"type": "rgb", "value": native.rgb(value)}

    def bsdf(self, m):
        kind = m["type"]
        if kind == "diffuse":
            return {"type": "twosided", "b": {"type": "diffuse", "reflectance": self.colour(m["reflectance"])}}
        if kind == "mirror":
            return {"type": "twosided", "b": {"type": "conductor", "material": "none",
                                              "specular_reflectance": self.colour(m["reflectance"])}}
        if kind == "conductor":
            return {"type": "twosided", "b": {"type": "roughconductor", "material": "none", "distribution": "ggx",
                                              "alpha": m["roughness"],
                                              "specular_reflectance": self.colour(m["reflectance"])}}
        if kind == "dielectric":
            return {"type": "dielectric", "int_ior": m["ior"], "ext_ior": 1.0}
        raise ValueError(kind)

    def mesh(self, vertices, triangles, rest):
        """By way of a PLY file: only such a mesh can be given as a dictionary."""
        head = ("ply\nformat binary_little_endian 1.0\n"
                f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
                f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
        record = np.empty(len(triangles), native.FACE)
        record["n"], record["i"] = 3, triangles
        name = os.path.join(self.files.name, f"{len(os.listdir(self.files.name))}.ply")
        with open(name, "wb") as f:
            f.write(head.encode() + np.ascontiguousarray(vertices, "<f4").tobytes() + record.tobytes())
        return {"type": "ply", "filename": name, "face_normals": True} | rest

    def warm(self, samples):
        """The kernel is compiled before anything is measured."""
        self.render(samples, 7)

    def render(self, samples, seed):
        """Image and processor seconds."""
        start = time.process_time()
        image = self.mi.render(self.scene, spp=samples, seed=seed)
        self.dr.eval(image)
        self.dr.sync_thread()
        return np.array(image)[..., :3], time.process_time() - start
