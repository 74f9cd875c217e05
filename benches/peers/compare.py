"""Error against processor time on scenes/bench: Tessera beside Mitsuba 3 and Cycles, one core each, taking turns.

    python compare.py [--scenes a-cornell ...] [--samples 16 64] [--runs 3] [--cycles PYTHON] [--json FILE]

Efficiency is 1 / (relMSE x processor seconds); relMSE is the mean over pixels and channels of (x - r)^2 / (r^2 + 0.01)
with the reference's own noise taken out: (x - r1) (x - r2) in place of the square, r1 and r2 its two independent halves.
A picture counts only if its mean agrees with the reference's: as a whole, and on each of 8 x 8 blocks.
"""
import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

from cycles_renderer import Cycles
from mitsuba_renderer import Mitsuba

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
SCENES = ["a-cornell", "b-cbspheres", "c-veach-mis", "d-meshlight", "e-mesh1m"]


class Tessera:
    """With the method that `options` name; without any, with multiple importance sampling."""

    def __init__(self, binary, path, folder, options=()):
        self.command = [binary, "bench", "render", path, "--runs", "1", "--json", *options]
        self.file = os.path.join(folder, "tessera.pfm")
        version = subprocess.run([binary, "--version"], capture_output=True, text=True, check=True).stdout
        self.version = version.split()[-1]

    def warm(self, samples):
        pass

    def render(self, samples, seed):
        options = ["--samples", str(samples), "--seed", str(seed), "--output", self.file]
        done = subprocess.run(self.command + options, capture_output=True, text=True, check=True)
        with open(self.file, "rb") as f:
            assert f.readline() == b"PF\n"
            width, height = map(int, f.readline().split())
            assert float(f.readline()) < 0
            image = np.frombuffer(f.read(), "<f4").reshape(height, width, 3)[::-1]
        return image, json.loads(done.stdout)["median"]["cpu_seconds"]


def planned(binary, path):
    """The options of what `tessera plan` chooses, as `tessera render --time` would: the best picture for the time."""
    done = subprocess.run([binary, "plan", path, "--time", "100", "--json"], capture_output=True, text=True, check=True)
    plan = json.loads(done.stdout)
    names = ["direct", "light_pick", "light_sampling", "light_samples", "splits", "reuse", "aim", "roulette"]
    chosen = [(name, plan["method"].get(name)) for name in names]
    options = [word for name, value in chosen if value is not None for word in ("--" + name.replace("_", "-"), str(value))]
    return plan["chosen"], options


def reference(folder, name, path, samples, parts):
    """Independent pictures by Mitsuba, kept from run to run."""
    os.makedirs(folder, exist_ok=True)
    file = os.path.join(folder, name + ".npy")
    if os.path.exists(file):
        return np.load(file)
    print(f"{name}: reference, {parts} x {samples} samples a pixel", file=sys.stderr, flush=True)
    renderer = Mitsuba(path, "independent")
    images = np.array([renderer.render(samples, 1000 + part)[0] for part in range(parts)], np.float32)
    np.save(file, images)
    return images


