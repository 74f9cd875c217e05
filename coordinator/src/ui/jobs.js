// The view of all jobs: find, sort, and act on them.

import { API, attribute, call, duration, error, make, NOTHING, number, order, percent, set, show, target, text, throttled } from "./dom.js";
import { openSubmission } from "./submit.js";
import { finer } from "./finer.js";
import { jobs, more, older, on } from "./store.js";

export const STATES = ["queued", "active", "paused", "completed", "failed", "canceled"];
const POSSIBLE = {
  queued: ["pause", "cancel"], active: ["pause", "cancel"], paused: ["resume", "cancel"],
  failed: ["requeue", "delete"], canceled: ["requeue", "delete"], completed: ["continue", "delete"],
};
const wish = { search: "", state: "", by: "newest" };
const age = (job) => Number(job.id.slice(1));
const SORTS = {
  newest: (a, b) => age(b) - age(a),
  oldest: (a, b) => age(a) - age(b),
  name: (a, b) => a.name.localeCompare(b.name) || age(b) - age(a),
  state: (a, b) => STATES.indexOf(a.status) - STATES.indexOf(b.status) || age(b) - age(a),
  progress: (a, b) => b.progress - a.progress || age(b) - age(a),
  "time left": (a, b) => (a.eta_seconds ?? Infinity) - (b.eta_seconds ?? Infinity) || age(b) - age(a),
  priority: (a, b) => b.priority - a.priority || age(b) - age(a),
};

/** The buttons of a job and its priority, kept in step with its state by `update`. */
export function actions(id) {
  const box = make("span", { className: "actions" });
  const priority = make("input", { type: "number", min: 0, max: 100, className: "priority" });
  priority.onchange = () => call("PATCH", `/jobs/${id}`, { priority: Number(priority.value) });
  const label = make("label", { className: "quiet" }, "priority ", priority);
  const buttons = {};
  const press = {
    delete: async () => {
      const job = jobs.get(id);
      if (!confirm(`Delete ${job?.name ?? id} and its pictures?`)) return;
      if (await call("DELETE", `/jobs/${id}`)) location.hash = "#/jobs";
    },
    continue: () => finer(jobs.get(id)),
  };
  for (const name of ["pause", "resume", "cancel", "requeue", "continue", "delete"]) {
    buttons[name] = make("button", { type: "button", textContent: name === "continue" ? "finer …" : name, "data-act": name });
    buttons[name].onclick = press[name] ?? (() => call("POST", `/jobs/${id}/${name}`));
  }
  box.append(label, ...Object.values(buttons));
  const update = (job) => {
    for (const [name, button] of Object.entries(buttons)) {
      const hidden = !POSSIBLE[job.status]?.includes(name);
      // What has the focus gives it on, so that a keyboard does not start over.
      if (hidden && !button.hidden && document.activeElement === button) priority.focus();
      set(button, "hidden", hidden);
      attribute(button, "aria-label", `${button.textContent} ${job.name}`);
    }
    attribute(priority, "aria-label", `priority of ${job.name}`);
    if (document.activeElement !== priority) set(priority, "value", String(job.priority));
  };
  return { box, update };
}

/** Error reached against the target, time left, work: in words. */
export function facts(job) {
  const parts = [percent(job.progress)];
  if (job.error !== undefined) parts.push(`error ${error(job.error)}`);
  parts.push(`target ${target(job.quality)}`);
  if (job.eta_seconds !== undefined && job.status === "active") parts.push(`${duration(job.eta_seconds)} left`);
  if (job.workers_now) parts.push(`${job.workers_now} worker${job.workers_now > 1 ? "s" : ""}`);
  if (job.samples_per_second >= 1) parts.push(`${number(job.samples_per_second)} samples/s`);
  if (job.frames.length > 1) parts.push(`${job.frames.filter((frame) => frame.done).length} of ${job.frames.length} frames`);
  if (job.message) parts.push(job.message);
  return parts.join(" · ");
}

