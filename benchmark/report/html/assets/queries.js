"use strict";
/* The browser of queries: a shape, its form and its nearest shapes under each method; or where two methods differ. */

(() => {
  const { load, pageData, address, addressOf, make, fill, number } = canonicalForms;
  const { queries: stem } = pageData();
  const NEAREST = 5, AT_ONCE = 20, MOST_NAMES = 400, ACROSS = 10, DOWN = 5;
  const NOT_STORED = "not kept here", KNOWN = ["it makes no forms", NOT_STORED];  // no fault of a shape
  const byId = (id) => document.getElementById(id);
  /* Queries are numbers in the gallery; those of `base` have data, those of `kept` pass the filters. */
  let all = null, gallery = null, base = [], kept = [], query = 0;

  document.addEventListener("DOMContentLoaded", async () => {
    if (!byId("query-gallery")) return;
    all = await load(`${stem}-queries`);
    const on = (id, told) => byId(id).addEventListener("change", told);
    on("query-gallery", () => choose(named(byId("query-gallery").value, gallery.input), gallery.names[query]));
    on("query-input", () => choose(named(gallery.gallery, byId("query-input").value), gallery.names[query]));
    ["query-class", "query-pose"].forEach((id) => on(id, () => { filter(); show(); }));
    ["query-view", "query-first", "query-second", "query-measure"].forEach((id) => on(id, show));
    on("query-name", (event) => find(event.target.value));
    byId("query-name").addEventListener("input", (event) => suggest(event.target.value));
    byId("query-before").addEventListener("click", () => step(-1));
    byId("query-next").addEventListener("click", () => step(1));
    byId("matches").addEventListener("keydown", move);
    addEventListener("hashchange", fromHash);
    document.addEventListener("keydown", (event) => {
      if (event.target.matches("input, select") || event.ctrlKey || event.metaKey || event.altKey) return;
      const by = { p: -1, n: 1 }[event.key.toLowerCase()];
      if (by && byId("query-view").value === "one") step(by);
    });
    fill(byId("query-gallery"), options(all.galleries.map((each) => each.gallery)));
    fill(byId("query-measure"), options(all.measures), all.measures.at(-1));
    fromHash();
  });

  const options = (names, ...first) => [...first, ...[...new Set(names)].map((name) => [name, name])];
  const named = (name, input) => {
    const here = all.galleries.filter((each) => each.gallery === name);
    return here.find((each) => each.input === input) ?? here[0];
  };

  /* Those without distances are shown only where none have them. */
  const methods = () => {
    const ranked = gallery.methods.filter((method) => method.is_ranked);
    return ranked.length ? ranked : gallery.methods;
  };

  /* What is chosen is kept where the gallery has it, too. */
  function refill(id, entries) {
    const before = byId(id).value;
    fill(byId(id), entries, entries.some(([value]) => value === before) ? before : entries[0]?.[0]);
    byId(id).closest("label").hidden = entries.length < 2;
  }

  function fromHash() {
    const [number, wanted, first, second, measure] = address();
    byId("query-view").value = second ? "two" : "one";
    choose(all.galleries[Number(number)] ?? all.galleries[0], wanted, { first, second, measure });
  }

  function choose(chosen, wanted, preset = {}) {
    gallery = chosen;
    base = gallery.queries ?? gallery.names.map((_, k) => k);
    byId("query-gallery").value = gallery.gallery;
    byId("query-gallery").closest("label").hidden = byId("query-gallery").length < 2;
    refill("query-input", options(all.galleries.filter((each) => each.gallery === gallery.gallery).map((each) => each.input)));
    byId("query-input").value = gallery.input;
    refill("query-class", options(gallery.classes, ["", "all"]));
    refill("query-pose", gallery.poses.some(Boolean) ? options(gallery.poses, ["", "all"]) : []);
    const titles = methods().map((method) => [method.name, method.title]);
    refill("query-first", titles);
    refill("query-second", [...titles.slice(1), ...titles.slice(0, 1)]);
    for (const [name, value] of Object.entries(preset)) {
      const field = byId(`query-${name}`);
      if ([...field.options].some((option) => option.value === value)) field.value = value;
    }
    query = base.find((k) => gallery.names[k] === wanted) ?? base[0];
    suggest("");
    filter();
    show();
  }

  function filter() {
    const [of_class, pose] = [byId("query-class").value, byId("query-pose").value];
    kept = base.filter((k) => (!of_class || gallery.classes[k] === of_class) && (!pose || gallery.poses[k] === pose));
    if (kept.length && !kept.includes(query)) query = kept[0];
  }

  function suggest(text) {
    const found = base.map((k) => gallery.names[k]).filter((each) => each.toLowerCase().includes(text.toLowerCase()));
    byId("query-names").replaceChildren(...found.slice(0, MOST_NAMES).map((each) => make("option", { value: each })));
  }

  function find(text) {
    const found = base.find((k) => gallery.names[k] === text) ?? base.find((k) => gallery.names[k].toLowerCase().includes(text.toLowerCase()));
    if (found !== undefined) go(found);
    byId("query-none").textContent = found !== undefined ? "" : `No shape of this gallery is called "${text}".`;
  }

  function step(by) { if (kept.length) go(kept[(kept.indexOf(query) + by + kept.length) % kept.length]); }

  /* To a query, whatever the filters say. */
  function go(to) {
    query = to;
    if (!kept.includes(query)) { byId("query-class").value = ""; byId("query-pose").value = ""; filter(); }
    byId("query-view").value = "one";
    show(true);
  }

  function show(isChosen = false) {
    const isTwo = byId("query-view").value === "two";
    document.querySelectorAll("[data-view]").forEach((each) => { each.hidden = each.dataset.view !== byId("query-view").value; });
    byId("query-none").textContent = kept.length ? "" : "No query has this class and pose.";
    byId("matches").replaceChildren();
    if (!kept.length) byId("query").replaceChildren();
    else if (isTwo) differences();
    else single(isChosen === true);
  }

  const note = (...names) => history.replaceState(null, "", addressOf(String(all.galleries.indexOf(gallery)), ...names));
  const part = (number) => load(`queries-${stem}-${gallery.number}-${number}`);
  const gap = ({ x, y }) => Math.round(1000 * Math.abs(y - x));  // scores have three decimals
  const told = (k) => `class ${gallery.classes[k]}${gallery.poses[k] ? `, pose ${gallery.poses[k]}` : ""}`;

  /* One query under all methods ---------------------------------------------------------------------------------------- */

  async function single(isChosen) {
    const [k, wanted, place] = [query, gallery, base.indexOf(query)];
    const data = await part(Math.floor(place / all.part));
    if (wanted !== gallery || k !== query || byId("query-view").value !== "one") return;
    if (isChosen) note(gallery.names[k]);
    byId("query-name").value = gallery.names[k];
    const few = gallery.queries ? `; ${base.length} of ${gallery.names.length} queries are here, evenly spread` : "";
    byId("query").className = "query";
    byId("query").replaceChildren(thumbnail(k), make("div", {}, make("h2", { text: gallery.names[k] }),
      make("p", { class: "faint", text: `${told(k)}; query ${kept.indexOf(k) + 1} of ${kept.length}${few}` })));
    const within = place % all.part;
    const failed = all.failed.filter((each) => each.input === gallery.input);
    byId("matches").replaceChildren(
      ...methods().map((method) => {
        const scores = data[method.name]?.scores[within];
        const text = scores ? all.measures.map((m, n) => `${m} ${scores[n] === null ? "–" : number(scores[n])}`).join("   ") : "omitted";
        const nearest = data[method.name]?.nearest?.[within];
        const isStored = nearest || missing(method, k) !== NOT_STORED;
        return make("div", { class: "row" }, isStored ? side(method, k, nearest, text) : heading(method.title, text));
      }),
      ...failed.map((each) => make("div", { class: "row" }, make("h3", {}, make("b", { text: each.title })), make("p", { class: "why", text: each.why }))),
    );
    byId("matches").dataset.query = gallery.names[k];
  }

  /* Where two methods differ ------------------------------------------------------------------------------------------- */

  async function differences() {
    const [wanted, chosen] = [gallery, ["first", "second", "measure"].map((name) => byId(`query-${name}`).value)];
    const parts = await Promise.all(Array.from({ length: Math.ceil(base.length / all.part) }, (_, n) => part(n)));
    if (wanted !== gallery || byId("query-view").value !== "two") return;
    const measure = chosen[2];
    const pair = chosen.slice(0, 2).map((name) => gallery.methods.find((each) => each.name === name));
    const found = kept.map((k) => {
      const place = base.indexOf(k);
      const here = pair.map((method) => parts[Math.floor(place / all.part)][method.name]);
      const [x, y] = here.map((each) => each?.scores[place % all.part]?.[all.measures.indexOf(measure)] ?? null);
      return { k, x, y, nearest: here.map((each) => each?.nearest?.[place % all.part]) };
    }).filter(({ x, y }) => x !== null && y !== null && x !== y).sort((a, b) => gap(b) - gap(a));
    note(gallery.names[query], ...chosen);
    const better = found.filter(({ x, y }) => y > x).length;
    byId("query").className = "";
    byId("query").replaceChildren(make("p", { text: `${found.length} of ${kept.length} queries differ in ${measure}, most first: `
      + `${pair[0].title} is better on ${found.length - better}, ${pair[1].title} on ${better}.` }));
    const more = make("button", { type: "button" });
    const add = () => {
      const shown = byId("matches").querySelectorAll(".row").length;
      more.before(...found.slice(shown, shown + AT_ONCE).map((each) => differing(each, pair, measure)));
      const left = found.length - shown - AT_ONCE;
      more.hidden = left <= 0;
      more.textContent = `show ${Math.min(AT_ONCE, left)} more of ${left}`;
    };
    more.addEventListener("click", add);
    byId("matches").replaceChildren(more);
    add();
    byId("matches").dataset.query = chosen.join("|");
  }

  function differing({ k, x, y, nearest }, methods, measure) {
    const open = make("button", { type: "button", class: "name", text: gallery.names[k], title: "under all methods" });
    open.addEventListener("click", () => { go(k); focus(); });
    const head = make("h3", {}, open, make("span", { text: `${told(k)}; ${measure} ${number(x)} → ${number(y)}` }));
    const input = make("figure", { class: "form" }, thumbnail(k, 0, `the shape ${gallery.names[k]}`), make("figcaption", { text: "input" }));
    return make("article", { class: "row" }, head, make("div", { class: "pair" }, input,
      ...methods.map((method, n) => side(method, k, nearest[n], `${measure} ${number([x, y][n])}`))));
  }

  /* Parts of both ------------------------------------------------------------------------------------------------------ */

  /* What a method makes of a shape: its form, or why there is none, its scores, and the nearest shapes. */
  function side(method, k, nearest, text) {
    const why = missing(method, k);
    const picture = why ? make("div", { class: "thumb none", text: KNOWN.includes(why) ? why : "no form" }) : thumbnail(k, method.sheet, `form of ${gallery.names[k]} by ${method.title}`);
    const form = make("figure", { class: "form" }, picture, make("figcaption", { text: method.title }));
    const head = heading(method.title, text);
    const list = make("ol", { class: "matches", "aria-label": `Nearest shapes by ${method.title}` });
    list.append(...(nearest ?? []).slice(0, NEAREST).map((match, n) => make("li", {}, tile(method, match, k, n))));
    const reason = why && !KNOWN.includes(why) ? [make("p", { class: "why", text: why })] : [];
    return make("div", { class: "side" }, form, head, ...reason, ...(nearest ? [list] : []));
  }

  const heading = (title, text) => make("h3", {}, make("b", { text: title }), make("span", { text }));

  /* Why a shape has no picture of its form; "" where it has one. */
  function missing(method, k) {
    method.why ??= new Map(Object.entries(method.missing).flatMap(([why, shapes]) => shapes.map((shape) => [shape, why])));
    return method.why.get(k) ?? "";
  }

  function thumbnail(k, number = 0, label = "") {
    const picture = gallery.pictures[k];
    const box = make("div", label ? { class: "thumb", role: "img", "aria-label": label } : { class: "thumb", "aria-hidden": "true" });
    if (picture < 0) {
      box.className = "thumb none";
      box.textContent = "no picture";
      return box;
    }
    const n = picture % (ACROSS * DOWN);
    box.style.backgroundImage = `url("parts/pictures/${gallery.sheets}-${number}-${Math.floor(picture / (ACROSS * DOWN))}.webp")`;
    box.style.backgroundSize = `${100 * ACROSS}% ${100 * DOWN}%`;
    box.style.backgroundPosition = `${(100 * (n % ACROSS)) / (ACROSS - 1)}% ${(100 * Math.floor(n / ACROSS)) / (DOWN - 1)}%`;
    return box;
  }

  function tile(method, match, k, rank) {
    const hit = gallery.classes[match] === gallery.classes[k];
    const samePose = gallery.poses[match] && gallery.poses[match] === gallery.poses[k];
    const button = make("button", { type: "button", class: `match ${hit ? "hit" : "miss"}`, title: `${gallery.names[match]}: take it as the query` });
    button.tabIndex = rank ? -1 : 0;  // one stop for the row; arrow keys go on
    const pictures = make("span", { class: "pictures" }, ...(missing(method, match) ? [] : [thumbnail(match, method.sheet)]), thumbnail(match));
    button.append(pictures, make("span", { class: "mark", text: hit ? "✓" : "✗" }), make("span", { text: `${rank + 1}. ${gallery.names[match]}` }),
      make("small", { text: hit ? "same class" : samePose ? "same pose" : gallery.classes[match] }));
    if (base.includes(match)) button.addEventListener("click", () => { go(match); focus(); });
    else button.title = `${gallery.names[match]}: its own query is not in this report`;
    return button;
  }

  function focus() {
    byId("query").focus({ preventScroll: true });
    scrollTo({ top: 0 });
  }

  /* Left and right within the nearest shapes, up and down between those of methods. */
  function move(event) {
    const button = event.target.closest(".match");
    const by = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (!button || !by) return;
    const lists = [...byId("matches").querySelectorAll(".matches:has(.match)")];
    const list = button.closest(".matches");
    const column = [...list.children].indexOf(button.parentElement) + by[1];
    const to = lists[lists.indexOf(list) + by[0]]?.children[column]?.firstChild;
    event.preventDefault();
    if (!to) return;
    to.closest(".matches").querySelectorAll(".match").forEach((each) => { each.tabIndex = each === to ? 0 : -1; });
    to.focus();
  }
})();
