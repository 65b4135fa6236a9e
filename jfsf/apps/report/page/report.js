"use strict";

// Fills in the texts of the page, and shows both shapes; after viewer.js.

fillTexts();
try {
  startViewer();
} catch (error) {
  // Without WebGL a picture stands in for the shapes.
  console.warn(`no viewer: ${error.message}`);
  showPicture();
}
document.body.dataset.ready = "yes";

// ---------------------------------------------------------------- texts

function fillTexts() {
  const { verdict } = record;
  byId("title").textContent = `${record.x.name} → ${record.y.name}`;
  const percent = verdict.confidence === null ? "" : ` (${percentOf(verdict.confidence)})`;
  byId("verdict").textContent = verdict.words + percent;
  byId("verdict").classList.add(verdict.level);
  byId("sentence").textContent = {
    good: `The map is ${verdict.words}. Look at the shapes all the same.`,
    fair: `The map is ${verdict.words}. Look for parts that are exchanged.`,
    poor: `The map is ${verdict.words}. Do not use it before you have looked at it.`,
    unknown: "How likely the map is right is not known. Look at the shapes.",
  }[verdict.level];
  for (const reason of record.reasons) byId("reasons").append(element("li", reason));
  for (const { why, advice } of record.findings) {
    const box = element("div", undefined, "finding");
    box.append(element("b", sentence(why)), advice);
    byId("findings").append(box);
  }
  for (const side of ["x", "y"]) {
    const { name, vertices } = record[side];
    const shown = record.shown[side === "x" ? 0 : 1];
    const counted = `${vertices.toLocaleString("en")} vertices`;
    const part = shown < vertices ? `, ${shown.toLocaleString("en")} shown` : "";
    const label = ` (${side.toUpperCase()}), ${counted}${part}`;
    byId(`label-${side}`).append(element("b", name), label);
    for (const place of document.querySelectorAll(`.name-${side}`)) place.textContent = name;
  }
  fillTable("figures", record.figures);
  fillTable("truth", record.truth);
  fillTable("certificate", record.certificate);
  for (const name of ["settings", "versions", "seconds"]) {
    const rows = Object.entries(record[name]);
    if (!rows.length) {
      byId(name).remove();
      continue;
    }
    fillTable(name, rows);
    byId(name).prepend(element("caption", name[0].toUpperCase() + name.slice(1)));
  }
  byId("functional_map").src = record.pictures.functional_map;
  if (record.pictures.errors) byId("errors").src = record.pictures.errors;
  else byId("truth-card").remove();
  if (!record.candidates.length) byId("candidates-card").remove();
}

function percentOf(share) {
  const percent = Math.round(100 * share);
  if (percent === 100 && share < 1) return "over 99 %";
  return percent === 0 && share > 0 ? "under 1 %" : `${percent} %`;
}

function sentence(text) {
  return text[0].toUpperCase() + text.slice(1) + ".";
}

function showPicture() {
  const image = element("img");
  image.src = record.pictures.pair;
  image.alt = `${record.x.name} in the colours of ${record.y.name}, beside it`;
  document.querySelector(".panes").replaceChildren(image);
  document.querySelector(".tools").remove();
  byId("hint").textContent = "This browser has no WebGL, so the shapes cannot be turned.";
  byId("candidates").append(...record.candidates.map((row) => candidateButton(row)));
}

// ---------------------------------------------------------------- the viewer

