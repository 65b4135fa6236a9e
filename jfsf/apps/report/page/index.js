"use strict";

// Lists the pairs of a batch, or the shapes of a collection, in the order of the record.

const record = JSON.parse(document.getElementById("record").textContent);
const byId = (id) => document.getElementById(id);

function element(tag, text, name) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (name) made.className = name;
  return made;
}

byId("title").textContent = record.title;
byId("counts").textContent = record.counts;
for (const row of record.rows) byId("pairs").append(rowOf(row));
byId("filter").oninput = () => {
  const wanted = byId("filter").value.toLowerCase();
  for (const row of byId("pairs").children) {
    row.hidden = !row.dataset.name.includes(wanted);
    row.style.display = row.hidden ? "none" : "";
  }
};
document.body.dataset.ready = "yes";

function rowOf(pair) {
  const row = element("li");
  const { name } = pair;
  row.dataset.name = name.toLowerCase();
  const link = (content) => {
    if (!pair.page) return content;
    const made = element("a");
    made.href = pair.page;
    made.append(content);
    return made;
  };
  if (pair.picture) {
    const image = element("img");
    image.src = pair.picture;
    image.alt = name;
    image.loading = "lazy";
    row.append(link(image));
  } else {
    row.append(element("div", "", "blank"));
  }
  const text = element("div");
  text.append(link(element("span", name)));
  for (const line of pair.lines) text.append(element("p", line));
  row.append(text, element("span", pair.verdict, `chip ${pair.level}`));
  return row;
}
