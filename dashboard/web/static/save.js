// What is seen, as files: the numbers of the time that is shown, and a picture of the panels.
import { colours } from "./dom.js";

export function csv(store, from, to, wall) {
  const first = store.find(from);
  const end = Math.min(store.end, store.find(to) + 1);
  const lines = [["t_s", "utc", ...store.columns].join()];
  for (let i = first; i < end; i++) {
    const t = store.t[i];
    if (t > to) break;
    const values = store.arrays.map((column) => (Number.isNaN(column[i]) ? "" : String(+column[i].toPrecision(7))));
    lines.push([t.toFixed(3), new Date((t + wall) * 1000).toISOString(), ...values].join());
  }
  return `${lines.join("\n")}\n`;
}

// Every panel on the screen that is drawn on canvases, with its words.
export function png(title, panels) {
  const seen = panels.filter(({ shown }) => shown !== false).map(({ node }) => ({ node, canvases: [...node.querySelectorAll("canvas")], box: node.getBoundingClientRect() }))
    .filter(({ canvases, box }) => canvases.length && box.width && box.bottom > 0 && box.top < innerHeight);
  const edge = (name, pick) => pick(...seen.map(({ box }) => box[name]));
  const [left, top, right, bottom] = [edge("left", Math.min), edge("top", Math.min), edge("right", Math.max), edge("bottom", Math.max)];
  const head = 30;
  const ratio = devicePixelRatio;
  const canvas = document.createElement("canvas");
  canvas.width = Math.round((right - left + 16) * ratio);
  canvas.height = Math.round((bottom - top + 16 + head) * ratio);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const fill = (colour, x, y, width, height) => {
    context.fillStyle = colour;
    context.fillRect(x, y, width, height);
  };
  const write = (text, x, y, colour, font, align = "left") => {
    Object.assign(context, { fillStyle: colour, font: `${font} system-ui, sans-serif`, textAlign: align });
    context.fillText(text, x, y);
  };
  fill(colours.page, 0, 0, canvas.width, canvas.height);
  write(title, 10, 21, colours.ink, "600 14px");
  context.translate(8 - left, 8 + head - top);
  for (const { node, canvases, box } of seen) {
    fill(colours.panel, box.left, box.top, box.width, box.height);
    write(node.querySelector("h2").textContent, box.left + 10, box.top + 19, colours.ink, "600 13px");
    let right = box.right - 10;
    for (const { text, colour } of readouts(node).reverse()) {
      write(text, right, box.top + 19, colour, "11px", "right");
      right -= context.measureText(text).width + 12;
    }
    for (const one of canvases) {
      const place = one.getBoundingClientRect();
      context.drawImage(one, place.left, place.top, place.width, place.height);
    }
  }
  return new Promise((done) => { canvas.toBlob(done, "image/png"); });
}

// The words of a heading, in the colours of their lines.
const readouts = (node) => [...node.querySelectorAll(".readouts > :not([hidden])")].map((one) => ({
  text: [...one.childNodes].map((part) => part.textContent).join(" "),
  colour: [...one.classList].map((name) => name !== "band" && colours[name]).find(Boolean) ?? colours.dim,
}));

export function save(blob, name) {
  const url = URL.createObjectURL(blob);
  const link = Object.assign(document.createElement("a"), { href: url, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
