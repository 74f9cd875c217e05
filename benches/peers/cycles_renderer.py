"""Blender's Cycles (the module bpy) on scenes of scenes/bench: a process of its own that is told what to render.

    python cycles_renderer.py SCENE FOLDER

Each line on standard input is "SAMPLES SEED"; the answer is one line "PROCESSOR_SECONDS FILE.npy". Cycles has no
analytic spheres: 320,000 triangles with smooth normals stand in, and lamps with a radius for spheres that glow; the
pixels of those, which Cycles' camera does not see, are written as NaN.
"""
import json
import os
import subprocess
import sys
import time

import numpy as np

import scene as native


class Cycles:
    """Used from elsewhere: starts the process under the Python that has bpy, and asks it."""

    def __init__(self, python, path, folder):
        command = [python, os.path.abspath(__file__), path, folder]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.version = self.answer()["version"]
        # What a picture costs beside its samples: synchronising, building, writing. Taken off.
        self.overhead = 0.0
        ones = sorted(self.ask(1, k)[1] for k in range(4))
        self.overhead = ones[1]

    def answer(self):
        for line in self.process.stdout:
            if line.startswith("{"):
                return json.loads(line)
        raise RuntimeError("Cycles is gone")

    def ask(self, samples, seed):
        self.process.stdin.write(f"{samples} {seed}\n")
        self.process.stdin.flush()
        answer = self.answer()
        return np.load(answer["file"]), answer["cpu_seconds"]

    def warm(self, samples):
        self.ask(samples, 7)

    def render(self, samples, seed):
        image, seconds = self.ask(samples, seed)
        # The overhead holds one sample.
        return image, (seconds - self.overhead) * samples / (samples - 1)


def serve(path, folder):
    import bpy
    from mathutils import Matrix

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what Cycles prints goes elsewhere

    s = native.load(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    world_scene = bpy.context.scene
    world_scene.render.engine = "CYCLES"
    world_scene.render.threads_mode, world_scene.render.threads = "FIXED", 1
    w, h = s["film"]["width"], s["film"]["height"]
    world_scene.render.resolution_x, world_scene.render.resolution_y = w, h
    world_scene.render.resolution_percentage = 100
    cycles = world_scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    bounces = s["settings"]["method"]["max_depth"] - 1  # those after the first hit
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = bounces
    cycles.transparent_max_bounces = 0
    cycles.use_auto_tile = cycles.use_guiding = False
    world_scene.view_settings.view_transform, world_scene.view_settings.look = "Raw", "None"
    image = world_scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_depth, image.color_mode, image.exr_codec = "OPEN_EXR", "32", "RGB", "NONE"

    c = s["camera"]
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "VERTICAL" if c.get("fov_axis") == "y" else "HORIZONTAL"
    data.sensor_width = data.sensor_height = 36.0
    data.angle = np.deg2rad(c["fov"])
    data.clip_start, data.clip_end = 1e-3, 1e5
    camera = bpy.data.objects.new("camera", data)
    x, y, z, p = axes(c)
    m = np.eye(4)
    m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = x, y, -z, p
    camera.matrix_world = Matrix(m.tolist())
    world_scene.collection.objects.link(camera)
    world_scene.camera = camera

    def material(m, emission=None):
        mat = bpy.data.materials.new("m")
        mat.use_nodes = True
        nodes, links = mat.node_tree.nodes, mat.node_tree.links
        nodes.clear()
        out = nodes.new("ShaderNodeOutputMaterial")
        if emission:  # on the front alone
            top = max(emission)
            node = nodes.new("ShaderNodeEmission")
            node.inputs["Color"].default_value = [v / top for v in emission] + [1.0]
            back, times = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMath")
            times.operation = "MULTIPLY_ADD"
            times.inputs[1].default_value, times.inputs[2].default_value = -top, top
            links.new(back.outputs["Backfacing"], times.inputs[0])
            links.new(times.outputs[0], node.inputs["Strength"])
            mat.cycles.emission_sampling = "FRONT"
        elif m["type"] == "diffuse":
            node = nodes.new("ShaderNodeBsdfDiffuse")
            node.inputs["Color"].default_value = native.rgb(m["reflectance"]) + [1.0]
            node.inputs["Roughness"].default_value = 0.0
        elif m["type"] in ("mirror", "conductor"):
            node = nodes.new("ShaderNodeBsdfAnisotropic")
            node.distribution = "GGX"
            node.inputs["Color"].default_value = native.rgb(m["reflectance"]) + [1.0]
            node.inputs["Roughness"].default_value = m.get("roughness", 0.0) ** 0.5  # alpha is its square
        elif m["type"] == "dielectric":
            node = nodes.new("ShaderNodeBsdfGlass")
            node.distribution = "GGX"
            node.inputs["Color"].default_value = (1, 1, 1, 1)
            node.inputs["Roughness"].default_value = 0.0
            node.inputs["IOR"].default_value = m["ior"]
        else:
            raise ValueError(m["type"])
        links.new(node.outputs[0], out.inputs["Surface"])
        return mat

    def add(vertices, triangles, mat, smooth=False):
        mesh = bpy.data.meshes.new("mesh")
        mesh.vertices.add(len(vertices))
        mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices, np.float32).ravel())
        mesh.loops.add(3 * len(triangles))
        mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(triangles, np.int32).ravel())
        mesh.polygons.add(len(triangles))
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(triangles), 3, dtype=np.int32))
        mesh.polygons.foreach_set("loop_total", np.full(len(triangles), 3, np.int32))
        mesh.update(calc_edges=True)
        mesh.shade_smooth() if smooth else mesh.shade_flat()
        mesh.materials.append(mat)
        world_scene.collection.objects.link(bpy.data.objects.new("mesh", mesh))

    mats = {name: material(m) for name, m in s["materials"].items()}
    flat = {}
    for shape in s["shapes"]:
        emission = native.rgb(shape["emission"]) if "emission" in shape else None
        mat = material(None, emission) if emission else mats[shape["material"]]
        if shape["type"] == "sphere" and emission:
            lamp = bpy.data.lights.new("lamp", "POINT")
            lamp.shadow_soft_size, lamp.use_soft_falloff = shape["radius"], False
            lamp.color = [v / max(emission) for v in emission]
            lamp.energy = max(emission) * 4 * np.pi**2 * shape["radius"] ** 2
            lamp = bpy.data.objects.new("lamp", lamp)
            lamp.location = shape["center"]
            world_scene.collection.objects.link(lamp)
        elif shape["type"] == "sphere":
            v, f = icosphere(7)
            add(v * shape["radius"] + np.array(shape["center"]), f, mat, smooth=True)
        elif shape["type"] == "mesh":
            add(*native.mesh(s, shape), mat)
        elif emission:
            add(*native.triangles_of([shape["vertices"]]), mat)
        else:
            flat.setdefault(shape["material"], []).append(shape["vertices"])
    for name, quads in flat.items():
        add(*native.triangles_of(quads), mats[name])
    world = bpy.data.worlds.new("world")
    world_scene.world = world
    world.use_nodes = True
    nodes = world.node_tree.nodes
    nodes.clear()
    background, out = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    world.node_tree.links.new(background.outputs[0], out.inputs[0])
    sky = native.rgb(s["environment"]["radiance"]) if "environment" in s else [0.0] * 3
    background.inputs["Color"].default_value = sky + [1.0]
    background.inputs["Strength"].default_value = float(any(sky))

    hidden = hidden_by_lamps(s, w, h)
    target = os.path.join(folder, "cycles.exr")

    def say(answer):
        answers.write(json.dumps(answer) + "\n")
        answers.flush()

    say({"version": bpy.app.version_string})
    for line in sys.stdin:
        samples, seed = map(int, line.split())
        cycles.samples, cycles.seed = samples, seed
        world_scene.render.filepath = target
        start = time.process_time()
        bpy.ops.render.render(write_still=True)
        seconds = time.process_time() - start
        read = bpy.data.images.load(target, check_existing=False)
        read.colorspace_settings.name = "Non-Color"
        pixels = np.empty(w * h * read.channels, np.float32)
        read.pixels.foreach_get(pixels)
        pixels = pixels.reshape(h, w, read.channels)[::-1, :, :3].copy()
        bpy.data.images.remove(read)
        pixels[hidden] = np.nan
        file = os.path.join(folder, "cycles.npy")
        np.save(file, pixels)
        say({"cpu_seconds": seconds, "file": file})


