"use strict";
/* The gallery of canonical forms, and the viewer that turns them. */

(() => {
  const { load, plotly, pageData, make, fill, plain, colour, unpack, onTheme } = canonicalForms;
  const REACH = 1.6;
  const NEAR = 1.9;  // of an orthographic camera the scale is that of the scene
  const SCALE = [[0, "#4a62b0"], [0.2, "#3a82be"], [0.4, "#4aaca8"], [0.6, "#96d088"], [0.8, "#f4d264"], [1, "#f69e5c"]];
  const gallery = pageData().gallery;
  const byId = (id) => document.getElementById(id);
  let shown = { input: "", shape: "", method: "" };
  let eye = { x: 0, y: -1.7, z: 0.05 };
  let zoom = 1;

  if (!gallery) return;

  document.addEventListener("DOMContentLoaded", () => {
    fill(byId("forms-input"), Object.keys(gallery.inputs).map((name) => [name, name]));
    fill(byId("forms-subject"), gallery.subjects.map((each, k) => [String(k), each.name]));
    byId("forms-input").addEventListener("change", grid);
    byId("forms-subject").addEventListener("change", grid);
    byId("viewer-close").addEventListener("click", () => byId("viewer").close());
    byId("viewer-shape").addEventListener("change", (event) => view({ shape: event.target.value }));
    byId("viewer-method").addEventListener("change", (event) => view({ method: event.target.value }));
    document.querySelectorAll("[data-turn]").forEach((button) => button.addEventListener("click", () => turn(button.dataset.turn)));
    byId("viewer").addEventListener("keydown", key);
    onTheme.push(() => { if (byId("viewer").open) view({}); });
    grid();
    const [input, shape, method] = decodeURIComponent(location.hash.slice(1)).split("|");
    if (gallery.inputs[input]?.cells[shape]) open(input, shape, method ?? "");
  });

  /* One figure for each method, one picture for each pose. */
  function grid() {
    const input = byId("forms-input").value;
    const subject = gallery.subjects[byId("forms-subject").value];
    const { methods, cells } = gallery.inputs[input];
    const figures = ["", ...methods].map((method, row) => {
      const title = row ? method.title : "The shape itself";
      const states = subject.shapes.map((shape) => (row ? cells[shape][row - 1] : ""));
      if (row && states.every((state) => state === "it makes no forms")) return null;
      const tiles = subject.shapes.map((shape, k) => tile(input, shape, row, row ? method.name : "", title, states[k], methods.length));
      return make("figure", row ? {} : { class: "input" }, make("figcaption", { text: title }), make("div", { class: "poses" }, ...tiles));
    });
    byId("forms").replaceChildren(...figures.filter(Boolean));
    byId("forms").dataset.shown = `${input}|${subject.name}`;
  }

  function tile(input, shape, row, method, title, state, count) {
    if (state) return make("span", { class: "none", text: state });
    const button = make("button", { type: "button", class: "tile", title: `${title}, ${shape}: turn it` });
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
      domain, xaxis: axis, yaxis: axis, zaxis: axis, aspectmode: "manual", aspectratio: { x: NEAR, y: NEAR, z: NEAR }, dragmode: "turntable",
      camera: { eye: scaled(), up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 }, projection: { type: "orthographic" } },
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
    const at = (k, offset) => ((steps[3 * k + offset] / 65535) * 2 - 1) * REACH;
    const count = steps.length / 3;
    const each = (length, value) => Array.from({ length }, (_, k) => value(k));
    return {
      type: "mesh3d", scene: number ? "scene2" : "scene", hoverinfo: "skip", showscale: false, facenormalsepsilon: 1e-15, vertexnormalsepsilon: 1e-15, colorscale: SCALE, cmin: 0, cmax: 255,
      x: each(count, (k) => at(k, 0)), y: each(count, (k) => -at(k, 2)), z: each(count, (k) => at(k, 1)), intensity: Array.from(values),
      i: each(faces.length / 3, (k) => faces[3 * k]), j: each(faces.length / 3, (k) => faces[3 * k + 1]), k: each(faces.length / 3, (k) => faces[3 * k + 2]),
      lighting: { ambient: 0.62, diffuse: 0.75, specular: 0.08, roughness: 0.8, fresnel: 0 }, lightposition: { x: 1e5, y: -1e5, z: -1.2e5 }  /* away from the lamp, in coordinates of the camera */,
    };
  }

  const scaled = () => ({ x: eye.x / zoom, y: eye.y / zoom, z: eye.z / zoom });

  /* Both surfaces are turned together. */
  function follow(scene, Plotly) {
    if (scene.dataset.follows) return;
    scene.dataset.follows = "yes";
    let busy = false;
    scene.on("plotly_relayout", (change) => {
      const camera = change["scene.camera"] ?? change["scene2.camera"];
      if (!camera || busy) return;
      eye = camera.eye;
      zoom = 1;
      busy = true;
      const other = change["scene.camera"] ? "scene2.camera" : "scene.camera";
      const ratio = (change["scene.camera"] ? change["scene.aspectratio"] : change["scene2.aspectratio"]);
      const more = ratio ? { [other.replace("camera", "aspectratio")]: ratio } : {};
      Plotly.relayout(scene, { [other]: camera, ...more }).finally(() => { busy = false; });
    });
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
    const layout = byId("scene").layout;
    const near = how === "in" ? 1.2 : how === "out" ? 1 / 1.2 : 1;
    const change = {};
    for (const name of ["scene", "scene2"]) {
      change[`${name}.camera`] = { ...layout[name].camera, eye };
      const now = layout[name].aspectratio ?? { x: NEAR, y: NEAR, z: NEAR };
      if (near !== 1) {
        change[`${name}.aspectmode`] = "manual";
        change[`${name}.aspectratio`] = { x: now.x * near, y: now.y * near, z: now.z * near };
      }
    }
    await Plotly.relayout(byId("scene"), change);
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
