"use strict";

// Shows the mean of a shape model, moved along its modes by sliders; after viewer.js.

const state = { scores: record.modes.map(() => 0), mode: "colours" };

byId("title").textContent = record.title;
byId("counts").textContent = record.counts;
const few = record.shape.n < record.vertices;
byId("label-x").textContent = few ? `${record.shape.n.toLocaleString("en")} vertices shown` : "";
fillTable("variance", record.rows);
byId("sliders").append(...record.modes.map((_, k) => sliderOf(k)));
for (const name of ["mean", ...record.names]) byId("shape").append(element("option", name));

let show = () => {};
try {
  show = startViewer();
} catch (error) {
  // Without WebGL a picture of the mean stands in.
  console.warn(`no viewer: ${error.message}`);
  showPicture();
}
byId("shape").onchange = () => {
  const row = byId("shape").selectedIndex - 1;
  setScores(row < 0 ? [] : record.scores[row]);
};
byId("mean").onclick = () => {
  byId("shape").selectedIndex = 0;
  setScores([]);
};
byId("random").onclick = () => {
  byId("shape").selectedIndex = -1;
  setScores(state.scores.map(normal));
};
sayScores();
document.body.dataset.ready = "yes";

// Of the standard normal distribution (Box and Muller).
function normal() {
  return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}

function sliderOf(k) {
  const row = element("label");
  const slider = element("input");
  Object.assign(slider, { type: "range", min: -record.reach, max: record.reach, step: 0.05, value: 0 });
  slider.oninput = () => {
    state.scores[k] = Number(slider.value);
    byId("shape").selectedIndex = state.scores.some(Boolean) ? -1 : 0;
    sayScores();
    show();
  };
  row.append(element("span", `Mode ${k + 1}`), slider, element("output"));
  return row;
}

// Beyond the sliders' ends too: scores of shapes may lie there.
function setScores(scores) {
  state.scores = state.scores.map((_, k) => scores[k] ?? 0);
  sayScores();
  show();
}

function sayScores() {
  [...byId("sliders").children].forEach((row, k) => {
    const value = state.scores[k];
    row.querySelector("input").value = value;
    row.querySelector("output").textContent = (value < 0 ? "−" : "") + Math.abs(value).toFixed(2);
  });
}

function showPicture() {
  const image = element("img");
  image.src = record.picture;
  image.alt = "The mean shape";
  byId("pane-x").replaceChildren(image, byId("label-x"));
  for (const row of document.querySelectorAll(".viewer .tools, .viewer .hint, #sliders")) row.hidden = true;
  byId("pane-x").append(element("p", "This browser has no WebGL, so the modes cannot be shown.", "hint"));
  show = () => {};
}

// ---------------------------------------------------------------- the viewer

// Returns what draws the state.
function startViewer() {
  const ramp = unpacked(record.ramp, Uint8Array);
  const pane = makePane("x", record.shape);
  const mean = pane.points.slice();
  const colours = unpacked(record.colours, Uint8Array);
  const modes = record.modes.map(({ unit, at }) => ({ unit, at: unpacked(at, Int16Array) }));
  modeButtons({ colours: "Colours", distance: "Distance from the mean" }, (mode) => {
    state.mode = mode;
    paint();
  });
  const stops = [0, 64, 128, 191, 255].map((k) => `rgb(${ramp.subarray(3 * k, 3 * k + 3).join()})`);
  byId("scale-strip").style.background = `linear-gradient(90deg, ${stops})`;
  linkCameras({ x: pane }, record.turn, 1.2);
  byId("reset").onclick = () => linkCameras.reset();
  new ResizeObserver(() => resize(pane)).observe(byId("pane-x"));

  function move() {
    const { position } = pane.geometry.attributes;
    position.array.set(mean);
    modes.forEach(({ unit, at }, k) => {
      const share = (unit * state.scores[k]) / record.reach;
      if (share) for (let j = 0; j < at.length; j++) position.array[j] += share * at[j];
    });
    position.needsUpdate = true;
    pane.geometry.computeVertexNormals();
    pane.geometry.computeBoundingSphere();
    paint();
  }

  function paint() {
    const { color, position } = pane.geometry.attributes;
    const plain = state.mode === "colours";
    byId("scale").hidden = plain;
    let top = 0;
    const away = plain ? [] : Float32Array.from({ length: pane.shape.n }, (_, i) => {
      const d = Math.hypot(...[0, 1, 2].map((c) => position.array[3 * i + c] - mean[3 * i + c]));
      top = Math.max(top, d);
      return d;
    });
    byId("scale-top").textContent = (100 * top).toPrecision(2);
    for (let i = 0; i < pane.shape.n; i++) {
      const from = plain ? colours : ramp;
      const at = plain ? i : Math.round((255 * away[i]) / (top || 1));
      for (let c = 0; c < 3; c++) color.array[3 * i + c] = LINEAR[from[3 * at + c]];
    }
    color.needsUpdate = true;
    redraw(pane);
  }

  move();
  return move;
}
