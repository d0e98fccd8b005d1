// Elements without markup in strings: the page's policy allows no other.

export function el(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

export function svg(tag, attributes = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

export const $ = (id) => document.getElementById(id);

// Only what changed: writing the same text again costs a layout.
export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

// Words with `commands` in them.
export function prose(node, text) {
  const parts = text.split("`");
  if (node.textContent !== parts.join("")) node.replaceChildren(...parts.map((part, i) => (i % 2 ? el("code", {}, part) : part)));
}

export function mark(node, name, value) {
  if (node.dataset[name] !== value) node.dataset[name] = value;
}

const names = ["page", "ink", "dim", "line", "panel", "measured", "wanted", "model", "feedback", "learnt", "truth", "given", "band", "saturated", "adapting", "info", "warning", "fault"];
export const colours = {};

export function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of names) colours[name] = style.getPropertyValue(`--${name}`).trim();
}
