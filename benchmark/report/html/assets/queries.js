"use strict";
/* The browser of queries: a shape, and its nearest shapes under each method. */

(() => {
  const { load, pageData, address, addressOf, make, fill } = canonicalForms;
  const { queries: stem, sheets } = pageData();
  const SIDE = 96, ACROSS = 10, ON_SHEET = 100;
  const MOST_NAMES = 400;
  const byId = (id) => document.getElementById(id);
  let all = null, gallery = null, place = 0;

  document.addEventListener("DOMContentLoaded", async () => {
    if (!byId("query-gallery")) return;
    all = await load(`${stem}-queries`);
    fill(byId("query-gallery"), all.galleries.map((each, k) => [String(k), `${each.gallery}, ${each.input}`]));
    byId("query-gallery").addEventListener("change", () => choose(Number(byId("query-gallery").value), name()));
    byId("query-name").addEventListener("change", (event) => find(event.target.value));
    byId("query-name").addEventListener("input", (event) => suggest(event.target.value));
    byId("query-before").addEventListener("click", () => step(-1));
    byId("query-next").addEventListener("click", () => step(1));
    addEventListener("hashchange", fromHash);
    document.addEventListener("keydown", (event) => {
      if (event.target.matches("input, select") || event.ctrlKey || event.metaKey || event.altKey) return;
      const by = { p: -1, n: 1 }[event.key.toLowerCase()];
      if (by) step(by);
    });
    fromHash();
  });

  const queries = () => gallery.queries ?? gallery.names.map((_, k) => k);
  const name = () => (gallery ? gallery.names[queries()[place]] : undefined);

  function fromHash() {
    const [number, wanted] = address();
    const k = Number(number);
    choose(all.galleries[k] ? k : 0, wanted);
  }

  function choose(number, wanted) {
    gallery = all.galleries[number];
    byId("query-gallery").value = String(number);
    place = Math.max(0, queries().findIndex((k) => gallery.names[k] === wanted));
    suggest("");
    show();
  }

  function suggest(text) {
    const found = queries().map((k) => gallery.names[k]).filter((each) => each.toLowerCase().includes(text.toLowerCase()));
    byId("query-names").replaceChildren(...found.slice(0, MOST_NAMES).map((each) => make("option", { value: each })));
  }

  function find(text) {
    const names = queries().map((k) => gallery.names[k]);
    const exact = names.indexOf(text);
    const near = names.findIndex((each) => each.toLowerCase().includes(text.toLowerCase()));
    const isFound = exact >= 0 || near >= 0;
    if (isFound) go(exact >= 0 ? exact : near);
    byId("query-none").textContent = isFound ? "" : `No shape of this gallery is called "${text}".`;
  }

  function step(by) { go((place + by + queries().length) % queries().length); }

  function go(to) {
    place = to;
    history.replaceState(null, "", addressOf(String(all.galleries.indexOf(gallery)), name()));
    show();
  }

  function thumbnail(k) {
    const picture = gallery.pictures[k];
    const box = make("div", { class: "thumb", "aria-hidden": "true" });
    if (picture >= 0) {
      const n = picture % ON_SHEET;
      box.style.backgroundImage = `url("parts/pictures/${sheets}-${Math.floor(picture / ON_SHEET)}.webp")`;
      box.style.backgroundPosition = `${-SIDE * (n % ACROSS)}px ${-SIDE * Math.floor(n / ACROSS)}px`;
    } else {
      box.className = "thumb none";
      box.textContent = "no picture";
    }
    return box;
  }

  async function show() {
    const k = queries()[place];
    const wanted = gallery;
    const data = await load(`queries-${stem}-${gallery.number}-${Math.floor(place / all.part)}`);
    if (wanted !== gallery || k !== queries()[place]) return;
    byId("query-name").value = gallery.names[k];
    const pose = gallery.poses[k] ? `, pose ${gallery.poses[k]}` : "";
    const few = gallery.queries ? `; ${queries().length} of ${gallery.names.length} queries are here, evenly spread` : "";
    byId("query").className = "query";
    byId("query").replaceChildren(thumbnail(k), make("div", {}, make("h2", { text: gallery.names[k] }),
      make("p", { class: "faint", text: `subject ${gallery.subjects[k]}${pose}; query ${place + 1} of ${queries().length}${few}` })));
    const within = place % all.part;
    byId("matches").replaceChildren(...gallery.methods.map((method) => row(method, data[method.name], within, k)));
    byId("matches").dataset.query = gallery.names[k];
  }

  function row(method, found, within, query) {
    const scores = found?.scores[within];
    const told = scores ? all.measures.map((m, n) => `${m} ${scores[n] === null ? "–" : scores[n].toFixed(2)}`).join("   ") : "left out";
    const head = make("h3", {}, make("b", { text: method.title }), make("span", { text: told }));
    const nearest = found?.nearest?.[within];
    if (!nearest) return make("div", { class: "row" }, head);
    const list = make("ol", { class: "matches", tabindex: "0", "aria-label": `Nearest shapes by ${method.title}` });
    nearest.forEach((match, n) => list.append(make("li", {}, tile(match, query, n))));
    return make("div", { class: "row" }, head, list);
  }

  function tile(match, query, rank) {
    const hit = gallery.subjects[match] === gallery.subjects[query];
    const samePose = gallery.poses[match] && gallery.poses[match] === gallery.poses[query];
    const button = make("button", { type: "button", class: `match ${hit ? "hit" : "miss"}`, title: `${gallery.names[match]}: take it as the query` });
    button.append(thumbnail(match), make("span", { class: "mark", text: hit ? "✓" : "✗" }),
      make("span", { text: `${rank + 1}. ${gallery.names[match]}` }), make("small", { text: hit ? "same subject" : samePose ? "same pose" : gallery.subjects[match] }));
    button.addEventListener("click", () => { const to = queries().indexOf(match); if (to >= 0) { go(to); scrollTo({ top: 0 }); } });
    return button;
  }
})();
