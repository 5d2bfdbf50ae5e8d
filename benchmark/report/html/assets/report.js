"use strict";
/* What all pages share: scripts with data, light and dark, tables that are sorted and filtered. */

const canonicalForms = (() => {
  const waiting = new Map();
  const received = new Map();
  const onTheme = [];

  /* A page opened from a folder may load scripts, but not fetch files: each script calls receive(name, value). */
  function load(name) {
    if (!received.has(name)) {
      received.set(name, new Promise((done, failed) => {
        waiting.set(name, done);
        addScript(`parts/data/${name}.js`).catch(failed);
      }));
    }
    return received.get(name);
  }

  function receive(name, value) {
    const done = waiting.get(name);
    if (done) { waiting.delete(name); done(value); }
  }

  function addScript(address) {
    return new Promise((done, failed) => {
      const script = document.createElement("script");
      script.src = address;
      script.onload = done;
      script.onerror = () => failed(new Error(`${address} cannot be loaded`));
      document.head.append(script);
    });
  }

  let library = null;
  function plotly() {
    library ??= addScript("parts/assets/plotly.js").then(() => window.Plotly);
    return library;
  }

  function pageData() {
    const place = document.getElementById("page-data");
    return place ? JSON.parse(place.textContent) : {};
  }

  /* What stands behind # in the address: names with slashes between them. */
  function address() {
    try {
      return location.hash.slice(1).split("/").map(decodeURIComponent);
    } catch {
      return [];  // not one of ours
    }
  }

  const addressOf = (...names) => `#${names.map(encodeURIComponent).join("/")}`;

  /* An element with text; names are never read as HTML. */
  function make(tag, options = {}, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(options)) {
      if (name === "class") element.className = value;
      else if (name === "text") element.textContent = value;
      else element.setAttribute(name, value);
    }
    element.append(...children);
    return element;
  }

  function fill(select, entries, chosen) {
    select.replaceChildren(...entries.map(([value, title]) => {
      const option = make("option", { value, text: title });
      option.selected = value === chosen;
      return option;
    }));
  }

  /* Plotly reads a few marks of HTML in its texts. */
  function plain(text) {
    return String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
  }

  function colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }

  /* Base64 to an array of whole numbers, which were written little-endian. */
  function unpack(text, wide) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    if (!wide) return bytes;
    const view = new DataView(bytes.buffer);
    return Uint16Array.from({ length: bytes.length / 2 }, (_, k) => view.getUint16(2 * k, true));
  }

  /* Light and dark ------------------------------------------------------------------------------------------------ */

  function remembered() {
    try { return localStorage.getItem("theme"); } catch { return null; }
  }

  function setTheme(theme) {
    document.documentElement.dataset.theme = theme;
    try { localStorage.setItem("theme", theme); } catch { /* not allowed here: it holds for this page */ }
    onTheme.forEach((told) => told());
  }

  if (remembered()) document.documentElement.dataset.theme = remembered();

  function isDark() {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  }

  /* Tables ---------------------------------------------------------------------------------------------------------- */

  function sortable(table) {
    const heads = [...table.tHead.rows].at(-1).cells;
    [...heads].forEach((head, column) => {
      head.querySelector("button")?.addEventListener("click", () => sort(table, heads, column));
    });
    [...table.tBodies[0].rows].forEach((row, number) => { row.dataset.place = number; });
  }

  function sort(table, heads, column) {
    const head = heads[column];
    const isText = head.classList.contains("text");
    const first = isText ? "ascending" : "descending";
    const second = isText ? "descending" : "ascending";
    const order = { [first]: second, [second]: "none" }[head.getAttribute("aria-sort")] ?? first;
    [...heads].forEach((each) => each.removeAttribute("aria-sort"));
    if (order !== "none") head.setAttribute("aria-sort", order);
    const sign = order === "ascending" ? 1 : -1;
    const body = table.tBodies[0];
    const rows = [...body.rows];
    const value = (row) => (isText ? row.cells[column].textContent : Number.parseFloat(row.cells[column].textContent));
    rows.sort((a, b) => {
      const place = a.dataset.place - b.dataset.place;
      if (order === "none") return place;
      const [x, y] = [value(a), value(b)];
      if (isText) return sign * x.localeCompare(y, "en", { numeric: true }) || place;
      if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y) || place;  // blanks are last
      return sign * (x - y) || place;
    });
    body.append(...rows);
  }

  function filtered(section) {
    const box = section.querySelector(".filter");
    const families = [...section.querySelectorAll("input[data-family]")];
    const rows = [...section.querySelectorAll("[data-filtered] tbody tr")];
    const nothing = make("p", { class: "nothing", role: "status" });
    section.querySelector("[data-filtered]").after(nothing);
    const show = () => {
      const words = box.value.toLowerCase().split(/\s+/).filter(Boolean);
      const shown = new Set(families.filter((each) => each.checked).map((each) => each.dataset.family));
      for (const row of rows) {
        const name = row.cells[0].textContent.toLowerCase() + " " + (row.cells[0].dataset.name ?? "").toLowerCase();
        row.hidden = !shown.has(row.dataset.family) || !words.every((word) => name.includes(word));
      }
      const isEmpty = rows.every((row) => row.hidden);
      nothing.textContent = !isEmpty ? "" : words.length ? `No row that is shown is called "${box.value}".` : "All rows are unticked.";
    };
    [box, ...families].forEach((each) => each.addEventListener("input", show));
  }

  document.addEventListener("DOMContentLoaded", () => {
    document.getElementById("theme").addEventListener("click", () => setTheme(isDark() ? "light" : "dark"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => onTheme.forEach((told) => told()));
    document.querySelectorAll("table.sortable").forEach(sortable);
    document.querySelectorAll("section:has(.filter)").forEach(filtered);
    document.querySelector("header nav a[aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" });
  });

  /* A figure in print, as benchmark/report/escaping.py writes it: rounded to 1e-6, then half up. */
  const number = (value, decimals = 2) => (Math.floor(Math.round(value * 1e6) / 10 ** (6 - decimals) + 0.5) / 10 ** decimals).toFixed(decimals);

  return { load, receive, plotly, pageData, address, addressOf, make, fill, number, plain, colour, unpack, onTheme, isDark };
})();
