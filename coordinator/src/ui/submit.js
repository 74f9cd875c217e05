// Submitting: files dropped on the page or chosen, or a scene that comes with Tessera. A coordinator that goes away in the
// middle is waited for, and the job is made once.

import { API, byId, make, reason, text } from "./dom.js";

/** Files by their path. */
const files = new Map();
let shipped = [];

/** The files of a drop, folders walked through, by path. */
async function dropped(transfer) {
  const found = [];
  const walk = async (entry, path) => {
    if (entry.isFile) {
      found.push([path + entry.name, await new Promise((done, failed) => entry.file(done, failed))]);
    } else {
      const reader = entry.createReader();
      for (;;) {
        const entries = await new Promise((done, failed) => reader.readEntries(done, failed));
        if (!entries.length) break;
        for (const inner of entries) await walk(inner, `${path}${entry.name}/`);
      }
    }
  };
  // The list is emptied when this function first waits.
  const plain = [...transfer.files];
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (entries.length) for (const entry of entries) await walk(entry, "");
  return found.length ? found : plain.map((file) => [file.name, file]);
}

function add(found) {
  for (const [path, file] of found) files.set(path, file);
  byId("shipped").value = "";
  list();
}

function list() {
  byId("chosen").replaceChildren(...[...files].map(([path, file]) => {
    const gone = make("button", { type: "button", textContent: "×", "aria-label": `remove ${path}`, onclick: () => { files.delete(path); list(); } });
    return make("li", {}, `${path} (${(file.size / 1024).toFixed(0)} KiB) `, gone);
  }));
  text(byId("submit-said"), "");
}

export async function openSubmission() {
  const dialog = byId("submit");
  text(byId("submit-said"), "");
  if (!dialog.open) dialog.showModal();
  try {
    const answer = await fetch(`${API}/scenes`);
    if (!answer.ok) return;
    const chosen = byId("shipped").value;
    shipped = (await answer.json()).scenes;
    byId("shipped").replaceChildren(make("option", { value: "", textContent: "– none –" }),
      ...shipped.map((scene) => make("option", { value: scene.id, textContent: scene.name })));
    byId("shipped").value = chosen;
  } catch { /* The link says that the coordinator is away. */ }
}

/** Names of the files that a scene names: the values of every "file" in it. */
function named(value, found = new Set()) {
  if (Array.isArray(value)) value.forEach((inner) => named(inner, found));
  else if (value && typeof value === "object") {
    for (const [key, inner] of Object.entries(value)) {
      if (key === "file" && typeof inner === "string") found.add(inner); else named(inner, found);
    }
  }
  return found;
}

const base = (path) => path.slice(path.lastIndexOf("/") + 1);
const folder = (path) => path.slice(0, path.lastIndexOf("/") + 1);

/** Try until there is an answer, however long the coordinator is away. */
async function persist(what, request) {
  for (let pause = 500; ; pause = Math.min(2 * pause, 5000)) {
    try {
      const answer = await request();
      if (answer.status < 500) return answer;
    } catch { /* Nobody answered. */ }
    text(byId("submit-said"), `${what}: the coordinator is away; trying again …`);
    await new Promise((done) => setTimeout(done, pause));
  }
}

/** A mesh by itself makes a scene, too: the workers make it. */
const MESH = /\.(obj|ply)$/i;

/** Send a file; its hash. */
async function send(path, file) {
  text(byId("submit-said"), `sending ${path} …`);
  const answer = await persist(`sending ${path}`, () => fetch(`${API}/assets`, { method: "POST", body: file }));
  if (!answer.ok) throw new Error(`${path}: ${await reason(answer)}`);
  return (await answer.json()).hash;
}

/** The mesh among the files, with all of them uploaded by their paths from its folder. */
async function mesh() {
  const meshes = [...files.keys()].filter((path) => MESH.test(path));
  if (!meshes.length) {
    throw new Error("there is no scene among these: expected a Tessera scene (JSON with a field \"tessera\"), or a mesh (.obj or .ply)");
  }
  if (meshes.length > 1) {
    throw new Error(`several meshes: ${meshes.join(", ")}; submit one at a time, or a scene file that names them`);
  }
  const root = folder(meshes[0]), assets = {};
  for (const [path, file] of files) assets[path.startsWith(root) ? path.slice(root.length) : base(path)] = await send(path, file);
  return { import: base(meshes[0]), assets };
}

