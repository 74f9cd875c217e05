"""Does a picture depend on the unit of length? Mitsuba's mean of a scene made larger and smaller, against a reference.

Its rays start a step of 9e-5 (1 + the largest coordinate) off the surface (`Interaction::offset_p`): in a small scene that
is far, and light gets into crevices. The picture of a scene scaled up by 100 has half the relative step of one whose
coordinates are about 1.

    python benches/peers/scale.py --reference e-mesh1m.npy scenes/bench/e-mesh1m.json
"""
import argparse

import numpy as np

import mitsuba_renderer
import scene as native


class Scaled(mitsuba_renderer.Mitsuba):
    def __init__(self, path, sampler, factor):
        self.factor = factor
        super().__init__(path, sampler)

    def translate(self, s):
        camera = {k: [self.factor * x for x in v] if k in ("position", "target") else v for k, v in s["camera"].items()}
        return super().translate(s | {"camera": camera})

    def mesh(self, vertices, triangles, rest):
        return super().mesh(self.factor * np.asarray(vertices), triangles, rest)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="native scene of meshes without lamps, under a sky")
    parser.add_argument("--reference", required=True, help="NumPy file of independent pictures, first axis the picture")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--factors", default="100,1,0.1,0.01")
    args = parser.parse_args()
    reference = np.load(args.reference).astype(float).mean(0)
    if any(shape["type"] != "mesh" for shape in native.load(args.scene)["shapes"]):
        parser.error(f"{args.scene}: shapes: only meshes are scaled")
    for factor in map(float, args.factors.split(",")):
        picture, _ = Scaled(args.scene, "multijitter", factor).render(args.samples, 1)
        off = (picture - reference).mean(-1)
        error = np.sqrt((off**2).sum()) / off.size
        print(f"times {factor:g}: mean {100 * off.mean() / reference.mean():+.4f}% +- {100 * error / reference.mean():.4f}%")


if __name__ == "__main__":
    main()
