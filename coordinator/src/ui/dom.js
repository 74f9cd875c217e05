// Small helpers: elements, numbers for people, calls of the API. Text goes in as text, never as HTML.

export const API = "api/v1";
export const byId = (id) => document.getElementById(id);

/** An element with properties; `aria-*`, `data-*` and `role` become attributes. */
export function make(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined) continue;
    if (name.includes("-") || name === "role" || name === "for" || name === "scope") node.setAttribute(name, value);
    else node[name] = value;
  }
  node.append(...children);
  return node;
}

/** Set a text or property only where it differs: what did not change is not drawn again. */
export function set(node, name, value) {
  if (node[name] !== value) node[name] = value;
}
export const text = (node, value) => set(node, "textContent", String(value));
export const attribute = (node, name, value) => {
  if (node.getAttribute(name) !== value) node.setAttribute(name, value);
};

/** Bring the children of `parent` into this order, moving only those that are out of place. */
export function order(parent, nodes) {
  let at = parent.firstChild;
  for (const node of nodes) {
    if (node === at) at = at.nextSibling;
    else parent.insertBefore(node, at);
  }
  while (at) {
    const next = at.nextSibling;
    at.remove();
    at = next;
  }
}

export const number = (n) => n >= 1e9 ? (n / 1e9).toFixed(2) + " G" : n >= 1e6 ? (n / 1e6).toFixed(2) + " M"
  : n >= 1e4 ? (n / 1e3).toFixed(0) + " k" : String(Math.round(n));
export const percent = (share, digits = 1) => `${(100 * share).toFixed(digits)} %`;
export const error = (relative) => `${Number((100 * relative).toPrecision(2))} %`;

export function duration(seconds) {
  const s = Math.ceil(seconds);
  return s < 60 ? `${s} s` : s < 3600 ? `${Math.floor(s / 60)} min ${s % 60} s`
    : `${Math.floor(s / 3600)} h ${Math.floor(s / 60) % 60} min`;
}

export function target(quality) {
  if (quality.target === "noise") return `${error(quality.relative_error)} error`;
  if (quality.target === "samples") return `${quality.samples} samples a pixel`;
  return `${duration(quality.cpu_seconds)} of processor time`;
}

let clearing = 0;
/** Say something that went wrong, or was done, to everybody. */
export function say(message) {
  const said = byId("said");
  said.hidden = false;
  said.textContent = message;
  clearTimeout(clearing);
  clearing = setTimeout(() => { said.hidden = true; }, 8000);
}

/** What a refusal says. */
export async function reason(answer) {
  try {
    return (await answer.json()).error.message;
  } catch {
    return `the coordinator answered ${answer.status}`;
  }
}

/** Call the API; what went wrong is said. The answer's JSON, or undefined. */
export async function call(method, path, body) {
  try {
    const answer = await fetch(`${API}${path}`, { method, body: body === undefined ? undefined : JSON.stringify(body) });
    if (answer.ok) return answer.status === 204 ? {} : await answer.json();
    say(await reason(answer));
  } catch {
    say("The coordinator is away: nothing was changed.");
  }
  return undefined;
}

/** Runs `work` at once, then at most every `pause` milliseconds, and once more after the last call. */
export function throttled(work, pause) {
  let running = false, again = false;
  return async function run() {
    if (running) { again = true; return; }
    running = true;
    try { await work(); } catch { /* The link says when the coordinator is away. */ }
    setTimeout(() => { running = false; if (again) { again = false; run(); } }, pause);
  };
}

/** A picture of nothing, for an `img` that waits for its own. */
export const NOTHING = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw==";

/** Shows in an `img` what is at a URL, asking again only for what changed. Revokes what it showed before. */
export async function show(image, url) {
  if (image.dataset.asking === url) return;
  image.dataset.asking = url;
  try {
    const answer = await fetch(url);
    if (!answer.ok) return;
    const tag = answer.headers.get("etag");
    if (tag && tag === image.dataset.tag) return;
    const before = image.src;
    image.src = URL.createObjectURL(await answer.blob());
    image.dataset.tag = tag ?? "";
    if (before.startsWith("blob:")) URL.revokeObjectURL(before);
  } catch { /* as above */ } finally {
    delete image.dataset.asking;
  }
}

export function copier(line) {
  const button = make("button", { type: "button", textContent: "Copy" });
  button.onclick = async () => {
    try { await navigator.clipboard.writeText(line()); text(button, "Copied"); } catch { text(button, "Select and copy by hand"); }
    setTimeout(() => text(button, "Copy"), 2000);
  };
  return button;
}