/** The scene among the files with all of them uploaded, ready to be submitted. */
async function uploaded() {
  let scene = null, place = "";
  for (const [path, file] of files) {
    if (!path.toLowerCase().endsWith(".json")) continue;
    let value;
    try { value = JSON.parse(await file.text()); } catch (error) { throw new Error(`${path}: not valid JSON: ${error.message}`); }
    if (value && typeof value === "object" && "tessera" in value) {
      if (scene) throw new Error(`two scenes: ${place} and ${path}; submit one at a time`);
      [scene, place] = [value, path];
    }
  }
  if (!scene) return mesh();
  const root = folder(place), wanted = [...named(scene)];
  // Files keep the path that they have from the scene; dropped without folders, they take the place that the scene names,
  // and what the scene does not name lies beside the first file that it does.
  const placeOf = (path) => {
    const inside = path.startsWith(root) ? path.slice(root.length) : path;
    if (wanted.includes(inside)) return inside;
    const same = wanted.find((name) => base(name) === base(path));
    return same ?? (inside.includes("/") ? inside : folder(wanted[0] ?? "") + inside);
  };
  const assets = { ...scene.assets };
  for (const [path, file] of files) {
    if (path === place) continue;
    assets[placeOf(path)] = await send(path, file);
  }
  const lacking = wanted.filter((name) => !(name in assets));
  if (lacking.length) throw new Error(`the scene names files that are not here: ${lacking.join(", ")}`);
  return { ...scene, assets };
}

function request(scene) {
  const value = (id) => byId(id).value.trim();
  const job = { scene, priority: Number(value("priority")) };
  if (value("name")) job.name = value("name");
  if (value("frames")) job.frames = value("frames");
  if (value("width") || value("height")) {
    if (!value("width") || !value("height")) throw new Error("give both width and height, or neither");
    job.resolution = [Number(value("width")), Number(value("height"))];
  }
  const target = document.querySelector("#submit [name=target]:checked").value;
  if (target === "noise") job.quality = { target, relative_error: Number(value("noise")) / 100 };
  if (target === "samples") job.quality = { target, samples: Number(value("samples")) };
  if (target === "time") job.quality = { target, cpu_seconds: Number(value("seconds")) };
  return job;
}

async function go() {
  const button = byId("submit-go");
  if (button.disabled) return;
  button.disabled = true;
  try {
    const chosen = shipped.find((scene) => scene.id === byId("shipped").value);
    const body = JSON.stringify(request(chosen ? { asset: chosen.scene } : await uploaded()));
    text(byId("submit-said"), "submitting …");
    const random = crypto.getRandomValues(new Uint32Array(4)), key = [...random].map((n) => n.toString(16)).join("-");
    const headers = { "Idempotency-Key": key };
    const answer = await persist("submitting", () => fetch(`${API}/jobs`, { method: "POST", body, headers }));
    if (!answer.ok) throw new Error(await reason(answer));
    const job = await answer.json();
    files.clear();
    list();
    byId("submit").close();
    location.hash = `#/job/${job.id}`;
  } catch (error) {
    text(byId("submit-said"), error.message);
  } finally {
    button.disabled = false;
  }
}

/** Make the page take files. */
export function submission() {
  byId("submit-close").onclick = () => byId("submit").close();
  byId("submit-go").onclick = go;
  byId("files").onchange = (event) => { add([...event.target.files].map((file) => [file.name, file])); event.target.value = ""; };
  byId("shipped").onchange = () => {
    const scene = shipped.find((scene) => scene.id === byId("shipped").value);
    text(byId("about"), scene ? `${scene.resolution.join("×")}. ${scene.description}` : "");
    if (scene) { files.clear(); list(); }
  };
  for (const id of ["noise", "samples", "seconds"]) {
    byId(id).onfocus = () => { byId(id).closest("label").querySelector("[type=radio]").checked = true; };
  }
  addEventListener("dragover", (event) => { event.preventDefault(); document.body.classList.add("dragging"); });
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) document.body.classList.remove("dragging"); });
  addEventListener("drop", async (event) => {
    event.preventDefault();
    document.body.classList.remove("dragging");
    const found = dropped(event.dataTransfer);
    openSubmission();
    add(await found);
  });
}