def axes(c):
    """Right, up and forward of a camera, and where it is."""
    p, target, up = (np.array(c.get(k, [0, 1, 0]), float) for k in ("position", "target", "up"))
    z = (target - p) / np.linalg.norm(target - p)
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    return x, np.cross(x, z), z, p


def hidden_by_lamps(s, w, h):
    """Pixels whose centre's ray passes a glowing sphere within 1.5 pixels."""
    x, y, z, p = axes(s["camera"])
    across = h if s["camera"].get("fov_axis") == "y" else w
    pixel = 2 * np.tan(np.deg2rad(s["camera"]["fov"]) / 2) / across
    columns, rows = (np.arange(w) + 0.5 - w / 2) * pixel, (h / 2 - np.arange(h) - 0.5) * pixel
    rays = z + columns[None, :, None] * x + rows[:, None, None] * y
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    mask = np.zeros((h, w), bool)
    for shape in s["shapes"]:
        if shape["type"] == "sphere" and "emission" in shape:
            to = np.array(shape["center"], float) - p
            distance = np.linalg.norm((rays @ to)[..., None] * rays - to, axis=-1)
            mask |= distance < shape["radius"] + 1.5 * pixel * np.linalg.norm(to)
    return mask


def icosphere(level):
    p = (1 + 5**0.5) / 2
    v = np.array([[-1, p, 0], [1, p, 0], [-1, -p, 0], [1, -p, 0], [0, -1, p], [0, 1, p],
                  [0, -1, -p], [0, 1, -p], [p, 0, -1], [p, 0, 1], [-p, 0, -1], [-p, 0, 1]], float)
    f = np.array([[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4],
                  [11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8],
                  [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]], np.int64)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    for _ in range(level):
        edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
        edges.sort(axis=1)
        key, inverse = np.unique(edges[:, 0] * len(v) + edges[:, 1], return_inverse=True)
        middle = v[key // len(v)] + v[key % len(v)]
        ab, bc, ca = inverse.reshape(3, -1) + len(v)
        v = np.concatenate([v, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        a, b, c = f.T
        f = np.concatenate([np.stack(t, 1) for t in ([a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca])])
    return v, f


if __name__ == "__main__":
    serve(*sys.argv[1:])
