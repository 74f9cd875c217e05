// What the page knows of the farm, kept true by server-sent events. A coordinator that is away leaves all of it in place.

import { API, byId, text } from "./dom.js";

export const jobs = new Map();
export const workers = new Map();
/** Cursor of the jobs older than those that are known. */
export let older = null;

const listeners = { jobs: new Set(), workers: new Set(), tile: new Set(), back: new Set() };
const changed = { jobs: new Set(), workers: new Set() };
let all = false;
let drawing = false;

/** Hear of changes: `jobs` and `workers` once a frame with the ids that changed (null: all), `tile` at once, `back` when
 *  the coordinator answers again. Returns how to stop. */
export function on(name, listener) {
  listeners[name].add(listener);
  return () => listeners[name].delete(listener);
}

function tell() {
  drawing = false;
  for (const name of ["jobs", "workers"]) {
    const ids = all ? null : new Set(changed[name]);
    changed[name].clear();
    if (ids === null || ids.size) listeners[name].forEach((listener) => listener(ids));
  }
  all = false;
}

function later() {
  if (drawing) return;
  drawing = true;
  // A page in the background has no animation frames, and nothing to draw.
  if (document.hidden) setTimeout(tell, 1000); else requestAnimationFrame(tell);
}

const note = (name, id) => { changed[name].add(id); later(); };

let source = null, since = null, pause = 500, wanted = 0;

function link(state, words) {
  byId("link").dataset.state = state;
  text(byId("link"), words);
}

function away() {
  since ??= new Date();
  link("away", `The coordinator is away since ${since.toLocaleTimeString()}; what you see is from then. Trying again …`);
  document.body.classList.add("away");
}

function here() {
  const was = since;
  since = null;
  pause = 500;
  link("live", "live");
  document.body.classList.remove("away");
  if (was) listeners.back.forEach((listener) => listener());
}

export function listen() {
  clearTimeout(wanted);
  source?.close();
  source = new EventSource(`${API}/events`);
  const hear = (name, act) => source.addEventListener(name, (event) => act(JSON.parse(event.data)));
  const update = (job) => { jobs.set(job.id, job); note("jobs", job.id); };
  source.onopen = here;
  hear("jobs", (list) => {
    jobs.clear();
    list.jobs.forEach((job) => jobs.set(job.id, job));
    older = list.next ?? null;
    all = true;
    later();
  });
  hear("workers", (list) => {
    workers.clear();
    list.workers.forEach((worker) => workers.set(worker.id, heard(worker)));
    all = true;
    later();
  });
  hear("state", update);
  hear("progress", update);
  hear("tile", (tile) => listeners.tile.forEach((listener) => listener(tile)));
  hear("worker", (worker) => { workers.set(worker.id, heard(worker)); note("workers", worker.id); });
  hear("removed", (id) => { jobs.delete(id); note("jobs", id); });
  source.onerror = again;
}

async function again() {
  source?.close();
  away();
  if (await refused()) return;
  clearTimeout(wanted);
  wanted = setTimeout(listen, pause);
  pause = Math.min(2 * pause, 4000);
}

/** The moment that "last seen" counts from. */
function heard(worker) {
  worker.seen_at = Date.now() - 1000 * worker.last_seen_seconds;
  return worker;
}

// A machine that vanishes closes no connection: ask whether it is there.
setInterval(async () => {
  if (document.hidden || since) return;
  try {
    await fetch("healthz", { cache: "no-store", signal: AbortSignal.timeout(5000) });
  } catch {
    again();
  }
}, 10_000);

/** Whether the coordinator is there and wants a token. */
async function refused() {
  try {
    if ((await fetch(`${API}/farm`, { signal: AbortSignal.timeout(5000) })).status !== 401) return false;
  } catch {
    return false;
  }
  link("away", "a token is needed");
  byId("token").hidden = false;
  byId("main").hidden = true;
  byId("secret").focus();
  return true;
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
  byId("wrong").hidden = byId("token").hidden = true;
  byId("main").hidden = false;
  listen();
};

/** Get the next page of older jobs. */
export async function more() {
  if (!older) return;
  const answer = await fetch(`${API}/jobs?limit=100&cursor=${older}`);
  if (!answer.ok) return;
  const list = await answer.json();
  list.jobs.forEach((job) => { if (!jobs.has(job.id)) jobs.set(job.id, job); });
  older = list.next ?? null;
  all = true;
  later();
}
