// The view of one job: its image as it grows, its frames, how its error falls, what went wrong, and what can be done.

import { API, attribute, duration, error, make, number, percent, set, show, target, text, throttled } from "./dom.js";
import { actions, facts, lookedAt } from "./jobs.js";
import { jobs, on } from "./store.js";
import { attemptLog } from "./attempts.js";
import { planOf } from "./plan.js";
import { strip } from "./frames.js";
import { viewer } from "./viewer.js";

export function jobView(main, id) {
  const waiting = make("p", { className: "quiet", textContent: `Looking for job ${id} …` });
  main.append(waiting);
  let view = null;
  const draw = async (ids) => {
    if (ids && !ids.has(id)) return;
    let job = jobs.get(id);
    if (!job && !view) {
      // One of the older jobs, that the events do not begin with.
      try {
        const answer = await fetch(`${API}/jobs/${id}`);
        if (answer.ok) jobs.set(id, job = await answer.json());
        else if (answer.status === 404) text(waiting, `There is no job ${id}.`);
      } catch { /* The link says that the coordinator is away. */ }
    }
    if (!job || !main.contains(view?.node ?? waiting)) return;
    if (!view) {
      view = open(job);
      waiting.replaceWith(view.node);
      view.begin();
    }
    view.update(job);
  };
  const stops = [
    on("jobs", draw),
    on("tile", (tile) => { if (tile.job === id) view?.tile(tile); }),
    on("back", () => view?.back()),
  ];
  draw(null);
  return () => { stops.forEach((stop) => stop()); view?.close(); };
}

