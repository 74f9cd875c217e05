// The log of a job's units: who had each, for how long, and what came of it; newest first, by tile and by outcome.

import { API, make, order, text, throttled } from "./dom.js";

const OUTCOMES = ["done", "late", "failed", "hung", "lost", "returned"];
const COLUMNS = ["Ended", "Frame", "Tile", "Pass", "Worker", "Outcome", "Seconds", "CPU seconds", "Samples", "Lease", "Message"];
/** The pass of the unit that prepares a job. */
const PREPARE = 0xffffffff;

/** `j3.f1.t12.p0.x64.y0.w64.h32` in parts. */
function parts(unit) {
  const [, frame, tile, pass] = unit.match(/\.f(\d+)\.t(\d+)\.p(\d+)\./) ?? [];
  return { frame, tile: Number(pass) === PREPARE ? "–" : tile, pass: Number(pass) === PREPARE ? "choice of the method" : pass };
}

const shown = (attempt) => {
  const { frame, tile, pass } = parts(attempt.unit);
  return [attempt.at, frame, tile, pass, attempt.worker ?? "–", attempt.outcome, attempt.seconds?.toFixed(3) ?? "–",
    attempt.cpu_seconds.toFixed(3), attempt.samples, attempt.lease, attempt.message ?? ""];
};

export function attemptLog(id) {
  const outcome = make("select", {}, make("option", { value: "", textContent: "all" }), ...OUTCOMES.map((value) => make("option", { value, textContent: value })));
  const number = () => make("input", { type: "number", min: 0, step: 1, placeholder: "all" });
  const frame = number(), tile = number();
  const rows = make("tbody"), count = make("p", { className: "quiet", role: "status" });
  const onward = make("button", { type: "button", textContent: "Older attempts", hidden: true });
  const table = make("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Attempts at units" }, make("table", { id: "attempts" },
    make("caption", { textContent: "Newest first. Seconds count from the lease, which may hold several units." }),
    make("thead", {}, make("tr", {}, ...COLUMNS.map((label) => make("th", { textContent: label, scope: "col" })))), rows));
  const node = make("details", { className: "log" }, make("summary", { textContent: "Log of all units" }),
    make("div", { className: "row" }, make("label", {}, "frame ", frame), make("label", {}, "tile ", tile), make("label", {}, "outcome ", outcome)),
    count, table, onward);
  let next = null, asked = 0, older = false;

  async function page(cursor) {
    const mine = ++asked;
    const query = new URLSearchParams({ limit: "100", frame: frame.value, tile: tile.value, outcome: outcome.value, cursor: cursor ?? "" });
    const answer = await fetch(`${API}/jobs/${id}/attempts?${query}`);
    if (!answer.ok || mine !== asked) return;
    const list = await answer.json();
    const made = list.attempts.map((attempt) => make("tr", {}, ...shown(attempt).map((cell) => make("td", { textContent: cell }))));
    order(rows, cursor ? [...rows.children, ...made] : made);
    next = list.next ?? null;
    older = Boolean(cursor);
    onward.hidden = !next;
    text(count, rows.children.length ? `${rows.children.length}${next ? " or more" : ""} attempts` : "No attempt is like that.");
  }
  const first = () => page(null).catch(() => { /* The link says that the coordinator is away. */ });
  // Who looks at older pages is not thrown back to the first.
  const refresh = throttled(async () => { if (node.open && !older) await page(null); }, 2000);
  node.ontoggle = () => { if (node.open) first(); };
  outcome.onchange = frame.oninput = tile.oninput = first;
  onward.onclick = () => page(next).catch(() => { /* as above */ });
  return { node, refresh };
}