/** The frame to look at: the one being rendered, else the last that is done. */
export const lookedAt = (job) => job.frames.find((frame) => !frame.done && frame.progress > 0)
  ?? job.frames.findLast((frame) => frame.done) ?? job.frames[0];

const seen = new IntersectionObserver((entries) => entries.forEach((entry) => {
  entry.target.visible = entry.isIntersecting;
  if (entry.isIntersecting) entry.target.refresh?.();
}));

function row(id) {
  const image = make("img", { className: "thumb", alt: "", width: 96, height: 64, src: NOTHING });
  const name = make("a", { href: `#/job/${id}`, className: "name" });
  const state = make("span", { className: "state" });
  const bar = make("progress", { max: 1, value: 0 });
  const said = make("span", { className: "facts" });
  const { box, update: act } = actions(id);
  const node = make("li", { "data-job": id }, image, make("div", { className: "what" }, name, " ", state, bar, said), box);
  let last = null;
  const picture = throttled(async () => {
    if (node.visible && last) await show(image, `${API}/jobs/${id}/frames/${lookedAt(last).frame}/image.png?width=96`);
  }, 3000);
  node.refresh = picture;
  seen.observe(node);
  node.update = (job) => {
    const news = last?.samples !== job.samples;
    last = job;
    if (news && node.visible) picture();
    text(name, `${job.name} (${id})`);
    text(state, job.status);
    set(state, "className", `state ${job.status}`);
    set(bar, "value", job.progress);
    attribute(bar, "aria-label", `progress of ${job.name}`);
    text(said, facts(job));
    act(job);
  };
  return node;
}

export function jobsView(main) {
  const rows = new Map();
  const list = make("ul", { className: "jobs", "aria-label": "Jobs" });
  const none = make("p", { className: "quiet" });
  const count = make("p", { className: "quiet", role: "status" });
  const onward = make("button", { type: "button", textContent: "Older jobs", onclick: more });
  const search = make("input", { type: "search", placeholder: "name or tag", value: wish.search, "aria-label": "Search jobs" });
  const choice = (label, values, key) => {
    const select = make("select", {}, ...values.map(([value, words]) => make("option", { value, textContent: words })));
    select.value = wish[key];
    select.onchange = () => { wish[key] = select.value; draw(null); };
    return make("label", {}, `${label} `, select);
  };
  search.oninput = () => { wish.search = search.value; draw(null); };
  main.append(
    make("div", { className: "row" }, make("h2", { textContent: "Jobs" }),
      make("button", { type: "button", className: "main", textContent: "Submit a scene …", id: "submit-open", onclick: () => openSubmission() }),
      search,
      choice("state", [["", "all"], ...STATES.map((state) => [state, state])], "state"),
      choice("sorted by", Object.keys(SORTS).map((by) => [by, by]), "by")),
    count, none, list, onward);

  function draw(ids) {
    const words = wish.search.toLowerCase();
    const wanted = (job) => (!wish.state || job.status === wish.state)
      && (!words || [job.name, job.id, ...job.tags].some((found) => found.toLowerCase().includes(words)));
    const shown = [...jobs.values()].filter(wanted).sort(SORTS[wish.by]);
    for (const id of rows.keys()) if (!jobs.has(id)) { seen.unobserve(rows.get(id)); rows.delete(id); }
    const nodes = shown.map((job) => {
      let node = rows.get(job.id);
      const fresh = !node;
      if (fresh) rows.set(job.id, node = row(job.id));
      if (fresh || !ids || ids.has(job.id)) node.update(job);
      return node;
    });
    // A pressed button must not move away under the pointer.
    if (!list.matches(":active")) order(list, nodes);
    none.hidden = shown.length > 0;
    text(none, jobs.size ? "No job is like that." : "No jobs yet. Drop a scene on this page, or: tessera submit SCENE.json --watch");
    text(count, shown.length ? `${shown.length} job${shown.length > 1 ? "s" : ""}` : "");
    onward.hidden = !older;
    const active = shown.find((job) => job.status === "active");
    document.title = active ? `${Math.floor(100 * active.progress)} % · Tessera` : "Tessera";
  }
  draw(null);
  return on("jobs", draw);
}
