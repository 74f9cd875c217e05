"""What each specialisation of the code saves: instructions and processor time of the general code over those of the
special code that makes the same picture. A Markdown table on standard output.

    python3 benches/specialised.py TESSERA SCENE...

Time is what `tessera plan` measures of what it leaves out; instructions are counted by callgrind (valgrind), which knows
no AVX-512, in rendering alone, on a picture of 48 x 32 pixels at 16 samples. That pictures are the same is looked at
here once more, on the bytes of both files.
"""
import json
import os
import re
import subprocess
import sys
import tempfile

PICTURE = ["--runs", "1", "--samples", "16", "--resolution", "48x32"]


def method(plan):
    """The options that name the method of a plan."""
    chosen = plan["method"]
    options = []
    for field in ["direct", "light_pick", "light_samples", "light_sampling", "splits", "roulette"]:
        if chosen.get(field) is not None:
            options += ["--" + field.replace("_", "-"), str(chosen[field])]
    return options


def run(tessera, scene, options, leave, before=()):
    """Bytes of the picture and what was printed."""
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "picture.pfm")
        command = [*before, tessera, "bench", "render", scene, *PICTURE, *options, "-o", file]
        if leave:
            command += ["--general", ",".join(leave)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        with open(file, "rb") as picture:
            return picture.read(), done.stderr


def instructions(tessera, scene, options, leave):
    valgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    toggle = "--toggle-collect=tracer::unit::UnitRender::row"
    _, log = run(tessera, scene, options, leave, [*valgrind, toggle])
    return int(re.search(r"Collected : (\d+)", log)[1])


def main():
    tessera, *scenes = sys.argv[1:]
    print("| Scene | Left out | Specialised on | Instructions | Processor time |")
    print("|---|---|---|---:|---:|")
    for scene in scenes:
        plan = json.loads(subprocess.run([tessera, "plan", scene, "--json"], capture_output=True, check=True).stdout)
        options = method(plan)
        name = os.path.splitext(os.path.basename(scene))[0]
        counted = {}
        for out in plan["left_out"]:
            beside = out.get("beside", [])
            sides = [tuple(beside), (*beside, out["name"])]
            pictures = {run(tessera, scene, options, list(side))[0] for side in sides}
            assert len(pictures) == 1, f"{scene}: {out['name']} changes the picture"
            for side in sides:
                if side not in counted:
                    counted[side] = instructions(tessera, scene, options, list(side))
            times = f"{out['times']:.2f} ± {out['times_error']:.2f}"
            ratio = counted[sides[1]] / counted[sides[0]]
            # Callgrind's processor has no AVX-512.
            ratio = "" if out["name"] == "avx512" else f"{ratio:.2f}"
            label = f"`{out['name']}`" + (", without " + ", ".join(f"`{b}`" for b in beside) if beside else "")
            print(f"| {name} | {out['what']} | {label} | {ratio} | {times} |", flush=True)


if __name__ == "__main__":
    main()
