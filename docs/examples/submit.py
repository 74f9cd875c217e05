#!/usr/bin/env python3
"""Submit a scene to a Tessera farm, wait for it, and fetch its image. Needs Python alone.

    submit.py SCENE.json OUT.png [http://127.0.0.1:7878]

The scene may name files beside it. TESSERA_TOKEN is sent where it is set.
"""

import json
import os
import pathlib
import sys
import time
import urllib.error
import urllib.request
import uuid


def main():
    scene_path, out = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    api = (sys.argv[3] if len(sys.argv) > 3 else "http://127.0.0.1:7878").rstrip("/") + "/api/v1"

    def call(method, path, body=None, **headers):
        request = urllib.request.Request(api + path, data=body, method=method, headers=headers)
        if os.environ.get("TESSERA_TOKEN"):
            request.add_header("Authorization", "Bearer " + os.environ["TESSERA_TOKEN"])
        try:
            with urllib.request.urlopen(request) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            sys.exit(json.load(error)["error"]["message"])

    # Every file that the scene names is stored first, and the scene says which it is.
    scene = json.loads(scene_path.read_text())
    assets = scene.setdefault("assets", {})
    for name in set(files_of(scene)):
        stored = json.loads(call("POST", "/assets", (scene_path.parent / name).read_bytes()))
        assets[name] = stored["hash"]

    # The key makes it safe to send this again when no answer came.
    body = json.dumps({"scene": scene}).encode()
    job = json.loads(call("POST", "/jobs", body, **{"Idempotency-Key": str(uuid.uuid4())}))
    while job["status"] not in ("completed", "failed", "canceled"):
        time.sleep(0.5)
        job = json.loads(call("GET", "/jobs/" + job["id"]))
    if job["status"] != "completed":
        sys.exit(f"job {job['id']} is {job['status']}: {job.get('message', '')}")
    out.write_bytes(call("GET", f"/jobs/{job['id']}/frames/{job['frames'][0]['frame']}/image.png"))
    print(f"job {job['id']}: {job['samples']} samples, {out}")


def files_of(value):
    """The values of every field "file"."""
    if isinstance(value, list):
        for inner in value:
            yield from files_of(inner)
    elif isinstance(value, dict):
        for name, inner in value.items():
            if name == "file" and isinstance(inner, str):
                yield inner
            else:
                yield from files_of(inner)


if __name__ == "__main__":
    main()
