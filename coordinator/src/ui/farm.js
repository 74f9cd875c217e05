// The view of the farm as a whole: queue, throughput and busy share over the last hour.

import { API, make, number, percent, show, text } from "./dom.js";

const CHARTS = { queue: "units in the queue", throughput: "samples a second", busy: "busy share of the workers" };

export function farmView(main) {
  const facts = make("p", { role: "status" });
  const images = Object.entries(CHARTS).map(([name, words]) => make("img", { className: "chart", "data-chart": name, alt: `Chart of the last hour: ${words}`, width: 800, height: 500 }));
  main.append(make("h2", { textContent: "Farm" }), facts, make("div", { className: "charts" }, ...images),
    make("p", { className: "quiet" }, "They go on through restarts of the coordinator. For longer than an hour: ", make("a", { href: "metrics", textContent: "metrics for Prometheus" }), "."));
  async function draw() {
    if (document.hidden) return;
    try {
      const farm = await (await fetch(`${API}/farm`)).json();
      const last = farm.history.at(-1);
      const of = (counts) => Object.entries(counts).map(([state, n]) => `${n} ${state}`).join(", ") || "none";
      text(facts, `${number(farm.units_pending)} units wait, ${number(farm.units_leased)} are with workers`
        + (last ? ` · ${number(last.samples_per_second)} samples/s · ${percent(last.busy, 0)} busy` : "")
        + ` · jobs: ${of(farm.jobs)} · workers: ${of(farm.workers)} · Tessera ${farm.version}`);
      await Promise.all(images.map((image) => show(image, `${API}/farm/${image.dataset.chart}.svg`)));
    } catch { /* The link says that the coordinator is away. */ }
  }
  draw();
  const drawing = setInterval(draw, 5000);
  return () => clearInterval(drawing);
}
