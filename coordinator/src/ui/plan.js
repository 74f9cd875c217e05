// What a job's plan says: the method that was chosen and what was tried for it, what is in the scene, and what is not and
// costs nothing.

import { make, number } from "./dom.js";

/** Facts of a scene in words, as `tessera plan` has them; whatever is new here is told by its name. */
const FACTS = {
  area_lights: "area lights", delta_lights: "point, spot or directional lights", environment: "an environment",
  delta: "mirrors or smooth glass", rough: "rough surfaces", transmission: "transmission", textures: "textures",
  smooth_normals: "shading normals", tangents: "tangents", opacity: "opacity masks", instances: "instances",
};
/** Told otherwise: the number of emitters says it. */
const UNTOLD = ["one_emitter"];

export function planOf(plan) {
  const facts = Object.entries(plan.facts).filter(([name, value]) => typeof value === "boolean" && !UNTOLD.includes(name));
  const words = (has) => facts.filter(([, value]) => value === has).map(([name]) => FACTS[name] ?? name.replaceAll("_", " ")).join(", ") || "–";
  const counts = Object.entries(plan.facts).filter(([, value]) => typeof value === "number").map(([name, value]) => `${number(value)} ${name}`).join(", ");
  const why = plan.untried ? plan.untried : `best of ${plan.considered?.length ?? 0} methods tried`;
  const rows = [["method", `${plan.chosen} (${why})`], ["in the scene", words(true)], ["not in it, and nothing spent on", words(false)],
    ["counted", counts], ["code that renders it", plan.kernel.join(", ") || "–"]];
  const nodes = [make("dl", {}, ...rows.flatMap(([name, value]) => [make("dt", { textContent: name }), make("dd", { textContent: value })]))];
  if (plan.considered?.length) {
    const labels = ["Method tried", "Samples", "Variance of one", "Cost of one", "Efficiency"];
    const cells = (one) => [one.name, number(one.samples), one.variance.toPrecision(3), `${number(one.cost)} ns`, one.efficiency.toPrecision(2)];
    nodes.push(make("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Methods tried" }, make("table", {},
      make("caption", { textContent: "Variance is relative to the squared luminance; cost is counted work, about nanoseconds of one core; efficiency is 1 / (variance × cost), relative to the choice." }),
      make("thead", {}, make("tr", {}, ...labels.map((label) => make("th", { textContent: label, scope: "col" })))),
      make("tbody", {}, ...plan.considered.map((one) => make("tr", {}, ...cells(one).map((cell, i) => make(i ? "td" : "th", i ? { textContent: cell } : { textContent: cell, scope: "row" }))))))));
  }
  return nodes;
}
