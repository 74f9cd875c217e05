"""Loading a large PLY mesh and building its tree: Tessera beside Mitsuba 3, one core each, taking turns.

    python load.py [--scene e-mesh1m] [--runs 5] [--binary TESSERA] [--variant scalar_rgb]

Processor seconds. Tessera's are of the whole command, one sample of a picture of 8 x 8 pixels included; Mitsuba's of its
`load_dict` alone, in a process of its own, without the import of the module and the making of the dictionary.
"""
import argparse
import os
import resource
import statistics
import subprocess
import sys

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")

# What a process of its own runs for Mitsuba: the mesh's file is read as it is, as Tessera reads it.
MITSUBA = """
import sys, time
import mitsuba as mi
mi.set_variant(sys.argv[2])
mesh = {"type": "ply", "filename": sys.argv[1], "face_normals": True, "bsdf": {"type": "diffuse"}}
scene = {"type": "scene", "mesh": mesh, "sky": {"type": "constant"}}
start = time.process_time()
mi.load_dict(scene, parallel=False)
print(time.process_time() - start)
"""


def tessera(binary, path):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [binary, "bench", "render", path, "--runs", "1", "--samples", "1", "--resolution", "8x8"]
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def mitsuba(mesh, variant):
    done = subprocess.run([sys.executable, "-c", MITSUBA, mesh, variant], check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1])


def main():
    ask = argparse.ArgumentParser()
    ask.add_argument("--scene", default="e-mesh1m")
    ask.add_argument("--mesh", default="displaced-1m3.ply")
    ask.add_argument("--runs", type=int, default=5)
    ask.add_argument("--binary", default=os.path.join(ROOT, "target/release/tessera"))
    ask.add_argument("--variants", nargs="+", default=["scalar_rgb", "llvm_ad_rgb"])
    a = ask.parse_args()
    folder = os.path.join(ROOT, "scenes/bench")
    rows = {"Tessera, the whole command": []} | {f"Mitsuba {variant}, load_dict": [] for variant in a.variants}
    for _ in range(a.runs):
        ours, *theirs = rows.values()
        ours.append(tessera(a.binary, os.path.join(folder, a.scene + ".json")))
        for variant, seconds in zip(a.variants, theirs):
            seconds.append(mitsuba(os.path.join(folder, "meshes", a.mesh), variant))
    print("| | median, s | all runs |\n|---|---:|---|")
    for name, seconds in rows.items():
        print(f"| {name} | {statistics.median(seconds):.2f} | {', '.join(f'{s:.2f}' for s in seconds)} |")


if __name__ == "__main__":
    main()
