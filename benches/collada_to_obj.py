"""Triangles and polygons of a COLLADA file, in world space, as an OBJ: for measurements on scenes that come as COLLADA.

python3 collada_to_obj.py scene.dae scene.obj
"""
import sys
import xml.etree.ElementTree as xml


def main(source, target):
    root = xml.parse(source).getroot()
    space = root.tag.partition("}")[0] + "}"
    tag = lambda path: "/".join(space + part for part in path.split("/"))
    of_id = {element.get("id"): element for element in root.iter() if element.get("id")}
    named = lambda reference: of_id[reference.lstrip("#")]
    numbers = lambda element, kind=float: [kind(word) for word in element.text.split()]
    z_up = (root.findtext(".//" + tag("up_axis")) or "Y_UP") == "Z_UP"
    vertices, faces = [], []

    def place(node, above):
        matrix = above
        for element in node.findall(tag("matrix")):
            m = numbers(element)
            rows = [m[i : i + 4] for i in range(0, 16, 4)]
            matrix = [[sum(matrix[i][k] * rows[k][j] for k in range(4)) for j in range(4)] for i in range(4)]
        for instance in node.findall(tag("instance_geometry")):
            geometry = named(instance.get("url"))
            for kind in ("triangles", "polylist"):
                for part in geometry.iter(space + kind):
                    add(part, matrix)
        for child in node.findall(tag("node")):
            place(child, matrix)

    def add(part, matrix):
        inputs = part.findall(tag("input"))
        stride = 1 + max(int(i.get("offset")) for i in inputs)
        vertex = next(i for i in inputs if i.get("semantic") == "VERTEX")
        position = named(vertex.get("source")).find(tag("input") + "[@semantic='POSITION']")
        values = numbers(named(position.get("source")).find(tag("float_array")))
        first = len(vertices) + 1
        for i in range(0, len(values), 3):
            p = values[i : i + 3] + [1]
            x, y, z = (sum(row[k] * p[k] for k in range(4)) for row in matrix[:3])
            vertices.append((x, z, -y) if z_up else (x, y, z))
        indices = numbers(part.find(tag("p")), int)[int(vertex.get("offset")) :: stride]
        counts = part.find(tag("vcount"))
        at = 0
        for count in numbers(counts, int) if counts is not None else [3] * (len(indices) // 3):
            faces.append([first + i for i in indices[at : at + count]])
            at += count

    identity = [[float(i == j) for j in range(4)] for i in range(4)]
    for node in root.findall(tag("library_visual_scenes/visual_scene/node")):
        place(node, identity)
    with open(target, "w") as out:
        out.writelines(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in vertices)
        out.writelines("f " + " ".join(map(str, face)) + "\n" for face in faces)


main(*sys.argv[1:])
