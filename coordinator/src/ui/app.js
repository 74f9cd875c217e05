// The page: chooses the view that the address names and lets it draw.

import { byId } from "./dom.js";
import { farmView } from "./farm.js";
import { jobView } from "./job.js";
import { jobsView } from "./jobs.js";
import { listen } from "./store.js";
import { submission } from "./submit.js";
import { workersView } from "./workers.js";

let leave = () => {};

/** `#/jobs`, `#/job/j1`, `#/workers`, `#/farm`. Each view draws into `main` and returns how to stop. */
function route() {
  const [, view = "jobs", id] = location.hash.split("/");
  leave();
  document.querySelectorAll("dialog[open]").forEach((dialog) => dialog.close());
  const main = byId("main");
  main.replaceChildren();
  for (const link of document.querySelectorAll("nav [data-view]")) {
    const current = link.dataset.view === view || (view === "job" && link.dataset.view === "jobs");
    if (current) link.setAttribute("aria-current", "page"); else link.removeAttribute("aria-current");
  }
  document.title = "Tessera";
  leave = (view === "job" && id ? jobView(main, id) : view === "workers" ? workersView(main)
    : view === "farm" ? farmView(main) : jobsView(main)) ?? (() => {});
}

addEventListener("hashchange", () => { route(); byId("main").focus({ preventScroll: true }); scrollTo(0, 0); });
submission();
route();
listen();