function startViewer() {
  const { scene } = record;
  const panes = {
    x: makePane("x", scene.x),
    y: makePane("y", scene.y),
  };
  const maps = scene.maps.map(({ name, xy, yx }) => ({
    name,
    xy: indices(xy, scene.y.n),
    yx: indices(yx, scene.x.n),
  }));
  const coloursY = unpacked(scene.y.colours, Uint8Array);
  // Only of parts, whose page has one map: there X is grey where it is not matched.
  const coloursX = scene.x.colours && unpacked(scene.x.colours, Uint8Array);
  if (coloursX) byId("hint").append(" What is grey is not matched.");
  const uvY = unpacked(scene.y.uv, Uint16Array);
  const ramp = unpacked(scene.ramp, Uint8Array);
  const figures = scene.figures.map((figure) => ({
    ...figure,
    steps: unpacked(figure.steps, Uint8Array),
  }));
  const checker = makeChecker();
  const state = { map: 0, mode: "colours", marks: [] };

  linkCameras(panes, scene.turn);
  makeControls();
  paint();
  new ResizeObserver(() => Object.values(panes).forEach(resize)).observe(byId("pane-x"));

  // X is painted as Y is, through the map.
  function paint() {
    const { xy } = maps[state.map];
    const figure = figures.find(({ name }) => name === state.mode);
    const grey = [188, 194, 204];
    setColours(panes.x, (i) => {
      if (!figure && coloursX) return coloursX.subarray(3 * i, 3 * i + 3);
      if (!figure) return coloursY.subarray(3 * xy[i], 3 * xy[i] + 3);
      const step = figure.steps[i];
      return step === 255 ? grey : ramp.subarray(3 * step, 3 * step + 3);
    });
    setColours(panes.y, (j) => (figure ? grey : coloursY.subarray(3 * j, 3 * j + 3)));
    setTexture(panes.x, (i) => xy[i]);
    setTexture(panes.y, (j) => j);
    byId("scale").hidden = !figure;
    if (figure) {
      byId("scale-top").textContent = figure.top.toPrecision(2);
      const meanings = { doubt: "1 − the confidence of a vertex", "not shared": "1 − the membership of a vertex" };
      const meaning = meanings[figure.name] ?? "geodesic distance / √area";
      byId("scale-name").textContent = `${figure.name}, on ${record.x.name}: ${meaning}, of the map found`;
      const stops = [0, 63, 127, 190, 254].map((k) => `rgb(${ramp.subarray(3 * k, 3 * k + 3).join()})`);
      byId("scale-strip").style.background = `linear-gradient(90deg, ${stops})`;
    }
    drawMarks();
  }

  function setColours(pane, colourOf) {
    const { array } = pane.geometry.attributes.color;
    for (let i = 0; i < pane.shape.n; i++) {
      const colour = colourOf(i);
      for (let c = 0; c < 3; c++) array[3 * i + c] = LINEAR[colour[c]];
    }
    pane.geometry.attributes.color.needsUpdate = true;
  }

  function setTexture(pane, sourceOf) {
    const { array } = pane.geometry.attributes.uv;
    for (let i = 0; i < pane.shape.n; i++) {
      const j = sourceOf(i);
      array[2 * i] = uvY[2 * j] / 65535;
      array[2 * i + 1] = uvY[2 * j + 1] / 65535;
    }
    pane.geometry.attributes.uv.needsUpdate = true;
    const map = state.mode === "checker" ? checker : null;
    if (pane.material.map !== map) {
      pane.material.map = map;
      pane.material.needsUpdate = true;
    }
  }

  // A click on either shape marks the point and its image. The colour tells pairs apart.
  function mark(side, vertex) {
    const colours = ["#e4572e", "#2e86ab", "#8e44ad", "#2a9d55", "#c08a00", "#d6336c"];
    const used = state.marks.map((one) => one.colour);
    const free = colours.find((colour) => !used.includes(colour));
    if (!free) state.marks.shift();
    const colour = free || colours.find((one) => !state.marks.some((m) => m.colour === one));
    state.marks.push({ side, vertex, colour });
    drawMarks();
  }

  function drawMarks() {
    const { xy, yx } = maps[state.map];
    for (const pane of Object.values(panes)) pane.marks.clear();
    byId("marks").replaceChildren();
    for (const { side, vertex, colour } of state.marks) {
      const other = side === "x" ? "y" : "x";
      const image = (side === "x" ? xy : yx)[vertex];
      addMark(panes[side], vertex, colour);
      addMark(panes[other], image, colour);
      const name = (s, v) => `${s.toUpperCase()} ${panes[s].numbers ? panes[s].numbers[v] : v}`;
      const line = element("li", `${name(side, vertex)} → ${name(other, image)}`);
      line.style.setProperty("--dot", colour);
      byId("marks").append(line);
    }
    byId("clear").disabled = !state.marks.length;
    Object.values(panes).forEach(redraw);
  }

  function makeControls() {
    const modes = ["colours", "checker", ...figures.map(({ name }) => name)];
    const texts = modes.map((mode) => [mode, mode[0].toUpperCase() + mode.slice(1)]);
    modeButtons(Object.fromEntries(texts), (mode) => {
      state.mode = mode;
      paint();
    });
    const choose = (index) => {
      state.map = index;
      byId("map").selectedIndex = index;
      if (record.candidates.length) press(byId("candidates").children, byId("candidates").children[index]);
      paint();
    };
    for (const { name } of maps) byId("map").append(element("option", name));
    byId("map").onchange = () => choose(byId("map").selectedIndex);
    const found = { name: maps[0].name, picture: record.pictures.found };
    if (record.candidates.length) {
      [found, ...record.candidates].forEach((row, index) => {
        const button = candidateButton(row);
        button.onclick = () => {
          choose(index);
          document.querySelector(".viewer").scrollIntoView({ behavior: "smooth" });
        };
        byId("candidates").append(button);
      });
      press(byId("candidates").children, byId("candidates").firstChild);
    }
    byId("reset").onclick = () => linkCameras.reset();
    byId("clear").onclick = () => {
      state.marks = [];
      drawMarks();
    };
    for (const [side, pane] of Object.entries(panes)) onPick(pane, (vertex) => mark(side, vertex));
  }
}

