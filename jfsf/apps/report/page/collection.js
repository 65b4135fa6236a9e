"use strict";

// Draws the graph of a collection and lists its triangles; after index.js.

for (const [text, address] of Object.entries(record.links)) {
  const link = element("a", text);
  link.href = address;
  byId("links").append(link);
}
byId("cycles").textContent = record.cycles;
for (const id of ["triangles", "dropped"]) {
  for (const cells of record[id]) {
    const row = element("tr");
    for (const cell of cells) row.append(element("td", cell));
    byId(id).append(row);
  }
}
if (!record.dropped.length) byId("dropped-card").remove();
if (record.graph) drawGraph(record.graph);
else byId("graph").replaceWith(element("p", "There are too many shapes to draw them.", "note"));

function drawn(tag, values, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(values)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function drawGraph({ nodes, edges }) {
  const [wide, side, edge] = [1000, 90, 30];
  const most = (c) => Math.max(...nodes.map(({ at }) => at[c]), 0.05);
  const scale = (wide - 2 * side) / most(0);
  const high = Math.min(most(1) * scale, 480);
  const place = ([x, y]) => [side + scale * x, edge + (high * y) / most(1)];
  byId("graph").setAttribute("viewBox", `0 0 ${wide} ${high + 2 * edge + 20}`);
  // What is not trusted lies below, and does not hide the rest.
  const order = { dropped: 0, trusted: 1, way: 2 };
  for (const [a, b, kind, text] of [...edges].sort((e, f) => order[e[2]] - order[f[2]])) {
    const [[x1, y1], [x2, y2]] = [nodes[a], nodes[b]].map(({ at }) => place(at));
    const line = drawn("line", { x1, y1, x2, y2, class: `edge ${kind}` });
    line.append(drawn("title", {}, text));
    byId("graph").append(line);
  }
  for (const { name, at, level, text } of nodes) {
    const [cx, cy] = place(at);
    const node = drawn("g", { class: `node ${level}` });
    node.append(drawn("circle", { cx, cy, r: level === "template" ? 10 : 7 }), drawn("title", {}, text));
    if (nodes.length <= 60) {
      const short = name.length > 18 ? `${name.slice(0, 17)}…` : name;
      node.append(drawn("text", { x: cx, y: cy + 22, "text-anchor": "middle" }, short));
    }
    byId("graph").append(node);
  }
  const kinds = {
    way: "on the way from the template",
    trusted: "trusted",
    dropped: "not trusted, dropped",
  };
  for (const [kind, text] of Object.entries(kinds)) {
    const sample = drawn("svg", { width: 34, height: 10, "aria-hidden": "true" });
    sample.append(drawn("line", { x1: 2, y1: 5, x2: 32, y2: 5, class: `edge ${kind}` }));
    const entry = element("span");
    entry.append(sample, text);
    byId("key").append(entry);
  }
  for (const [level, text] of Object.entries({ template: "template", failed: "left out" })) {
    const sample = drawn("svg", { width: 16, height: 16, class: `node ${level}`, "aria-hidden": "true" });
    sample.append(drawn("circle", { cx: 8, cy: 8, r: 6 }));
    const entry = element("span");
    entry.append(sample, text);
    byId("key").append(entry);
  }
}