def measure(image, parts):
    """Error, and how far means are off, in standard errors of the difference."""
    x, parts = image.astype(np.float64), parts.astype(np.float64)
    seen = np.isfinite(x).all(-1)
    half = len(parts) // 2
    r1, r2, r = parts[:half].mean(0), parts[half:].mean(0), parts.mean(0)
    x = np.where(seen[..., None], x, r)
    error = ((x - r1) * (x - r2) / (r * r + 0.01)).mean()
    # What is independent spreads as its squares add up. Pixels that share paths are not, up to a few apart, but cells of 16 x 16
    # (8 x 8 within a block) nearly are.
    d = x - r
    h, w = seen.shape
    cells = lambda n: d[: h // n * n, : w // n * n].reshape(h // n, n, w // n, n, 3).sum((1, 3))
    z = d.sum() / np.sqrt((cells(16).sum(-1) ** 2).sum())
    cell = max(min(h, w) // 64, 1)
    blocks = cells(cell)
    n = (blocks.shape[0] // 8, blocks.shape[1] // 8)
    blocks = blocks[: 8 * n[0], : 8 * n[1]].reshape(8, n[0], 8, n[1], 3)
    spread = np.sqrt((blocks**2).sum((1, 3)))
    worst = np.abs(blocks.sum((1, 3)) / np.where(spread > 0, spread, 1)).max()
    return dict(relmse=error, mean_ratio=x.mean() / r.mean(), z=z, z_block=worst)


def main():
    ask = argparse.ArgumentParser()
    ask.add_argument("--scenes", nargs="+", default=SCENES)
    ask.add_argument("--samples", type=int, nargs="+", default=[16, 64])
    ask.add_argument("--runs", type=int, default=3)
    ask.add_argument("--binary", default=os.path.join(ROOT, "target/release/tessera"))
    ask.add_argument("--options", default="", help="further options of tessera, in one string")
    ask.add_argument("--cycles", help="a Python that has the module bpy; without, Cycles is left out")
    ask.add_argument("--without-mitsuba", action="store_true")
    ask.add_argument("--references", default=os.path.join(tempfile.gettempdir(), "tessera-references"))
    ask.add_argument("--reference-samples", type=int, default=256)
    ask.add_argument("--reference-parts", type=int, default=4)
    ask.add_argument("--json", help="every picture's figures are added here, a line each")
    a = ask.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        for name in a.scenes:
            path = os.path.join(ROOT, "scenes/bench", name + ".json")
            parts = reference(a.references, name, path, a.reference_samples, a.reference_parts)
            chosen, options = planned(a.binary, path)
            renderers = {
                "Tessera": Tessera(a.binary, path, folder, a.options.split()),
                "Tessera, planned": Tessera(a.binary, path, folder, options),
            }
            print(f"{name}: planned is {chosen}", file=sys.stderr, flush=True)
            if not a.without_mitsuba:
                renderers["Mitsuba llvm, multijitter"] = Mitsuba(path, "multijitter")
                renderers["Mitsuba llvm, independent"] = Mitsuba(path, "independent")
            if a.cycles:
                renderers["Cycles"] = Cycles(a.cycles, path, folder)
            rows = []
            for samples in a.samples:
                for renderer in renderers.values():
                    renderer.warm(samples)
                for run in range(a.runs):
                    for label, renderer in renderers.items():
                        image, seconds = renderer.render(samples, 100 * samples + run)
                        row = dict(scene=name, renderer=label, version=renderer.version, samples=samples, run=run,
                                   cpu_seconds=seconds, msamples=image.shape[0] * image.shape[1] * samples / 1e6,
                                   at=time.time()) | measure(image, parts)
                        rows.append(row)
                        if a.json:
                            with open(a.json, "a") as f:
                                f.write(json.dumps(row) + "\n")
            table(name, rows)


def table(name, rows):
    print(f"\n{name}\n| Renderer | Samples | Processor s | Msamples/s | relMSE | Efficiency | Mean ratio | z | worst block |")
    print("|---|---|---|---|---|---|---|---|---|")
    for label in dict.fromkeys(row["renderer"] for row in rows):
        for samples in dict.fromkeys(row["samples"] for row in rows):
            some = [row for row in rows if (row["renderer"], row["samples"]) == (label, samples)]
            middle = lambda key: statistics.median(row[key] for row in some)
            seconds, error = middle("cpu_seconds"), middle("relmse")
            print(f"| {label} | {samples} | {seconds:.2f} | {middle('msamples') / seconds:.2f} | {error:.3g} | "
                  f"{1 / (error * seconds):.3g} | {middle('mean_ratio'):.4f} | {middle('z'):+.1f} | "
                  f"{middle('z_block'):.1f} |", flush=True)


if __name__ == "__main__":
    main()