function candidateButton({ name, picture, energy, orientation, nearest }) {
  const button = element("button", undefined, "candidate");
  button.type = "button";
  const image = element("img");
  image.src = picture;
  image.alt = `${record.x.name} in the colours of ${record.y.name}, through ${name}`;
  button.append(image, element("b", name));
  if (energy !== undefined) {
    button.append(element("span", `energy ${energy.toFixed(2)}`));
    const way = orientation > 0 ? "keeps" : "swaps";
    const sure = orientation !== null && Math.abs(orientation) >= 0.5;
    button.append(element("span", sure ? `${way} left and right` : "left and right unclear"));
  }
  if (nearest) button.append(element("em", "nearest to the map found"));
  return button;
}

// ---------------------------------------------------------------- checker and marks

function makeChecker() {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 128;
  const context = canvas.getContext("2d");
  context.fillStyle = "#ffffff";
  context.fillRect(0, 0, 128, 128);
  context.fillStyle = "#6d6d6d";
  context.fillRect(0, 0, 64, 64);
  context.fillRect(64, 64, 64, 64);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  texture.repeat.set(12, 12);
  texture.anisotropy = 8;
  return texture;
}

// Solid in front, faint through the body where it is behind.
function addMark(pane, vertex, colour) {
  const ball = new THREE.SphereGeometry(0.016, 24, 16);
  for (const through of [true, false]) {
    const material = new THREE.MeshBasicMaterial({
      color: colour,
      depthTest: !through,
      transparent: through,
      opacity: through ? 0.35 : 1,
    });
    const made = new THREE.Mesh(ball, material);
    made.position.fromArray(pane.points, 3 * vertex);
    made.renderOrder = through ? 1 : 2;
    pane.marks.add(made);
  }
}

// A press that does not move is a click on the nearest corner under it.
function onPick(pane, picked) {
  const { canvas, camera, body, points } = pane;
  let down = null;
  canvas.addEventListener("pointerdown", (event) => {
    down = [event.clientX, event.clientY];
  });
  canvas.addEventListener("pointerup", (event) => {
    if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 5) return;
    const box = canvas.getBoundingClientRect();
    const at = new THREE.Vector2(
      (2 * (event.clientX - box.left)) / box.width - 1,
      1 - (2 * (event.clientY - box.top)) / box.height,
    );
    const ray = new THREE.Raycaster();
    ray.params.Points.threshold = 0.01;
    ray.setFromCamera(at, camera);
    const [hit] = ray.intersectObject(body);
    if (!hit) return;
    if (!hit.face) return picked(hit.index);
    const away = (v) => Math.hypot(
      points[3 * v] - hit.point.x,
      points[3 * v + 1] - hit.point.y,
      points[3 * v + 2] - hit.point.z,
    );
    const { a, b, c } = hit.face;
    picked([a, b, c].sort((v, w) => away(v) - away(w))[0]);
  });
}
