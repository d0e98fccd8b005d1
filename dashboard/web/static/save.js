// Export: the numbers of the visible time, and a picture of the panels.
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

const STYLES = ["fill", "stroke", "stroke-width", "stroke-linejoin", "opacity", "font-family", "font-size", "font-weight", "text-anchor", "dominant-baseline"];

// An SVG of the page as an image: outside the page it has no style sheet, so styles are copied into it.
async function drawn(node) {
  const copy = node.cloneNode(true);
  const parts = [copy, ...copy.querySelectorAll("*")];
  [node, ...node.querySelectorAll("*")].forEach((one, i) => {
    const style = getComputedStyle(one);
    for (const name of STYLES) parts[i].style.setProperty(name, style.getPropertyValue(name));
  });
  const box = node.getBoundingClientRect();
  copy.setAttribute("width", box.width);
  copy.setAttribute("height", box.height);
  const image = new Image();
  image.src = `data:image/svg+xml,${encodeURIComponent(new XMLSerializer().serializeToString(copy))}`;
  await image.decode();
  return image;
}

// Every panel on the screen that is a picture, on canvases or as SVG, with its words.
export async function png(title, panels) {
  const seen = panels.filter(({ shown }) => shown !== false).map(({ node }) => ({ node, pictures: [...node.querySelectorAll("canvas, svg")], box: node.getBoundingClientRect() }))
    .filter(({ pictures, box }) => pictures.length && box.width && box.bottom > 0 && box.top < innerHeight);
  for (const one of seen) {
    one.pictures = await Promise.all(one.pictures.map(async (picture) => [picture.getBoundingClientRect(), picture.matches("svg") ? await drawn(picture) : picture]));
  }
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
  for (const { node, pictures, box } of seen) {
    fill(colours.panel, box.left, box.top, box.width, box.height);
    write(node.querySelector("h2").textContent, box.left + 10, box.top + 19, colours.ink, "600 13px");
    let right = box.right - 10;
    for (const { text, colour } of readouts(node).reverse()) {
      write(text, right, box.top + 19, colour, "11px", "right");
      right -= context.measureText(text).width + 12;
    }
    for (const [place, picture] of pictures) context.drawImage(picture, place.left, place.top, place.width, place.height);
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
