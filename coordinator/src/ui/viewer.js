// The image of a frame as it grows: tiles are fetched as numbers when they change, and drawn at any exposure, as samples or
// as errors; zoom and pan; outlines in the colours of the workers that have the tiles.

import { API, make, text, throttled } from "./dom.js";
import { exposed, half, UNKNOWN, viridis, workerColour } from "./colour.js";

/** Tiles asked for at a time, as the API allows. */
const BATCH = 64;
/** Most pixels that are kept as numbers. */
const MOST = 1 << 25;
const MAPS = { image: "image", samples: "samples per pixel", error: "standard error of luminance" };

export function viewer(job) {
  const { region, tile: edge } = job;
  const columns = Math.ceil(region.w / edge), rows = Math.ceil(region.h / edge), count = columns * rows;
  const canvas = make("canvas", { width: region.w, height: region.h, className: "pixels" });
  const lines = make("canvas", { className: "lines", "aria-hidden": "true" });
  const film = make("img", { className: "film", alt: "", hidden: true });
  const stage = make("div", { className: "stage", tabIndex: 0, role: "img" }, canvas, film, lines);
  const pen = canvas.getContext("2d"), ink = lines.getContext("2d");
  const legend = make("div", { className: "legend", hidden: true });
  const bar = make("canvas", { width: 256, height: 1, className: "bar", "aria-hidden": "true" });
  const marks = make("div", { className: "marks" });
  const under = make("output", { className: "under quiet", "aria-live": "off" });
  const holders = make("ul", { className: "holders", "aria-label": "Workers that have tiles" });
  legend.append(make("span", { className: "unit" }), bar, marks);
  const paint = bar.getContext("2d"), strip = paint.createImageData(256, 1);
  for (let i = 0; i < 256; i++) strip.data.set([...viridis(i / 255), 255], 4 * i);
  paint.putImageData(strip, 0, 0);

  let frame = 0, map = "image", stops = 0, lut = exposed(0), scale = null, generation = 0;
  let zoom = 1, left = 0, top = 0, fitted = true, outlined = true, tiles = [];
  /** By tile: {rect, passes, values}. */
  let held = new Map();
  const wanted = new Set();
  const large = region.w * region.h > MOST;

  // ---- what is shown

  function pixels(values, rect) {
    const picture = pen.createImageData(rect.w, rect.h), out = picture.data;
    for (let i = 0, n = rect.w * rect.h; i < n; i++) {
      if (map === "image") {
        out[4 * i] = lut[values[3 * i]];
        out[4 * i + 1] = lut[values[3 * i + 1]];
        out[4 * i + 2] = lut[values[3 * i + 2]];
      } else {
        const colour = values[i] > 0 && Number.isFinite(values[i]) ? viridis(place(values[i])) : map === "error" && values[i] === 0 ? viridis(0) : UNKNOWN;
        out[4 * i] = colour[0];
        out[4 * i + 1] = colour[1];
        out[4 * i + 2] = colour[2];
      }
      out[4 * i + 3] = 255;
    }
    pen.putImageData(picture, rect.x - region.x, rect.y - region.y);
  }
  const place = (value) => scale.high > scale.low ? Math.log(Math.max(value, scale.low) / scale.low) / Math.log(scale.high / scale.low) : 0.5;

  /** The map's range as the coordinator's PNG has it: samples from the fewest to the most; errors three decades below the
   *  one that all but a thousandth keep to. */
  function range() {
    const found = [];
    let low = Infinity, high = 0;
    for (const { values } of held.values()) {
      for (const value of values) {
        if (!(value > 0) || !Number.isFinite(value)) continue;
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
      if (map === "error") for (let i = 0; i < values.length; i += 7) if (Number.isFinite(values[i])) found.push(values[i]);
    }
    if (map === "error") {
      found.sort((a, b) => a - b);
      high = found[Math.max(0, found.length - 1 - Math.floor(found.length / 1000))] || 1;
      low = high * 1e-3;
    }
    return high > 0 ? { low, high } : { low: 1, high: 1 };
  }

  /** Draw these tiles; all, where the scale moved. */
  function draw(ids) {
    if (map !== "image") {
      const next = range();
      const moved = !scale || Math.abs(next.high / scale.high - 1) > 0.01 || Math.abs(next.low / scale.low - 1) > 0.01;
      if (moved) { scale = next; ids = held.keys(); }
      label();
    }
    for (const id of ids) {
      const tile = held.get(id);
      if (tile) pixels(tile.values, tile.rect);
    }
  }

  function label() {
    legend.hidden = map === "image";
    if (map === "image") return;
    text(legend.firstChild, MAPS[map]);
    const at = scale.high > scale.low ? [0, 1 / 3, 2 / 3, 1] : [0.5];
    marks.replaceChildren(...at.map((t) => {
      const value = scale.high > scale.low ? scale.low * (scale.high / scale.low) ** t : scale.low;
      return make("span", { textContent: map === "samples" ? value.toFixed(0) : value.toPrecision(2) });
    }));
  }

  // ---- what is fetched

  const fetching = throttled(async () => {
    while (wanted.size) {
      if (large || document.hidden) return;
      const batch = [...wanted].slice(0, BATCH), of = generation;
      batch.forEach((id) => wanted.delete(id));
      let answer;
      try {
        answer = await fetch(`${API}/jobs/${job.id}/frames/${frame}/pixels?map=${map}&tiles=${batch.join(",")}`);
      } catch (error) {
        if (of === generation) batch.forEach((id) => wanted.add(id));
        throw error;
      }
      if (of !== generation) continue;
      if (!answer.ok) return;
      const bytes = await answer.arrayBuffer();
      if (of !== generation) continue;
      draw(read(bytes));
      stage.dataset.tiles = held.size;
    }
  }, 250);

  function read(bytes) {
    const view = new DataView(bytes), ids = [];
    for (let at = 0; at < bytes.byteLength;) {
      const [id, x, y, w, h, passes] = [0, 4, 8, 12, 16, 20].map((offset) => view.getUint32(at + offset, true));
      at += 24;
      const length = w * h * (map === "image" ? 6 : 4);
      const copy = bytes.slice(at, at + length);
      held.set(id, { rect: { x, y, w, h }, passes, values: map === "image" ? new Uint16Array(copy) : new Float32Array(copy) });
      ids.push(id);
      at += length;
    }
    return ids;
  }

  function anew() {
    generation++;
    held = new Map();
    stage.dataset.tiles = 0;
    scale = null;
    pen.clearRect(0, 0, region.w, region.h);
    wanted.clear();
    for (let id = 0; id < count; id++) wanted.add(id);
    legend.hidden = true;
    fetching();
  }

  // ---- where it is shown

  function move() {
    if (fitted) {
      zoom = Math.min(stage.clientWidth / region.w, stage.clientHeight / region.h, 8);
      left = (stage.clientWidth - region.w * zoom) / 2;
      top = (stage.clientHeight - region.h * zoom) / 2;
    }
    for (const shown of [canvas, film]) {
      shown.style.transform = `translate(${left}px, ${top}px) scale(${zoom})`;
      shown.style.imageRendering = zoom > 1.5 ? "pixelated" : "auto";
    }
    film.style.width = `${region.w}px`;
    film.style.height = `${region.h}px`;
    outline();
    stage.dataset.zoom = zoom.toFixed(3);
  }

  function outline() {
    const ratio = devicePixelRatio || 1;
    const [w, h] = [stage.clientWidth * ratio, stage.clientHeight * ratio].map(Math.round);
    if (lines.width !== w || lines.height !== h) [lines.width, lines.height] = [w, h];
    ink.clearRect(0, 0, w, h);
    const having = new Map();
    for (const tile of tiles) {
      if (tile.state !== "leased" || !tile.worker) continue;
      having.set(tile.worker, (having.get(tile.worker) ?? 0) + 1);
      if (!outlined) continue;
      const { x, y, w, h } = tile.rect;
      ink.strokeStyle = workerColour(tile.worker);
      ink.lineWidth = 2 * ratio;
      ink.strokeRect((left + (x - region.x) * zoom + 1) * ratio, (top + (y - region.y) * zoom + 1) * ratio, (w * zoom - 2) * ratio, (h * zoom - 2) * ratio);
    }
    holders.replaceChildren(...[...having].sort().map(([worker, n]) => {
      const swatch = make("span", { className: "swatch" });
      swatch.style.background = workerColour(worker);
      return make("li", {}, swatch, `${worker}: ${n} tile${n > 1 ? "s" : ""}`);
    }));
  }

  function zoomBy(factor, x = stage.clientWidth / 2, y = stage.clientHeight / 2) {
    const next = Math.min(64, Math.max(0.05, zoom * factor));
    left = x - (x - left) * next / zoom;
    top = y - (y - top) * next / zoom;
    zoom = next;
    fitted = false;
    move();
  }
  const pan = (x, y) => { left += x; top += y; fitted = false; move(); };
  const fit = () => { fitted = true; move(); };

  stage.addEventListener("wheel", (event) => {
    // A wheel over the image zooms only when the image has the focus or Ctrl is held: else it scrolls the page.
    if (!event.ctrlKey && document.activeElement !== stage) return;
    event.preventDefault();
    const box = stage.getBoundingClientRect();
    zoomBy(2 ** (-event.deltaY / 400), event.clientX - box.left, event.clientY - box.top);
  }, { passive: false });
  const pointers = new Map();
  stage.addEventListener("pointerdown", (event) => {
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    stage.setPointerCapture(event.pointerId);
  });
  for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, (event) => pointers.delete(event.pointerId));
  stage.addEventListener("pointermove", (event) => {
    told(event);
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    if (pointers.size === 2) {
      // Two fingers: what lies between them stays between them.
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const box = stage.getBoundingClientRect();
      const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
      zoomBy(apart(now, other) / apart(before, other), (now[0] + other[0]) / 2 - box.left, (now[1] + other[1]) / 2 - box.top);
    } else pan(now[0] - before[0], now[1] - before[1]);
    pointers.set(event.pointerId, now);
  });
  stage.addEventListener("pointerleave", () => text(under, ""));
  stage.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 200 : 40;
    const act = {
      "+": () => zoomBy(1.25), "=": () => zoomBy(1.25), "-": () => zoomBy(0.8), "0": fit,
      "1": () => zoomBy(1 / zoom), ArrowLeft: () => pan(step, 0), ArrowRight: () => pan(-step, 0), ArrowUp: () => pan(0, step), ArrowDown: () => pan(0, -step),
    }[event.key];
    if (act && !event.ctrlKey && !event.metaKey) { event.preventDefault(); act(); }
  });

  /** What lies under the pointer. */
  function told(event) {
    const box = stage.getBoundingClientRect();
    const x = Math.floor((event.clientX - box.left - left) / zoom), y = Math.floor((event.clientY - box.top - top) / zoom);
    if (x < 0 || y < 0 || x >= region.w || y >= region.h) return text(under, "");
    const id = Math.floor(y / edge) * columns + Math.floor(x / edge), tile = held.get(id), at = tiles[id];
    let value = "not rendered yet";
    if (tile) {
      const i = (y - (tile.rect.y - region.y)) * tile.rect.w + x - (tile.rect.x - region.x);
      value = map === "image" ? [0, 1, 2].map((channel) => half(tile.values[3 * i + channel]).toPrecision(3)).join(" ")
        : `${Number(tile.values[i].toPrecision(3))} ${MAPS[map]}`;
    }
    const more = at ? ` · ${at.state}, ${at.passes} pass${at.passes === 1 ? "" : "es"}${at.worker ? `, ${at.worker}` : ""}${at.message ? ` · ${at.message}` : ""}` : "";
    text(under, `${x + region.x}, ${y + region.y}: ${value} · tile ${id}${more}`);
  }

  const resized = new ResizeObserver(move);
  resized.observe(stage);

  return {
    stage, legend, under, holders, large,
    zoomIn: () => zoomBy(1.25), zoomOut: () => zoomBy(0.8), fit, whole: () => zoomBy(1 / zoom),
    show(number) { frame = number; anew(); },
    map(kind) { map = kind; stage.dataset.map = kind; anew(); },
    expose(value) { stops = value; lut = exposed(stops); if (map === "image") draw(held.keys()); },
    changed(tile) { wanted.add(tile); fetching(); },
    again: anew,
    retry: fetching,
    tiles(list) { tiles = list; outline(); },
    outlines(shown) { outlined = shown; outline(); },
    film(url) { film.hidden = !url; if (url) film.src = url; lines.hidden = Boolean(url); },
    name(words) { stage.setAttribute("aria-label", words); },
    close() { resized.disconnect(); generation++; wanted.clear(); },
  };
}
