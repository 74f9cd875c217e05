// "Continue to a finer target": asks for the new target of a job that is done.

import { API, byId, reason, text } from "./dom.js";

let job = null;

export function finer(of) {
  if (!of) return;
  job = of;
  const { target } = job.quality;
  const [label, value] = target === "noise" ? ["relative error, %", 100 * job.quality.relative_error / 2]
    : target === "samples" ? ["samples a pixel", 4 * job.quality.samples] : ["processor seconds", 2 * job.quality.cpu_seconds];
  text(byId("finer-label"), label);
  byId("finer-value").value = value;
  const most = target !== "samples";
  byId("finer-most").hidden = byId("finer-most-label").hidden = !most;
  byId("finer-most").value = most ? 4 * job.quality.max_samples : "";
  text(byId("finer-said"), "");
  byId("finer").showModal();
}

byId("finer-close").onclick = () => byId("finer").close();
byId("finer-go").onclick = async () => {
  const value = Number(byId("finer-value").value), most = Number(byId("finer-most").value);
  const quality = job.quality.target === "noise" ? { ...job.quality, relative_error: value / 100, max_samples: most }
    : job.quality.target === "samples" ? { target: "samples", samples: value } : { ...job.quality, cpu_seconds: value, max_samples: most };
  try {
    const answer = await fetch(`${API}/jobs/${job.id}`, { method: "PATCH", body: JSON.stringify({ quality }) });
    if (answer.ok) byId("finer").close(); else text(byId("finer-said"), await reason(answer));
  } catch {
    text(byId("finer-said"), "The coordinator is away: nothing was changed.");
  }
};
