// The view of the machines that render.

import { attribute, call, copier, duration, make, number, order, set, text } from "./dom.js";
import { workerColour } from "./colour.js";
import { on, workers } from "./store.js";

const COLUMNS = ["Worker", "Machine", "State", "Threads", "Samples/s now", "… in ten minutes", "Works on", "Last seen", "Units", "Failed", "Scenes held", "Actions"];

function row(id) {
  const cells = COLUMNS.map((label) => make("td", { "data-label": label }));
  const swatch = make("span", { className: "swatch" });
  swatch.style.background = workerColour(id);
  cells[0].append(swatch, id);
  const work = make("a");
  const buttons = ["drain", "enable", "disable"].map((name) =>
    make("button", { type: "button", textContent: name, "data-act": name, onclick: () => call("POST", `/workers/${id}/${name}`) }));
  cells[11].append(...buttons);
  const node = make("tr", { "data-worker": id }, ...cells);
  node.seen = (worker) => {
    const seconds = Math.max(0, Math.round((Date.now() - worker.seen_at) / 1000));
    text(cells[7], worker.state === "lost" || seconds > 10 ? `${duration(seconds)} ago` : "now");
  };
  node.update = (worker) => {
    text(cells[1], worker.machine);
    text(cells[2], worker.state);
    set(cells[2], "className", worker.state);
    text(cells[3], worker.threads);
    text(cells[4], number(worker.samples_per_second));
    text(cells[5], number(worker.samples_per_second_before));
    if (worker.lease) {
      text(work, `${worker.lease.job}, frame ${worker.lease.frame}: ${worker.leased} unit${worker.leased === 1 ? "" : "s"}`);
      set(work, "href", new URL(`#/job/${worker.lease.job}`, location.href).href);
      if (work.parentNode !== cells[6]) cells[6].replaceChildren(work);
    } else text(cells[6], "–");
    text(cells[8], worker.units);
    text(cells[9], worker.failures);
    text(cells[10], worker.prepared.length);
    attribute(cells[10], "title", worker.prepared.map(([scene, frame]) => `${scene.slice(0, 12)}, frame ${frame}`).join("\n"));
    const hidden = {
      drain: !["idle", "busy"].includes(worker.state), disable: ["disabled", "lost"].includes(worker.state),
      enable: !["draining", "disabled"].includes(worker.state),
    };
    for (const button of buttons) {
      set(button, "hidden", hidden[button.dataset.act]);
      attribute(button, "aria-label", `${button.dataset.act} ${id} on ${worker.machine}`);
    }
    node.seen(worker);
  };
  return node;
}

export function workersView(main) {
  const rows = new Map();
  let everyone = false;
  const none = make("p", { className: "quiet", textContent: "No workers." });
  const body = make("tbody");
  const table = make("table", { className: "wide" },
    make("caption", { className: "visually-hidden", textContent: "Workers" }),
    make("thead", {}, make("tr", {}, ...COLUMNS.map((label) => make("th", { textContent: label, scope: "col" })))), body);
  const line = () => `tessera worker --coordinator ${location.origin}`;
  const gone = make("input", { type: "checkbox", onchange: () => { everyone = gone.checked; draw(null); } });
  const count = make("p", { className: "quiet", role: "status" });
  main.append(
    make("div", { className: "row" }, make("h2", { textContent: "Workers" }),
      make("label", {}, gone, " those lost for more than ten minutes too")),
    make("p", {}, "Start one on any machine: ", make("code", { textContent: line() }), " ", copier(line)),
    count, none, table);

  function draw(ids) {
    const lost = (worker) => worker.state === "lost" && Date.now() - worker.seen_at > 600_000;
    const shown = [...workers.values()].filter((worker) => everyone || !lost(worker));
    for (const id of rows.keys()) if (!workers.has(id)) rows.delete(id);
    const nodes = shown.map((worker) => {
      let node = rows.get(worker.id);
      const fresh = !node;
      if (fresh) rows.set(worker.id, node = row(worker.id));
      if (fresh || !ids || ids.has(worker.id)) node.update(worker);
      return node;
    });
    if (!body.matches(":active")) order(body, nodes);
    none.hidden = shown.length > 0;
    table.hidden = shown.length === 0;
    const busy = shown.filter((worker) => worker.state === "busy").length;
    text(count, shown.length ? `${shown.length} worker${shown.length > 1 ? "s" : ""}, ${busy} busy` : "");
  }
  draw(null);
  const stop = on("workers", draw);
  const ticking = setInterval(() => rows.forEach((node, id) => node.seen(workers.get(id))), 1000);
  return () => { stop(); clearInterval(ticking); };
}
