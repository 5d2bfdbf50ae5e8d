"use strict";
/* The charts of a table; each is drawn when it comes into view. */

(() => {
  const { load, plotly, pageData, fill, number, plain, colour, make, onTheme } = canonicalForms;
  const COLOURS = ["#2f6fb7", "#d9822b", "#2a9d8f", "#c0504d", "#8064a2", "#7a8b2a", "#d16ba5", "#5f7d95", "#a6761d", "#17a2c6"];
  const FAMILIES = { paper: "#2f6fb7", extended: "#2a9d8f", control: "#c98a3a" };
  const MARKS = ["circle", "square", "diamond", "triangle-up", "cross", "star", "hexagon", "x"];
  const SCALE = [[0, "#12306b"], [0.25, "#2a6fa8"], [0.5, "#49a79a"], [0.75, "#b9cf72"], [1, "#fbe26b"]];

  const EMPTY = {
    cost: "No row has both scores and a cost under this input.",
    precision: "This chart needs distances, and none are stored here.",
    classes: "There are no scores, or too many classes to show.",
    attraction: "This chart needs distances, and a data set whose classes have the same poses.",
    confusion: "This chart needs distances, and not too many classes.",
  };

  document.addEventListener("DOMContentLoaded", async () => {
    const data = await load(pageData().table);
    const seen = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        if (entry.isIntersecting) { seen.unobserve(entry.target); begin(entry.target, data); }
      }
    }, { rootMargin: "300px" });
    document.querySelectorAll(".chart").forEach((chart) => seen.observe(chart));
  });

  function begin(chart, data) {
    const draw = { cost, precision, classes, attraction, confusion }[chart.dataset.chart];
    const selects = Object.fromEntries([...chart.querySelectorAll("select")].map((s) => [s.dataset.choice, s]));
    const inputs = data.inputs.filter((input) => data.rows.some((row) => row.inputs[input]));
    fill(selects.input, inputs.map((name) => [name, name]), inputs[0]);
    if (selects.kind) fill(selects.kind, ["classes", ...(data.poses.length ? ["poses"] : [])].map((kind) => [kind, kind]), "classes");
    const plot = chart.querySelector(".plot");
    const show = async () => {
      const input = selects.input.value;
      if (selects.method) {
        const rows = data.rows.filter((row) => row.inputs[input]?.confusion.classes?.length);
        const kept = rows.some((row) => row.method === selects.method.value) ? selects.method.value : rows[0]?.method;
        fill(selects.method, rows.map((row) => [row.method, row.title]), kept);
      }
      const made = draw(data, input, selects.measure?.value, selects.method?.value, selects.kind?.value);
      const Plotly = await plotly();
      if (!made) {
        Plotly.purge(plot);
        plot.replaceChildren(make("p", { class: "faint", text: EMPTY[chart.dataset.chart] }));
        return;
      }
      if (!plot.querySelector(".plotly")) plot.replaceChildren();
      await Plotly.react(plot, made.traces, layout(made), { responsive: true, displaylogo: false, displayModeBar: false });
      plot.dataset.drawn = "yes";
    };
    Object.values(selects).forEach((select) => select.addEventListener("change", show));
    onTheme.push(show);
    show();
  }

  function layout(made) {
    const line = colour("line");
    const axis = { gridcolor: line, zerolinecolor: line, linecolor: line, automargin: true };
    const narrow = innerWidth < 640;
    const own = made.layout;
    return {
      height: 440, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: colour("ink"), size: narrow ? 11 : 13 },
      margin: { l: 50, r: narrow ? 8 : 20, t: 12, b: 48 }, hoverlabel: { bgcolor: colour("card"), font: { color: colour("ink") } },
      legend: narrow ? { orientation: "h", y: -0.25, font: { size: 10 } } : { font: { size: 12 } },
      ...own, xaxis: { ...axis, ...own.xaxis }, yaxis: { ...axis, ...own.yaxis },
      ...(narrow && own.narrow ? own.narrow : {}),
    };
  }

  const rowsOf = (data, input) => data.rows.filter((row) => row.inputs[input]).map((row) => ({ ...row, ...row.inputs[input] }));

  function cost(data, input, measure) {
    const rows = rowsOf(data, input).filter((row) => row.seconds > 0);
    if (!rows.length) return null;
    const fronts = data.fronts[input]?.[measure] ?? { methods: [], all: [] };
    const front = [...fronts.methods, ...fronts.all];
    const line = (names, name, dash, shade) => {
      const own = names.map((each) => rows.find((row) => row.method === each)).filter(Boolean);
      return { x: own.map((row) => row.seconds), y: own.map((row) => row.scores[measure]), mode: "lines", name,
        line: { shape: "hv", color: shade, width: 2, dash }, hoverinfo: "skip" };
    };
    const families = [...new Set(rows.map((row) => row.family))];
    const narrow = innerWidth < 640;
    const places = labelled(rows, measure, front);
    const ticks = logTicks(rows.map((row) => row.seconds));
    const traces = [line(fronts.methods, "Pareto front", "solid", colour("accent"))];
    if (fronts.all.join() !== fronts.methods.join()) traces.push(line(fronts.all, "with controls", "dot", colour("faint")));
    families.forEach((family, k) => {
      const shade = FAMILIES[family] ?? COLOURS[3];
      const own = rows.filter((row) => row.family === family);
      traces.push({
        x: own.map((row) => row.seconds), y: own.map((row) => row.scores[measure]), mode: narrow ? "markers" : "markers+text",
        name: plain(family), text: own.map((row) => (places.get(row) ? plain(short(row.title)) : "")), textposition: own.map((row) => places.get(row) ?? "top center"),
        textfont: { size: 11, color: colour("faint") }, cliponaxis: false,
        marker: { size: 11, symbol: MARKS[k], color: shade, line: { width: own.map((row) => (front.includes(row.method) ? 2 : 0)), color: colour("ink") } },
        error_y: { type: "data", symmetric: false, thickness: 1, width: 0, color: shade + "99",
          array: own.map((row) => (row.intervals[measure] ? row.intervals[measure][1] - row.scores[measure] : 0)),
          arrayminus: own.map((row) => (row.intervals[measure] ? row.scores[measure] - row.intervals[measure][0] : 0)) },
        hovertext: own.map((row) => `${plain(row.title)}: ${number(row.scores[measure], 3)}, ${row.seconds.toPrecision(3)} s, ${row.peak ?? "?"} MiB`),
        hoverinfo: "text",
      });
    });
    return { traces, layout: {
      height: 500, xaxis: { type: "log", range: withMargins(rows.map((row) => Math.log10(row.seconds))), title: { text: "seconds per shape" }, tickvals: ticks, ticktext: ticks.map(String) }, yaxis: { title: { text: measure } },
      shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: data.chance[measure], y1: data.chance[measure], line: { dash: "dash", width: 1, color: colour("faint") } }],
      annotations: [{ xref: "paper", x: 1, y: data.chance[measure], text: "chance", showarrow: false, yshift: 9, xanchor: "right", font: { color: colour("faint"), size: 11 } }],
      legend: { orientation: "h", y: 1.1 }, hovermode: "closest",
    } };
  }

  /* Ends of an axis with room for a label beside the first point and the last. */
  function withMargins(values) {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const margin = 0.06 * (high - low) || 0.5;
    return [low - margin, high + margin];
  }

  /* Plotly writes ticks between powers of ten as single digits. */
  function logTicks(values) {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const steps = high < 5 * low ? [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8] : [1, 2, 5];
    const ticks = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power += 1) {
      ticks.push(...steps.map((step) => Number((step * 10 ** power).toPrecision(3))));
    }
    return ticks.filter((tick) => tick > low / 1.6 && tick < high * 1.6);
  }

  /* Where each label stands so that none covers another or a point; those for which there is no room are left out. */
  function labelled(rows, measure, front) {
    const [wide, high] = [900, 400];
    const logs = rows.map((row) => Math.log10(row.seconds));
    const [low, far] = [Math.min(...logs), Math.max(...logs)];
    const at = rows.map((row, k) => [((logs[k] - low) / (far - low || 1)) * wide, (1 - row.scores[measure]) * high]);
    const boxes = at.map(([x, y]) => [x - 7, y - 7, x + 7, y + 7]);
    const overlaps = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    const places = new Map();
    const order = rows.map((_, k) => k).sort((a, b) => front.includes(rows[b].method) - front.includes(rows[a].method) || at[a][0] - at[b][0]);
    for (const k of order) {
      const [x, y] = at[k];
      const length = 6.4 * short(rows[k].title).length;
      const spots = { "top center": [-length / 2, -23], "bottom center": [-length / 2, 9], "middle right": [10, -7], "middle left": [-10 - length, -7],
        "top right": [5, -23], "bottom right": [5, 9], "top left": [-5 - length, -23], "bottom left": [-5 - length, 9] };
      for (const [spot, [dx, dy]] of Object.entries(spots)) {
        const box = [x + dx, y + dy, x + dx + length, y + dy + 14];
        const isInside = box[0] > -0.04 * wide && box[2] < 1.04 * wide;
        if (isInside && !boxes.some((other, n) => n !== k && overlaps(box, other))) { places.set(rows[k], spot); boxes.push(box); break; }
      }
    }
    return places;
  }

  function precision(data, input) {
    const rows = rowsOf(data, input).filter((row) => row.precision);
    if (!rows.length) return null;
    const traces = rows.map((row, k) => ({
      x: data.recalls, y: row.precision, name: plain(row.title), mode: "lines+markers",
      line: { color: COLOURS[k % COLOURS.length], width: 2, dash: row.family === "control" ? "dot" : "solid" },
      marker: { symbol: MARKS[Math.floor(k / COLOURS.length) % MARKS.length], size: 5 },
      text: row.precision.map((value) => number(value, 3)), hovertemplate: "recall %{x}: %{text}",
    }));
    return { traces, layout: { height: 480, xaxis: { title: { text: "recall" }, range: [0, 1.02] }, yaxis: { title: { text: "precision" }, range: [0, 1.03] }, narrow: { height: 620 } } };
  }

  function classes(data, input, measure) {
    const rows = rowsOf(data, input).filter((row) => row.classes[measure]).reverse();
    if (!rows.length || !data.classes.length) return null;
    const names = data.classes.map(plain);
    const text = rows.map((row) => row.classes[measure].map((value) => (value === null ? "" : number(value))));
    return { traces: [{
      type: "heatmap", x: names, y: unique(rows.map((row) => plain(short(row.title)))), z: rows.map((row) => row.classes[measure]), zmin: 0, zmax: 1, colorscale: SCALE,
      xgap: 1, ygap: 1, text, hovertemplate: "%{y}<br>%{x}: %{text}<extra></extra>", colorbar: { thickness: 10, outlinewidth: 0 },
      ...(names.length <= 24 && innerWidth > 640 ? { texttemplate: "%{text}", textfont: { size: 10 } } : {}),
    }], layout: { height: 90 + 25 * rows.length, margin: { l: 30, r: 5, t: 10, b: 40 }, xaxis: { type: "category", showgrid: false, tickangle: -40 }, yaxis: { type: "category", showgrid: false } } };
  }

  function attraction(data, input) {
    const expected = data.attraction[input];
    const rows = rowsOf(data, input).filter((row) => row.attraction);
    if (!rows.length || !expected) return null;
    const all = [...rows.map((row) => [row.title, row.attraction]), ["at random", expected]].reverse();
    const kinds = [["subject", "the class", "#2a9d8f"], ["both", "both", "#8bc4b0"], ["neither", "neither", "#9aa5b1"], ["pose", "the pose", "#d9722b"]];
    const names = unique(all.map(([title]) => plain(short(title))));
    const traces = kinds.filter(([kind]) => all.some(([, shares]) => shares[kind] > 0)).map(([kind, title, shade]) => ({
      type: "bar", orientation: "h", name: title, y: names, x: all.map(([, shares]) => shares[kind]),
      marker: { color: shade }, hovertemplate: "%{y}<br>" + title + ": %{x:.0%}<extra></extra>",
    }));
    return { traces, layout: { barmode: "stack", height: 130 + 25 * all.length, margin: { l: 30, r: 10, t: 50, b: 40 }, xaxis: { range: [0, 1], tickformat: ".0%" }, yaxis: { type: "category" }, legend: { orientation: "h", y: 1, yanchor: "bottom", traceorder: "normal" }, bargap: 0.25 } };
  }

  function confusion(data, input, _, method, kind) {
    const row = rowsOf(data, input).find((each) => each.method === method);
    const names = data[kind];
    if (!row || !row.confusion[kind]?.length || !names.length) return null;
    const counts = names.map(() => new Array(names.length).fill(0));
    for (const [query, match, count] of row.confusion[kind]) counts[query][match] += count;
    const shares = counts.map((line) => { const all = line.reduce((a, b) => a + b, 0); return line.map((n) => (all && n ? n / all : null)); });
    const labels = names.map(plain);
    const size = Math.min(900, Math.max(320, 120 + 22 * names.length));
    return { traces: [{
      type: "heatmap", x: labels, y: labels, z: shares, zmin: 0, zmax: 1, colorscale: SCALE, xgap: 1, ygap: 1, customdata: counts,
      hovertemplate: "%{y} → %{x}: %{customdata} queries, %{z:.0%}<extra></extra>", colorbar: { thickness: 10, outlinewidth: 0, tickformat: ".0%" },
    }], layout: { height: size, margin: { l: 30, r: 5, t: 10, b: 40 }, xaxis: { type: "category", tickangle: -40, title: { text: "nearest match" }, showgrid: false }, yaxis: { type: "category", autorange: "reversed", showgrid: false, title: { text: "query" } } } };
  }

  /* A title beside a chart. Variants are told apart by their end: their parameters go without names, and what is still long loses its middle. */
  function short(title) {
    const [told, most] = [title.replace(/[\w-]+=/g, ""), innerWidth < 640 ? 22 : 34];
    return told.length > most ? `${told.slice(0, most - 14)}…${told.slice(-13)}` : told;
  }

  /* Plotly takes equal names for one place. */
  function unique(names) {
    const seen = new Map();
    return names.map((name) => { const n = seen.get(name) ?? 0; seen.set(name, n + 1); return name + "\u200b".repeat(n); });
  }
})();
