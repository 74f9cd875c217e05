// A job's frames as a strip of small pictures, and as an animation.

import { API, attribute, make, NOTHING, show, text } from "./dom.js";

/** Pictures a second. */
const RATE = 12;

export function strip(job, { choose, film }) {
  const id = job.id;
  const node = make("div", { className: "frames", hidden: job.frames.length < 2 });
  const play = make("button", { type: "button", textContent: "▶ Play", "data-act": "play" });
  const list = make("ol", { className: "strip", "aria-label": "Frames" });
  node.append(play, list);
  const items = new Map();
  let urls = [], playing = 0, frames = job.frames;
  const seen = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => {
    target.visible = isIntersecting;
    if (isIntersecting) target.refresh();
  }));

  function item(number) {
    const image = make("img", { alt: "", width: 96, src: NOTHING });
    const label = make("span");
    const button = make("button", { type: "button", onclick: () => { stop(); choose(number); } }, image, label);
    const node = make("li", {}, button);
    let shown = -1;
    Object.assign(node, {
      button,
      refresh() {
        const frame = node.frame;
        if (!frame || !node.visible || shown === frame.mean_samples) return;
        shown = frame.mean_samples;
        show(image, `${API}/jobs/${id}/frames/${number}/image.png?width=96`);
      },
      update(frame) {
        node.frame = frame;
        text(label, `${number}${frame.done ? "" : ` · ${Math.floor(100 * frame.progress)} %`}`);
        attribute(button, "aria-label", `frame ${number}, ${frame.done ? "done" : `${Math.floor(100 * frame.progress)} % done`}`);
        node.refresh();
      },
    });
    seen.observe(node);
    return node;
  }

  async function start() {
    text(play, "Fetching …");
    const done = frames.filter((frame) => frame.done || frame.progress > 0);
    const mine = ++playing;
    try {
      for (const { frame } of done) {
        const answer = await fetch(`${API}/jobs/${id}/frames/${frame}/image.png?width=1024`);
        if (playing !== mine) return;
        urls.push(URL.createObjectURL(await answer.blob()));
        text(play, `Fetching ${urls.length} of ${done.length} …`);
      }
    } catch {
      return stop();
    }
    text(play, "■ Stop");
    let at = 0;
    const step = () => {
      if (playing !== mine || !urls.length) return;
      film(urls[at++ % urls.length]);
      setTimeout(step, 1000 / RATE);
    };
    step();
  }
  function stop() {
    playing++;
    text(play, "▶ Play");
    film(null);
    urls.forEach((url) => URL.revokeObjectURL(url));
    urls = [];
  }
  play.onclick = () => (play.textContent.startsWith("▶") ? start() : stop());

  return {
    node, stop,
    update(now) {
      frames = now.frames;
      if (frames.length < 2) return;
      for (const frame of frames) {
        let found = items.get(frame.frame);
        if (!found) {
          items.set(frame.frame, found = item(frame.frame));
          list.append(found);
        }
        if (found.frame?.progress !== frame.progress || found.frame?.mean_samples !== frame.mean_samples) found.update(frame);
      }
    },
    mark(frame) {
      for (const [number, found] of items) attribute(found.button, "aria-current", String(number === frame));
    },
  };
}
