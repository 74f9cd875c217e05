"""What choosing a method costs: processor seconds of the pilot over those of the whole picture, each scene as its file is
written. A Markdown table on standard output.

    python3 benches/pilot.py TESSERA SCENE...

The pilot's seconds are those of `tessera plan`, the picture's those of the report of `tessera render`.
"""
import json
import os
import subprocess
import sys
import tempfile


def answer(*command):
    return json.loads(subprocess.run(command, capture_output=True, check=True).stdout)


def target(quality):
    """What a quality asks for, in words."""
    kind = quality["target"]
    if kind == "noise":
        return f"noise {quality['relative_error']:g}"
    return f"{quality['samples']} samples" if kind == "samples" else f"{quality['cpu_seconds']:g} s"


def main():
    tessera, *scenes = sys.argv[1:]
    print("| Scene | Target | Methods tried | Chosen | Pilot, s | Picture, s | Share |")
    print("|---|---|---:|---|---:|---:|---:|")
    for scene in scenes:
        plan = answer(tessera, "plan", scene, "--json")
        with tempfile.TemporaryDirectory() as folder:
            report = answer(tessera, "render", scene, "-o", folder, "--json")
        name = os.path.splitext(os.path.basename(scene))[0]
        pilot, picture = plan["trial_seconds"], report["cpu_seconds"]
        tried = len(plan.get("considered", []))
        row = [name, target(report["quality"]), tried, f"`{plan['chosen']}`", f"{pilot:.3f}", f"{picture:.2f}"]
        print("| " + " | ".join(map(str, row)) + f" | {100 * pilot / picture:.1f}% |", flush=True)


if __name__ == "__main__":
    main()
