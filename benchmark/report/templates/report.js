function make(tag, properties, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}
// A click on a heading sorts by its column, the next one turns the order round, the third one restores the blocks.
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0], original = [...body.rows];
  const first = table.dataset.first, second = first === "ascending" ? "descending" : "ascending";
  table.tHead.addEventListener("click", event => {
    const button = event.target.closest("button");
    if (!button) return;
    const head = button.closest("th"), now = head.getAttribute("aria-sort");
    const order = now === null ? first : now === first ? second : null;
    for (const other of table.tHead.querySelectorAll("th")) other.removeAttribute("aria-sort");
    body.replaceChildren(...original);
    if (order === null) return;
    head.setAttribute("aria-sort", order);
    const sign = order === "ascending" ? 1 : -1, rows = original.filter(row => !row.classList.contains("block"));
    const cell = row => row.cells[button.dataset.column];
    const number = row => parseFloat(cell(row).dataset.value ?? cell(row).textContent.split(" ").pop());
    const place = row => isNaN(number(row)) ? Number.MAX_VALUE : sign * number(row); // rows without a score are last
    body.replaceChildren(...rows.sort((a, b) => place(a) - place(b)));
  });
}
document.getElementById(location.hash.slice(1))?.closest("thead th")?.querySelector("button").click(); // worst queries first
// Forms in 3D, a file each, at most eight at a time: browsers draw sixteen.
const meshes = {}, turned = [];
function show(name, mesh) { meshes[name] = mesh; }
function scene({ points: [x, y, z], faces: [i, j, k], values }) {
  const sizes = [x, z, y].map(of => Math.max(...of) - Math.min(...of)), diagonal = Math.hypot(...sizes);
  // The diagonal fits, however the surface is turned; no side is 0.
  const [width, depth, height] = sizes.map(size => Math.max(2.6 * size / diagonal, 1e-3)), axis = { visible: false };
  const palette = {{ palette|tojson }}, [right, up, near] = {{ viewing|tojson }}.map(part => -1.9 * part);
  const colours = palette.map((colour, place) => [place / (palette.length - 1), colour]);
  const trace = { type: "mesh3d", x, y: z.map(value => -value), z: y, i, j, k, intensity: values,
    colorscale: colours, showscale: false, hoverinfo: "skip" };
  const camera = { eye: { x: right, y: -near, z: up }, projection: { type: "orthographic" } };
  const shown = { xaxis: axis, yaxis: axis, zaxis: axis, aspectratio: { x: width, y: depth, z: height }, camera };
  return [[trace], { scene: shown, paper_bgcolor: "rgba(0,0,0,0)", margin: { l: 0, r: 0, t: 0, b: 0 } }];
}
function load(address) {
  return new Promise(done => document.head.append(make("script", { src: address, onload: done })));
}
async function turn(button) {
  await (turned.library ??= load("plotly.min.js"));
  const file = button.dataset.mesh, name = button.firstChild.alt;
  if (!meshes[file]) await load(file);
  const box = make("div", { className: "turned" }), image = { filename: name, scale: 4, format: "png" };
  button.replaceWith(box);
  await Plotly.newPlot(box, ...scene(meshes[file]), { displaylogo: false, responsive: true, toImageButtonOptions: image, modeBarButtons: [["toImage", "resetCameraDefault3d"]] });
  box.on("plotly_relayout", async ({ "scene.camera": camera }) => { // all forms turn alike
    if (!camera || turned.isBusy) return;
    turned.isBusy = true;
    await Promise.all(turned.map(([other]) => other === box || Plotly.relayout(other, { "scene.camera": camera })));
    turned.isBusy = false;
  });
  turned.push([box, button]);
  if (turned.length > 8) {
    const [oldest, picture] = turned.shift();
    Plotly.purge(oldest);
    oldest.replaceWith(picture);
  }
}
for (const button of document.querySelectorAll("button.form")) button.addEventListener("click", async () => {
  for (const each of [...button.closest("tr").querySelectorAll("button.form")]) await turn(each);
});

// The nearest matches of a query, a line a method.
function picture([name, label, shape], form, kind, sign, ...below) {
  const image = form || shape ? [make("img", { src: form || shape, alt: name, width: 96, height: 96 })] : [];
  const words = [sign + name.split("/").pop(), ...below].map(text => make("div", {}, text));
  return make("figure", { className: kind, title: `${name}, class ${label}` }, ...image, make("figcaption", {}, ...words));
}
function matches({ sides, rows }, query) {
  const asked = sides[0][query], ranked = sides[sides.length - 1];
  const lines = rows.map(([title, nearest, forms]) => make("div", { className: "line" }, make("b", {}, title),
    ...(nearest[query] ? [picture(asked, forms[query], "query", "", "query")] : ["refused"]),
    ...(nearest[query] ?? []).map(([number, rank, ratio]) => {
      const shape = ranked[number], isHit = shape[1] === asked[1];
      return picture(shape, sides.length === 1 && forms[number], (isHit ? "hit" : "miss") + (rank > 5 ? " later" : ""), isHit ? "✓ " : "✗ ",
        `rank ${rank}`, ...(ratio === null ? [] : [`${ratio.toFixed(3)} × as far`]));
    })));
  return [picture(asked, "", "query", ""), make("div", {}, ...lines)];
}
for (const box of document.querySelectorAll(".queries")) {
  const data = JSON.parse(box.querySelector("script").textContent), body = box.querySelector("tbody");
  body.addEventListener("click", event => {
    const button = event.target.closest("button");
    if (!button) return;
    const row = button.closest("tr"), isOpen = row.nextElementSibling?.className === "matches";
    for (const other of body.querySelectorAll(".matches")) other.remove();
    if (isOpen) return;
    const content = make("div", {}, ...matches(data, Number(button.dataset.query)));
    row.after(make("tr", { className: "matches" }, make("td", { colSpan: row.cells.length }, content)));
    if (event.isTrusted) history.replaceState(null, "", "#" + row.id); // the address shows this query
  });
  const asked = document.getElementById(location.hash.slice(1));
  if (body.contains(asked)) asked.classList.remove("fine"), asked.scrollIntoView(); // it was hidden when the page was laid out
  const start = (body.contains(asked) ? asked : body).querySelector(body.contains(asked) ? "button" : "tr:not(.fine) button");
  if (start) start.click();
}
