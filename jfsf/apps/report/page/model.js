"use strict";

// Shows the mean of a shape model, moved along its modes by sliders; after viewer.js.

const state = { model: 0, scores: [], mode: "colours" };

byId("title").textContent = record.title;
byId("counts").textContent = record.counts;
byId("warning").hidden = !record.warning;
byId("warning").textContent = record.warning ?? "";
record.models.forEach(({ kind }) => byId("kind").append(element("option", kind)));
byId("kind-label").hidden = record.models.length < 2;
for (const name of ["mean", ...record.names]) byId("shape").append(element("option", name));

let show = () => {};
try {
  show = startViewer();
} catch (error) {
  // Without WebGL a picture of the mean stands in.
  console.warn(`no viewer: ${error.message}`);
  showPicture();
}
byId("kind").onchange = () => choose(byId("kind").selectedIndex);
byId("shape").onchange = () => {
  const row = byId("shape").selectedIndex - 1;
  setScores(row < 0 ? [] : record.models[state.model].scores[row]);
};
byId("mean").onclick = () => {
  byId("shape").selectedIndex = 0;
  setScores([]);
};
byId("random").onclick = () => {
  byId("shape").selectedIndex = -1;
  setScores(state.scores.map(normal));
};
choose(0);
document.body.dataset.ready = "yes";

// Of the standard normal distribution (Box and Muller).
function normal() {
  return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}

function choose(index) {
  const model = record.models[index];
  state.model = index;
  state.scores = model.modes.map(() => 0);
  byId("about").textContent = model.about;
  byId("shape").selectedIndex = 0;
  const shown = model.shape.n < model.vertices ? `, ${model.shape.n.toLocaleString("en")} vertices shown` : "";
  byId("label-x").textContent = `modes of ${model.kind}${shown}`;
  byId("variance").replaceChildren();
  fillTable("variance", model.rows);
  byId("sliders").replaceChildren(...model.modes.map((_, k) => sliderOf(k)));
  show(true);
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
  image.src = record.models[0].picture;
  image.alt = "The mean shape";
  byId("pane-x").replaceChildren(image, byId("label-x"));
  for (const row of document.querySelectorAll(".viewer .tools, .viewer .hint, #sliders")) row.hidden = true;
  byId("pane-x").append(element("p", "This browser has no WebGL, so the modes cannot be shown.", "hint"));
  show = () => {};
}

// ---------------------------------------------------------------- the viewer

// Returns what draws the state; the view is reset for another model.
function startViewer() {
  const ramp = unpacked(record.ramp, Uint8Array);
  const pane = makePane("x", record.models[0].shape);
  const loaded = [];
  let current = null;
  modeButtons({ colours: "Colours", distance: "Distance from the mean" }, (mode) => {
    state.mode = mode;
    paint();
  });
  const stops = [0, 64, 128, 191, 255].map((k) => `rgb(${ramp.subarray(3 * k, 3 * k + 3).join()})`);
  byId("scale-strip").style.background = `linear-gradient(90deg, ${stops})`;
  linkCameras({ x: pane }, record.models[0].turn, 1.2);
  byId("reset").onclick = () => linkCameras.reset();
  new ResizeObserver(() => resize(pane)).observe(byId("pane-x"));

  function load(index) {
    const { shape, colours, modes } = record.models[index];
    loaded[index] ??= {
      mean: Float32Array.from(unpacked(shape.points, Uint16Array), (q, i) => shape.low[i % 3] + q / 65535),
      colours: unpacked(colours, Uint8Array),
      modes: modes.map(({ unit, at }) => ({ unit, at: at.map((text) => unpacked(text, Int16Array)) })),
    };
    return loaded[index];
  }

  function move() {
    const { knots } = record.models[state.model];
    const { position } = pane.geometry.attributes;
    position.array.set(current.mean);
    current.modes.forEach(({ unit, at }, k) => {
      const t = state.scores[k];
      if (!t) return;
      // Between two knots; beyond the last one as between the last two.
      let i = 0;
      while (i < knots.length - 2 && t > knots[i + 1]) i++;
      const share = (t - knots[i]) / (knots[i + 1] - knots[i]);
      const [low, high] = [(1 - share) * unit, share * unit];
      const [before, after] = [at[i], at[i + 1]];
      for (let j = 0; j < before.length; j++) position.array[j] += low * before[j] + high * after[j];
    });
    position.needsUpdate = true;
    pane.geometry.computeVertexNormals();
    pane.geometry.computeBoundingSphere();
    paint();
  }

  function paint() {
    const { color, position } = pane.geometry.attributes;
    const { mean, colours } = current;
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

  return (other = false) => {
    if (other) {
      current = load(state.model);
      sayScores();
    }
    move();
    if (other) linkCameras.reset();
  };
}
