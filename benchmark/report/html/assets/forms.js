"use strict";
/* The gallery of canonical forms, and the viewer that turns them. */

(() => {
  const { load, plotly, pageData, address, make, fill, plain, colour, unpack, onTheme } = canonicalForms;
  const REACH = 1.6;
  const NEAR = 2.2;  // of an orthographic camera the scale is that of the scene
  const COLOURS = [[74, 98, 176], [58, 130, 190], [74, 172, 168], [150, 208, 136], [244, 210, 100], [246, 158, 92]];
  const LAMP = [-0.4, 0.6, 0.7];
  const HIDDEN = ["it makes no forms", "not kept here", "not in this gallery"];  // of all shapes of a class: no row
  const gallery = pageData().gallery;
  const byId = (id) => document.getElementById(id);
  let shown = { input: "", shape: "", method: "" };
  let eye = { x: 0, y: -1.7, z: 0.05 };
  let near = NEAR;

  if (!gallery) return;

  document.addEventListener("DOMContentLoaded", () => {
    fill(byId("forms-input"), Object.keys(gallery.inputs).map((name) => [name, name]));
    fill(byId("forms-class"), gallery.classes.map((each, k) => [String(k), each.name]));
    byId("forms-input").addEventListener("change", grid);
    byId("forms-class").addEventListener("change", grid);
    byId("viewer-close").addEventListener("click", () => byId("viewer").close());
    byId("viewer-shape").addEventListener("change", (event) => view({ shape: event.target.value }));
    byId("viewer-method").addEventListener("change", (event) => view({ method: event.target.value }));
    document.querySelectorAll("[data-turn]").forEach((button) => button.addEventListener("click", () => turn(button.dataset.turn)));
    byId("viewer").addEventListener("keydown", key);
    onTheme.push(() => { if (byId("viewer").open) view({}); });
    grid();
    const [input, shape, method] = address();
    if (gallery.inputs[input]?.cells[shape]) open(input, shape, method ?? "");
  });

  /* One figure for each method, one picture for each pose. */
  function grid() {
    const input = byId("forms-input").value;
    const shown = gallery.classes[byId("forms-class").value];
    const { methods, cells } = gallery.inputs[input];
    const figures = ["", ...methods].map((method, row) => {
      const title = row ? method.title : "The shape itself";
      const states = shown.shapes.map((shape) => (row ? cells[shape][row - 1] : ""));
      if (row && states.every((state) => HIDDEN.includes(state))) return null;
      const tiles = shown.shapes.map((shape, k) => tile(input, shape, row, row ? method.name : "", title, states[k], methods.length));
      return make("figure", row ? {} : { class: "input" }, make("figcaption", { text: title }), make("div", { class: "poses" }, ...tiles));
    });
    byId("forms").replaceChildren(...figures.filter(Boolean));
    byId("forms").dataset.shown = `${input}|${shown.name}`;
  }

  function tile(input, shape, row, method, title, state, count) {
    if (state) return make("span", { class: "none", text: state });
    const button = make("button", { type: "button", class: "tile", title: `${title}, ${shape}: rotate it` });
    button.setAttribute("aria-label", `${title}, ${shape}`);
    button.style.backgroundImage = `url("parts/pictures/forms-${gallery.stem}-${input}-${gallery.files[shape]}.webp")`;
    button.style.backgroundSize = `100% ${100 * (count + 1)}%`;
    button.style.backgroundPosition = `0 ${count ? (100 * row) / count : 0}%`;
    button.addEventListener("click", () => open(input, shape, method));
    return button;
  }

  function open(input, shape, method) {
    const { methods, cells } = gallery.inputs[input];
    const first = methods.findIndex((each, k) => !cells[shape][k]);
    shown = { input, shape, method: method || methods[first]?.name || "" };
    fill(byId("viewer-shape"), Object.keys(cells).map((name) => [name, name]), shape);
    if (!byId("viewer").open) byId("viewer").showModal();
    view({});
  }

  async function view(change) {
    shown = { ...shown, ...change };
    const { input, shape } = shown;
    const { methods, cells } = gallery.inputs[input];
    const here = methods.filter((_, k) => !cells[shape][k]);
    if (!here.some((each) => each.name === shown.method)) shown.method = here[0]?.name ?? "";
    fill(byId("viewer-method"), here.map((each) => [each.name, each.title]), shown.method);
    const wanted = shown;
    const data = await load(`forms-${gallery.stem}-${input}-${gallery.files[shape]}`);
    const Plotly = await plotly();
    if (wanted !== shown) return;
    const title = here.find((each) => each.name === shown.method)?.title ?? "no form";
    byId("viewer-title").textContent = `${shape} · ${title}`;
    const narrow = byId("scene").clientWidth < 620;
    const traces = ["", shown.method].map((name, k) => surface(data, name, k)).filter(Boolean);
    const axis = { visible: false, range: [-REACH, REACH], autorange: false };
    const scene = (domain) => ({
      domain, xaxis: axis, yaxis: axis, zaxis: axis, aspectmode: "manual", aspectratio: { x: near, y: near, z: near }, dragmode: "turntable",
      camera: { eye, up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 }, projection: { type: "orthographic" } },
    });
    const note = (text, x, y) => ({ text, xref: "paper", yref: "paper", x, y, showarrow: false, font: { color: colour("faint"), size: 13 } });
    await Plotly.react(byId("scene"), traces, {
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false,
      scene: scene(narrow ? { x: [0, 1], y: [0.5, 1] } : { x: [0, 0.5], y: [0, 1] }),
      scene2: scene(narrow ? { x: [0, 1], y: [0, 0.5] } : { x: [0.5, 1], y: [0, 1] }),
      annotations: narrow ? [note("shape", 0.02, 0.99), note(plain(title), 0.02, 0.48)] : [note("shape", 0.25, 0.99), note(plain(title), 0.77, 0.99)],
    }, { responsive: true, displayModeBar: false });
    follow(byId("scene"), Plotly);
    byId("scene").dataset.drawn = `${input}|${shape}|${shown.method}`;
  }

  /* Coordinates are right, up, towards the viewer; Plotly's upward axis is its third. */
  function surface(data, name, number) {
    const own = data.surfaces[name];
    if (!own) return null;
    const steps = unpack(own.at, true);
    const faces = unpack(own.faces ?? data.faces, true);
    const values = unpack(own.values ?? data.values, false);
    const points = Float64Array.from(steps, (step) => ((step / 65535) * 2 - 1) * REACH);
    const every = (array, offset, sign = 1) => Array.from({ length: array.length / 3 }, (_, k) => sign * array[3 * k + offset]);
    return {
      type: "mesh3d", scene: number ? "scene2" : "scene", hoverinfo: "skip",
      x: every(points, 0), y: every(points, 2, -1), z: every(points, 1), i: every(faces, 0), j: every(faces, 1), k: every(faces, 2),
      vertexcolor: shaded(points, faces, values), lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 },
    };
  }

  /* The lamp is painted on, above to the left of the first view; light from all sides keeps the back from being black. */
  function shaded(points, faces, values) {
    const normals = new Float64Array(points.length);
    for (let f = 0; f < faces.length; f += 3) {
      const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
      const u = [0, 1, 2].map((n) => points[b + n] - points[a + n]);
      const v = [0, 1, 2].map((n) => points[c + n] - points[a + n]);
      const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      for (const corner of [a, b, c]) normal.forEach((part, n) => { normals[corner + n] += part; });
    }
    const side = outside(points, normals);
    return Array.from(values, (value, k) => {
      const [x, y, z] = [normals[3 * k], normals[3 * k + 1], normals[3 * k + 2]];
      const length = Math.hypot(x, y, z) || 1;
      const light = (side * (LAMP[0] * x + LAMP[1] * y + LAMP[2] * z)) / length;
      const bright = 0.52 + 0.6 * Math.max(0, 0.25 + 0.75 * light);
      return `rgb(${tint(value / 255).map((part) => Math.min(255, Math.round(part * bright))).join()})`;
    });
  }

  /* 1 if the triangles are seen from outside; forms may be mirror images of their shapes. */
  function outside(points, normals) {
    let sum = 0;
    for (let k = 0; k < points.length; k += 1) sum += points[k] * normals[k];
    return sum < 0 ? -1 : 1;
  }

  function tint(value) {
    const k = Math.min(COLOURS.length - 2, Math.floor(value * (COLOURS.length - 1)));
    const share = value * (COLOURS.length - 1) - k;
    return COLOURS[k].map((part, n) => part + share * (COLOURS[k + 1][n] - part));
  }

  /* Both surfaces are turned together. */
  function follow(scene, Plotly) {
    if (scene.dataset.follows) return;
    scene.dataset.follows = "yes";
    let busy = false;
    scene.on("plotly_relayout", (change) => {
      const turned = ["scene", "scene2"].find((name) => change[`${name}.camera`]);
      if (!turned || busy) return;
      eye = change[`${turned}.camera`].eye;
      near = change[`${turned}.aspectratio`]?.x ?? near;
      busy = true;
      Plotly.relayout(scene, cameras(scene)).finally(() => { busy = false; });
    });
  }

  /* What brings both cameras to where we look from, and how near. */
  function cameras(scene) {
    const change = {};
    for (const name of ["scene", "scene2"]) {
      change[`${name}.camera`] = { ...scene.layout[name].camera, eye };
      change[`${name}.aspectratio`] = { x: near, y: near, z: near };
    }
    return change;
  }

  async function turn(how) {
    const Plotly = await plotly();
    const [c, s] = [Math.cos(Math.PI / 12), Math.sin(Math.PI / 12)];
    const length = Math.hypot(eye.x, eye.y, eye.z);
    if (how === "left") eye = { ...eye, x: c * eye.x - s * eye.y, y: s * eye.x + c * eye.y };
    if (how === "right") eye = { ...eye, x: c * eye.x + s * eye.y, y: -s * eye.x + c * eye.y };
    if (how === "up" || how === "down") {
      const flat = Math.hypot(eye.x, eye.y);
      const angle = Math.max(-1.5, Math.min(1.5, Math.atan2(eye.z, flat) + (how === "up" ? 0.2 : -0.2)));
      const k = (length * Math.cos(angle)) / (flat || 1);
      eye = { x: eye.x * k, y: eye.y * k, z: length * Math.sin(angle) };
    }
    near *= { in: 1.2, out: 1 / 1.2 }[how] ?? 1;
    await Plotly.relayout(byId("scene"), cameras(byId("scene")));
  }

  function key(event) {
    if (event.target.matches("select, input")) return;
    const turns = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "in", "=": "in", "-": "out" };
    if (turns[event.key]) { event.preventDefault(); turn(turns[event.key]); return; }
    const step = { n: 1, p: -1 }[event.key.toLowerCase()];
    if (!step) return;
    const names = [...byId("viewer-method").options].map((option) => option.value);
    if (names.length) view({ method: names[(names.indexOf(shown.method) + step + names.length) % names.length] });
  }
})();
