"use strict";

// What the pages with shapes share: the record, texts, arrays, and shapes by three.js.

const record = JSON.parse(document.getElementById("record").textContent);
const byId = (id) => document.getElementById(id);

// sRGB in 0..255 to the linear light that three.js computes with.
const LINEAR = Float32Array.from({ length: 256 }, (_, i) => {
  const share = i / 255;
  return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
});

// ---------------------------------------------------------------- texts

function element(tag, text, name) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (name) made.className = name;
  return made;
}

function fillTable(id, rows) {
  for (const cells of rows) {
    const row = element("tr");
    for (const cell of cells) row.append(element("td", String(cell)));
    byId(id).append(row);
  }
}

function press(buttons, pressed) {
  for (const button of buttons) button.setAttribute("aria-pressed", button === pressed);
}

// A button for each way to colour the shapes, { mode: text }; the first is pressed.
function modeButtons(texts, chosen) {
  for (const [mode, text] of Object.entries(texts)) {
    const button = element("button", text);
    button.type = "button";
    button.dataset.mode = mode;
    button.onclick = () => {
      press(byId("modes").children, button);
      chosen(mode);
    };
    byId("modes").append(button);
  }
  press(byId("modes").children, byId("modes").firstChild);
}

// ---------------------------------------------------------------- arrays

function unpacked(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}

function indices(text, count) {
  return unpacked(text, count <= 65536 ? Uint16Array : Uint32Array);
}

// ---------------------------------------------------------------- three.js

function makePane(side, shape) {
  const canvas = byId(`canvas-${side}`);
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(24, 1, 0.1, 50);
  // Lights move with the camera: a key light from the upper left, a fill from the right.
  const lights = [[new THREE.DirectionalLight("white", 2.1), -2, 2.5, 3], [new THREE.DirectionalLight("white", 0.7), 4, 0.5, 2]];
  for (const [light, ...place] of lights) {
    light.position.set(...place);
    camera.add(light, light.target);
  }
  scene.add(camera, new THREE.AmbientLight("white", 1.25));

  const quantised = unpacked(shape.points, Uint16Array);
  const points = Float32Array.from(quantised, (q, i) => shape.low[i % 3] + q / 65535);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * shape.n), 3));
  geometry.setAttribute("uv", new THREE.BufferAttribute(new Float32Array(2 * shape.n), 2));
  const faces = indices(shape.faces, shape.n);
  let material, body;
  if (faces.length) {
    geometry.setIndex(new THREE.BufferAttribute(faces, 1));
    geometry.computeVertexNormals();
    material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
    body = new THREE.Mesh(geometry, material);
  } else {
    material = new THREE.PointsMaterial({ vertexColors: true, size: 0.012 });
    body = new THREE.Points(geometry, material);
  }
  const marks = new THREE.Group();
  scene.add(body, marks);
  const numbers = shape.numbers ? unpacked(shape.numbers, Uint32Array) : null;
  return { side, shape, canvas, renderer, scene, camera, geometry, material, body, points, marks, numbers };
}

// One view for all panes: whichever is turned, the others follow. The distance leaves room
// for shapes so many times as large.
function linkCameras(panes, turn, room = 1) {
  const angle = (-turn * Math.PI) / 180;
  const all = Object.values(panes);
  for (const pane of all) {
    pane.controls = new THREE.OrbitControls(pane.camera, pane.canvas);
    pane.controls.enableDamping = false;
    pane.controls.addEventListener("change", () => follow(pane));
  }
  function follow(moved) {
    for (const pane of all) {
      if (pane !== moved) {
        pane.camera.position.copy(moved.camera.position);
        pane.camera.quaternion.copy(moved.camera.quaternion);
        pane.controls.target.copy(moved.controls.target);
      }
      redraw(pane);
    }
  }
  linkCameras.reset = () => {
    const [pane] = all;
    // Far enough for the taller and the wider shape, in panes of this form.
    let high = 0, wide = 0;
    for (const { geometry } of all) {
      geometry.computeBoundingBox();
      const { min, max } = geometry.boundingBox;
      high = Math.max(high, max.y - min.y);
      const across = Math.cos(angle) * (max.x - min.x) - Math.sin(angle) * (max.z - min.z);
      wide = Math.max(wide, across);
    }
    const form = pane.canvas.clientWidth / pane.canvas.clientHeight;
    const half = Math.tan((pane.camera.fov * Math.PI) / 360);
    const away = (room * 0.53 * Math.max(high, wide / form)) / half + 0.2;
    pane.controls.target.set(0, 0, 0);
    pane.camera.position.set(away * Math.sin(angle), 0.14 * away, away * Math.cos(angle));
    pane.controls.update();
    follow(pane);
  };
  all.forEach(resize);
  linkCameras.reset();
}

function resize(pane) {
  const { clientWidth, clientHeight } = pane.canvas;
  pane.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  pane.renderer.setSize(clientWidth, clientHeight, false);
  pane.camera.aspect = clientWidth / clientHeight;
  pane.camera.updateProjectionMatrix();
  // At once: a canvas of a new size is blank until it is drawn.
  draw(pane);
}

function redraw(pane) {
  pane.waiting ??= requestAnimationFrame(() => draw(pane));
}

function draw(pane) {
  pane.waiting = null;
  pane.renderer.render(pane.scene, pane.camera);
}
