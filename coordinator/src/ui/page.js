// The status page: listens to /api/v1/events and draws what it hears. Text goes in as text, never as HTML.
"use strict";

const API = "api/v1";
const byId = (id) => document.getElementById(id);
const jobs = new Map();
const workers = new Map();
let chosen = null;
let kind = "image";
let drawn = "";
let source = null;

function make(tag, properties, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

const number = (n) => n >= 1e9 ? (n / 1e9).toFixed(2) + " G" : n >= 1e6 ? (n / 1e6).toFixed(2) + " M"
  : n >= 1e4 ? (n / 1e3).toFixed(0) + " k" : String(Math.round(n));

function duration(seconds) {
  const s = Math.ceil(seconds);
  return s < 60 ? `${s} s` : s < 3600 ? `${Math.floor(s / 60)} min ${s % 60} s`
    : `${Math.floor(s / 3600)} h ${Math.floor(s / 60) % 60} min`;
}

function facts(job) {
  const parts = [`${(100 * job.progress).toFixed(1)} %`, `${job.resolution.join("×")}`, `${number(job.samples)} samples`];
  if (job.samples_per_second >= 1) parts.push(`${number(job.samples_per_second)}/s`);
  if (job.error !== undefined) parts.push(`error ${(100 * job.error).toPrecision(2)} %`);
  if (job.eta_seconds !== undefined) parts.push(`${duration(job.eta_seconds)} left`);
  if (job.frames.length > 1) parts.push(`${job.frames.filter((f) => f.done).length} of ${job.frames.length} frames`);
  if (job.message) parts.push(job.message);
  return parts.join(" · ");
}

function actions(job) {
  const possible = {
    queued: ["pause", "cancel"], active: ["pause", "cancel"], paused: ["resume", "cancel"],
    failed: ["requeue"], canceled: ["requeue"], completed: [],
  }[job.status] ?? [];
  return possible.map((name) => make("button", {
    type: "button", textContent: name, ariaLabel: `${name} ${job.name}`,
    onclick: () => fetch(`${API}/jobs/${job.id}/${name}`, { method: "POST" }),
  }));
}

function jobItem(job) {
  const title = make("button", { type: "button", className: "choose", textContent: `${job.name} (${job.id})`, onclick: () => choose(job.id) });
  title.setAttribute("aria-pressed", String(job.id === chosen));
  const state = make("span", { className: `state ${job.status}`, textContent: job.status });
  const bar = make("progress", { max: 1, value: job.progress, ariaLabel: `progress of ${job.name}` });
  return make("li", { className: job.id === chosen ? "chosen" : "" }, title,
    make("span", { className: "actions" }, state, ...actions(job)), bar, make("span", { className: "facts", textContent: facts(job) }));
}

function drawJobs() {
  const all = [...jobs.values()].sort((a, b) => Number(b.id.slice(1)) - Number(a.id.slice(1)));
  byId("no-jobs").hidden = all.length > 0;
  if (!jobs.has(chosen)) choose((all.find((job) => job.status === "active") ?? all[0])?.id ?? null);
  // A pressed button must not vanish under the pointer: the list waits until it is left.
  if (!byId("jobs").matches(":active")) {
    const focused = document.activeElement?.closest?.("#jobs") ? document.activeElement.ariaLabel ?? document.activeElement.textContent : null;
    byId("jobs").replaceChildren(...all.map(jobItem));
    if (focused) [...byId("jobs").querySelectorAll("button")].find((b) => (b.ariaLabel ?? b.textContent) === focused)?.focus();
  }
  const counted = all.filter((job) => job.status === "active");
  document.title = counted.length ? `${Math.floor(100 * counted[0].progress)} % · Tessera` : "Tessera";
}

function drawWorkers() {
  const all = [...workers.values()].filter((worker) => worker.state !== "lost" || worker.last_seen_seconds < 600);
  byId("no-workers").hidden = all.length > 0;
  byId("workers").hidden = all.length === 0;
  byId("workers").tBodies[0].replaceChildren(...all.map((worker) => make("tr", {},
    ...[worker.id, worker.machine].map((text) => make("td", { textContent: text })),
    make("td", { textContent: worker.state, className: worker.state }),
    ...[worker.threads, number(worker.samples_per_second), worker.units, worker.failures].map((n) => make("td", { textContent: n })))));
}

function choose(id) {
  chosen = id;
  const job = jobs.get(id);
  byId("picture").hidden = !job;
  if (!job) return;
  byId("frame").replaceChildren(...job.frames.map((f) => make("option", { value: f.frame, textContent: f.frame })));
  byId("frame").parentElement.hidden = job.frames.length < 2;
  byId("frame").value = (job.frames.find((f) => !f.done && f.progress > 0) ?? job.frames[0]).frame;
  drawn = "";
  byId("shown").removeAttribute("src");
  drawJobs();
  drawPicture();
}

// The picture is asked for again when it changed, one request at a time; the server answers by its tag.
let asking = false;
async function drawPicture() {
  const job = jobs.get(chosen);
  if (!job || asking || document.hidden) return;
  const frame = job.frames.find((f) => String(f.frame) === byId("frame").value) ?? job.frames[0];
  const path = `${API}/jobs/${job.id}/frames/${frame.frame}`;
  const state = [path, kind, frame.progress, frame.mean_samples].join(" ");
  byId("picture-title").textContent = job.name;
  byId("caption").textContent = `${frame.mean_samples.toFixed(1)} samples a pixel, at most ${frame.max_samples}`
    + (frame.within_target === undefined ? "" : `; ${(100 * frame.within_target).toFixed(1)} % of pixels within the target`);
  byId("png").href = `${path}/${kind}.png`;
  byId("exr").href = `${path}/image.exr`;
  byId("png").download = `${job.name}-${frame.frame}-${kind}.png`;
  byId("exr").download = `${job.name}-${frame.frame}.exr`;
  if (state === drawn) return;
  asking = true;
  try {
    const answer = await fetch(`${path}/${kind}.png`);
    if (answer.ok) {
      const url = URL.createObjectURL(await answer.blob());
      const image = byId("shown");
      const before = image.src;
      image.onload = () => { if (before.startsWith("blob:")) URL.revokeObjectURL(before); };
      image.alt = `${kind} of ${job.name}, frame ${frame.frame}`;
      image.src = url;
      drawn = state;
    }
  } catch { /* The stream says that the coordinator is away. */ } finally {
    setTimeout(() => { asking = false; drawPicture(); }, 400);
  }
}

function say(state, text) {
  byId("link").dataset.state = state;
  byId("link").textContent = text;
}

function listen() {
  source?.close();
  source = new EventSource(`${API}/events`);
  const on = (name, act) => source.addEventListener(name, (event) => act(JSON.parse(event.data)));
  const update = (job) => { jobs.set(job.id, job); drawJobs(); if (job.id === chosen) drawPicture(); };
  source.onopen = () => say("live", "live");
  on("jobs", (list) => { jobs.clear(); list.jobs.forEach((job) => jobs.set(job.id, job)); drawJobs(); drawPicture(); });
  on("workers", (list) => { workers.clear(); list.workers.forEach((w) => workers.set(w.id, w)); drawWorkers(); });
  on("state", update);
  on("progress", update);
  on("worker", (worker) => { workers.set(worker.id, worker); drawWorkers(); });
  on("removed", (id) => { jobs.delete(id); drawJobs(); });
  source.onerror = async () => {
    source.close();
    say("away", "the coordinator is away; trying again …");
    if (!(await refused())) setTimeout(listen, 1500);
  };
}

// Whether the coordinator is there and wants a token.
async function refused() {
  try {
    const answer = await fetch(`${API}/workers`);
    if (answer.status !== 401) return false;
    say("away", "a token is needed");
    byId("token").hidden = false;
    byId("main").hidden = true;
    return true;
  } catch {
    return false;
  }
}

byId("token").onsubmit = async (event) => {
  event.preventDefault();
  const secure = location.protocol === "https:" ? "; Secure" : "";
  document.cookie = `tessera_token=${byId("secret").value}; SameSite=Strict; Path=/; Max-Age=31536000${secure}`;
  byId("secret").value = "";
  if (await refused()) {
    byId("wrong").hidden = false;
    return;
  }
  byId("token").hidden = true;
  byId("main").hidden = false;
  listen();
};
byId("frame").onchange = () => { drawn = ""; drawPicture(); };
for (const tab of document.querySelectorAll("[data-kind]")) {
  tab.onclick = () => {
    kind = tab.dataset.kind;
    document.querySelectorAll("[data-kind]").forEach((t) => t.setAttribute("aria-pressed", String(t === tab)));
    drawn = "";
    drawPicture();
  };
}
document.addEventListener("visibilitychange", drawPicture);
byId("origin").textContent = location.origin;
listen();