function open(first) {
  const id = first.id;
  let job = first, frame = lookedAt(first).frame, followed = true;
  const screen = viewer(first);
  const title = make("h2"), state = make("span", { className: "state" }), said = make("p", { className: "facts" });
  const bar = make("progress", { max: 1, value: 0 });
  const { box, update: act } = actions(id);

  // ---- the image and its controls
  const kinds = [["image", "Image"], ["samples", "Samples"], ["error", "Error"]].map(([kind, words]) => {
    const button = make("button", { type: "button", textContent: words, "data-map": kind, "aria-pressed": String(kind === "image") });
    button.onclick = () => {
      kinds.forEach((other) => attribute(other, "aria-pressed", String(other === button)));
      exposure.disabled = kind !== "image";
      frames.stop();
      screen.map(kind);
      called();
    };
    return button;
  });
  const stops = make("output", { textContent: "0" });
  const exposure = make("input", { type: "range", min: -6, max: 6, step: 0.25, value: 0, id: "exposure" });
  exposure.oninput = () => { text(stops, exposure.value); screen.expose(Number(exposure.value)); };
  const button = (words, label, press) => make("button", { type: "button", textContent: words, "aria-label": label, onclick: press });
  const outlines = make("input", { type: "checkbox", checked: true, onchange: () => screen.outlines(outlines.checked) });
  const frames = strip(first, {
    choose(number) { followed = false; look(number); },
    film: screen.film,
  });
  const controls = make("div", { className: "row controls" },
    make("span", { className: "tabs", role: "group", "aria-label": "What is shown" }, ...kinds),
    make("span", { className: "tabs", role: "group", "aria-label": "Zoom" },
      button("−", "zoom out", screen.zoomOut), button("+", "zoom in", screen.zoomIn), button("fit", "fit to the page", screen.fit), button("1:1", "1:1, one pixel for one", screen.whole)),
    make("label", { for: "exposure" }, "exposure "), exposure, make("span", {}, stops, " stops"),
    make("label", {}, outlines, " outline tiles"));
  const links = Object.fromEntries(["image.png", "image.exr", "samples.png", "samples.exr", "error.png", "error.exr"].map((name) =>
    [name, make("a", { textContent: name, download: "" })]));
  const report = make("a", { textContent: "report", href: `${API}/jobs/${id}`, download: `${id}.json` });
  const picture = make("section", { "aria-labelledby": "picture-title" },
    make("h3", { id: "picture-title", className: "visually-hidden", textContent: "Picture" }), controls,
    screen.large ? make("p", { textContent: "This frame is too large to be drawn here; download it." }) : screen.stage,
    screen.legend, make("div", { className: "row" }, screen.holders, screen.under), frames.node,
    make("p", {}, "Download ", ...Object.values(links).flatMap((link) => [link, " "]), report));

  // ---- figures
  const chart = make("img", { className: "chart", width: 800, height: 500, id: "convergence" });
  const points = make("tbody");
  const sheet = make("dl", { className: "sheet" });
  const plan = make("section", { hidden: true, "aria-labelledby": "plan-title" }, make("h3", { id: "plan-title", textContent: "What was modelled, and what was left out" }));
  const failures = make("section", { "aria-labelledby": "failures-title" },
    make("h3", { id: "failures-title", textContent: "Attempts and failures" }));
  const attempts = make("div");
  const log = attemptLog(id);
  failures.append(attempts, log.node);
  const node = make("article", {},
    make("p", {}, make("a", { href: "#/jobs", textContent: "← all jobs" })),
    make("div", { className: "row" }, title, state, box), bar, said, picture,
    make("div", { className: "columns" },
      make("section", { "aria-labelledby": "chart-title" }, make("h3", { id: "chart-title", textContent: "Error by the work spent" }), chart,
        make("details", {}, make("summary", { textContent: "as numbers" }), make("table", {},
          make("thead", {}, make("tr", {}, ...["CPU seconds", "samples", "error"].map((words) => make("th", { textContent: words, scope: "col" })))), points))),
      make("section", { "aria-labelledby": "sheet-title" }, make("h3", { id: "sheet-title", textContent: "Figures" }), sheet)),
    plan, failures);

  // ---- what is fetched beside the events
  const charted = throttled(async () => {
    await show(chart, `${API}/jobs/${id}/convergence.svg`);
    const answer = await fetch(`${API}/jobs/${id}/convergence.json`);
    if (!answer.ok) return;
    const found = await answer.json(), last = found.points.at(-1);
    attribute(chart, "alt", last ? `Error by processor time: ${error(last.error)} after ${last.cpu_seconds.toPrecision(3)} seconds`
      + (found.forecast ? `; ${error(found.forecast.error)} foreseen after ${found.forecast.cpu_seconds.toPrecision(3)} seconds` : "") : "Nothing is measured yet");
    points.replaceChildren(...found.points.map((point) => make("tr", {}, ...[point.cpu_seconds.toPrecision(3), number(point.samples), error(point.error)].map((words) => make("td", { textContent: words })))));
  }, 2000);
  const tiled = throttled(async () => {
    const of = frame, answer = await fetch(`${API}/jobs/${id}/frames/${of}/tiles`);
    if (!answer.ok || of !== frame) return;
    const { tiles } = await answer.json();
    screen.tiles(tiles);
    troubled = tiles.filter((tile) => tile.attempts > 0);
    drawFailures();
  }, 1000);
  let troubled = [], failed = [];
  const failing = throttled(async () => {
    const answer = await fetch(`${API}/jobs/${id}/failures`);
    if (!answer.ok) return;
    failed = (await answer.json()).failures;
    drawFailures();
  }, 2000);

  function drawFailures() {
    if (!failed.length && !troubled.length) return attempts.replaceChildren(make("p", { className: "quiet", textContent: "None failed." }));
    const table = (labels, rows) => make("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": labels[0] }, make("table", {},
      make("caption", { textContent: labels[0] }),
      make("thead", {}, make("tr", {}, ...labels.slice(1).map((label) => make("th", { textContent: label, scope: "col" })))),
      make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map((cell) => make("td", { textContent: cell })))))));
    attempts.replaceChildren(
      ...(troubled.length ? [table([`Tiles of frame ${frame} with failed attempts`, "Tile", "Failed attempts", "Passes", "State", "Worker", "Last message"],
        troubled.map((tile) => [tile.tile, tile.attempts, tile.passes, tile.state, tile.worker ?? "–", tile.message ?? "–"]))] : []),
      ...(failed.length ? [table(["Failed attempts, newest first", "When", "Frame", "Tile", "Pass", "Worker", "Cause", "Message"],
        failed.toReversed().map((one) => [one.at, one.frame, one.tile, one.pass, one.worker, one.cause, one.message]))] : []));
  }

  // ---- what changes
  function look(number) {
    frame = number;
    for (const [name, link] of Object.entries(links)) {
      link.href = `${API}/jobs/${id}/frames/${frame}/${name}`;
      link.download = `${job.name}-${frame}-${name}`;
    }
    screen.show(frame);
    frames.mark(frame);
    troubled = [];
    called();
    tiled();
  }
  function called() {
    const kind = kinds.find((button) => button.getAttribute("aria-pressed") === "true").textContent.toLowerCase();
    screen.name(`${kind} of ${job.name}, frame ${frame}; keys: plus and minus zoom, arrows pan, 0 fits`);
  }

  function figures() {
    const s = job.statistics, shown = job.frames.find((one) => one.frame === frame);
    const rows = [
      ["scene", job.scene.slice(0, 12)], ["size", job.resolution.join(" × ")], ["target", target(job.quality)],
      ["error reached", job.error === undefined ? "–" : error(job.error)],
      [`frame ${frame}`, shown ? `${percent(shown.progress)}, ${shown.mean_samples.toFixed(1)} samples a pixel, at most ${shown.max_samples}` : "–"],
      ["within target", shown?.within_target === undefined ? "–" : percent(shown.within_target)],
      ["samples", number(job.samples)], ["processor time", duration(s.cpu_seconds)],
      ["wall time", job.wall_seconds === undefined ? "–" : duration(job.wall_seconds)],
      ["time left", job.eta_seconds === undefined ? "–" : duration(job.eta_seconds)],
      ["rays", number(s.rays)], ["workers so far", s.workers], ["units tried again", s.retries],
      ["samples left out, not finite", number(s.rejected)], ["tracer", job.tracer ?? "–"], ["seed", job.seed], ["tags", job.tags.join(", ") || "–"],
      ["submitted", job.created_at], ["ended", job.finished_at ?? "–"], ["request", job.request ?? "–"],
      ["method", Object.entries(job.method).filter(([, value]) => value !== null && typeof value !== "object").map(([name, value]) => `${name} ${value}`).join(", ")],
    ];
    rows.forEach(([name, value], i) => {
      if (!sheet.children[2 * i]) sheet.append(make("dt"), make("dd"));
      text(sheet.children[2 * i], name);
      text(sheet.children[2 * i + 1], value);
    });
  }

  let planned = "";
  function drawPlan() {
    const now = JSON.stringify(job.plan ?? null);
    if (now === planned) return;
    planned = now;
    plan.hidden = !job.plan;
    if (job.plan) plan.replaceChildren(plan.firstChild, ...planOf(job.plan));
  }

  let before = null;
  return {
    node,
    begin() { look(frame); screen.fit(); charted(); failing(); },
    update(now) {
      job = now;
      text(title, `${job.name} (${id})`);
      text(state, job.status);
      set(state, "className", `state ${job.status}`);
      set(bar, "value", job.progress);
      attribute(bar, "aria-label", `progress of ${job.name}`);
      text(said, facts(job));
      document.title = `${Math.floor(100 * job.progress)} % · ${job.name} · Tessera`;
      act(job);
      figures();
      drawPlan();
      frames.update(job);
      if (followed && lookedAt(job).frame !== frame && job.frames.length > 1) look(lookedAt(job).frame);
      if (!before || before.samples !== job.samples || before.status !== job.status) { charted(); tiled(); log.refresh(); }
      if (before && (before.statistics.retries !== job.statistics.retries || before.status !== job.status)) failing();
      before = job;
    },
    tile(tile) {
      if (tile.frame !== frame) return;
      screen.changed(tile.tile);
      tiled();
    },
    /** The coordinator is back: tiles may have gone on unheard. */
    back() { screen.again(); charted(); tiled(); failing(); log.refresh(); },
    close() { frames.stop(); screen.close(); },
  };
}
