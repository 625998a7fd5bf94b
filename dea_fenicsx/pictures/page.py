"""The HTML page of a report; its parts are marked by @NAME@ and filled by `report`."""

PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline' \
'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:; worker-src blob:">
<link rel="icon" href="data:,">
<title>@TITLE@</title>
<style>
body { font: 15px/1.4 sans-serif; margin: 1em auto; max-width: 1100px; padding: 0 1em;
  background: #fff; color: #222; }
h1 { font-size: 1.4em; } h2 { font-size: 1.1em; margin-top: 1.5em; }
.row { display: flex; flex-wrap: wrap; gap: .5em 1.2em; align-items: center; margin: .4em 0; }
#device { height: 560px; } #curve { height: 380px; }
#step { flex: 1; min-width: 12em; } #warp { width: 5em; }
table { border-collapse: collapse; } td { padding: .15em .8em .15em 0; vertical-align: top; }
pre { white-space: pre-wrap; margin: 0; font-size: .85em; max-height: 24em; overflow: auto; }
.hidden { display: none; }
</style>
</head>
<body>
<h1 id="title"></h1>
<p id="status"></p>
<section id="device-part" class="hidden">
<div class="row">
<label>Field <select id="field"></select></label>
<label>Displacements &times; <input id="warp" type="number" value="1" step="any"></label>
<label><input id="electrodes" type="checkbox" checked> electrodes</label>
<label><input id="obstacles" type="checkbox" checked> obstacles</label>
</div>
<div id="device"></div>
<div class="row">
<label for="step">Step</label><input id="step" type="range" min="0" value="0" step="1">
<span id="load"></span>
</div>
</section>
<section>
<h2>Curves</h2>
<div class="row">
<label>Ordinate <select id="y"></select></label><label>Abscissa <select id="x"></select></label>
</div>
<div id="curve"></div>
</section>
<section><h2>Events</h2><table id="events"></table></section>
<section><h2>Failures</h2><table id="failures"></table></section>
<section><h2>Settings, versions and cost</h2><table id="about"></table></section>
<script>@LIBRARY@</script>
<script type="application/json" id="data">@DATA@</script>
<script type="text/plain" id="numbers">@NUMBERS@</script>
<script>
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const at = id => document.getElementById(id);

// Plotly takes a few tags in texts for markup; the texts of a run are shown sign by sign.
const plain = text => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;")
  .replace(/>/g, "&gt;");
const settings = {displaylogo: false, responsive: true, showSendToCloud: false};

function fill(table, rows, none, preformatted) {
  for (const row of rows.length ? rows : [[none]]) {
    const line = table.insertRow();
    row.forEach((text, k) => {
      const cell = line.insertCell();
      const place = preformatted && k ? cell.appendChild(document.createElement("pre")) : cell;
      place.textContent = text;
    });
  }
}

function choose(select, names, labels, value) {
  names.forEach((name, k) => {
    const option = document.createElement("option");
    option.value = name;
    option.textContent = labels[k];
    select.appendChild(option);
  });
  select.value = value;
}

// A loop over single signs where a browser has no function of its own for it.
function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const signs = atob(text), bytes = new Uint8Array(signs.length);
  for (let k = 0; k < signs.length; k++) bytes[k] = signs.charCodeAt(k);
  return bytes;
}

async function unpacked() {
  const bytes = bytesOf(at("numbers").textContent.trim());
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  const found = new Map();
  let place = 0;
  for (const [name, kind, size] of data.arrays) {
    found.set(name, new (kind === "i" ? Int32Array : Float32Array)(buffer, place, size));
    place += 4 * size;
  }
  return found;
}

function drawCurve(row) {
  const {columns, events} = data.curves;
  const names = [at("x").value, at("y").value];
  if (!names.every(name => name in columns)) return;
  const [x, y] = names.map(name => columns[name][1]);
  const told = events.map((text, k) => [k, text]).filter(([k, text]) => text);
  const traces = [
    {x, y, mode: "lines+markers", name: "history", marker: {size: 5}},
    {x: told.map(([k]) => x[k]), y: told.map(([k]) => y[k]), mode: "markers+text", name: "events",
     text: told.map(([k, text]) => plain(text)), textposition: "top center",
     marker: {size: 10, symbol: "diamond", color: "#d62728"}},
    {x: [x[row]], y: [y[row]], mode: "markers", name: "step shown",
     marker: {size: 12, symbol: "circle-open", color: "#222", line: {width: 2}}},
  ];
  Plotly.react("curve", traces, {
    margin: {l: 70, r: 20, t: 20, b: 50}, showlegend: false,
    xaxis: {title: {text: plain(columns[names[0]][0])}},
    yaxis: {title: {text: plain(columns[names[1]][0])}},
  }, settings);
}

function moved(base, change, factor) {
  const size = base.length / 3;
  return [0, 1, 2].map(axis => {
    const found = new Float32Array(size);
    for (let k = 0; k < size; k++) {
      found[k] = base[axis * size + k] + factor * change[axis * size + k];
    }
    return found;
  });
}

// The least and the largest coordinates of all steps, with a little room; kept for each factor.
const reached = new Map(data.device ? [[1, roomy(data.device.reach)]] : []);
function reach(arrays, factor) {
  if (!reached.has(factor)) reached.set(factor, findReach(arrays, factor));
  return reached.get(factor);
}

function findReach(arrays, factor) {
  const ends = [0, 1, 2].map(() => [Infinity, -Infinity]);
  data.device.steps.forEach((step, k) => {
    moved(arrays.get("points"), arrays.get(`moved/${k}`), factor).forEach((values, axis) => {
      for (const value of values) {
        if (value < ends[axis][0]) ends[axis][0] = value;
        if (value > ends[axis][1]) ends[axis][1] = value;
      }
    });
  });
  return roomy(ends);
}

function roomy(ends) {
  const room = .02 * Math.max(...ends.map(([low, high]) => high - low)) || 1;
  return ends.map(([low, high]) => [low - room, high + room]);
}

// The triangles all corners of which have a value, and the others, as three columns each.
function parted(triangles, values) {
  const size = triangles.length / 3, known = new Uint8Array(size);
  let many = 0;
  for (let k = 0; k < size; k++) {
    known[k] = [0, 1, 2].every(j => Number.isFinite(values[triangles[3 * k + j]]));
    many += known[k];
  }
  return [[1, many], [0, size - many]].map(([wanted, count]) => {
    const columns = [0, 1, 2].map(() => new Int32Array(count));
    for (let k = 0, place = 0; k < size; k++) {
      if (known[k] !== wanted) continue;
      for (let j = 0; j < 3; j++) columns[j][place] = triangles[3 * k + j];
      place++;
    }
    return columns;
  });
}

const COLOURS = ["#d62728", "#1f77b4", "#ff7f0e", "#9467bd", "#8c564b", "#e377c2"];

function lineOf(pairs, places) {
  const found = [[], [], []];
  for (let k = 0; k < pairs.length; k += 2) {
    const [a, b] = [pairs[k], pairs[k + 1]];
    found.forEach((list, axis) => list.push(places[axis][a], places[axis][b], null));
  }
  return found;
}

// Lines that move as a rigid body: a rotation by rows, and a shift.
function turned(ends, motion, factor) {
  const size = ends.length / 3, found = [[], [], []];
  for (let k = 0; k < size; k++) {
    const point = [0, 1, 2].map(axis => ends[axis * size + k]);
    found.forEach((list, axis) => {
      const moved = [0, 1, 2].reduce((sum, j) => sum + motion[3 * axis + j] * point[j],
        motion[9 + axis]);
      list.push(point[axis] + factor * (moved - point[axis]));
      if (k % 2) list.push(null);
    });
  }
  return found;
}

function drawDevice(arrays, shown) {
  const {fields, electrodes, obstacles, flat, steps} = data.device;
  const [name, label, low, high] = fields.find(([one]) => one === at("field").value)
    || [null, "", 0, 1];
  const factor = Number(at("warp").value);
  const [x, y, z] = moved(arrays.get("points"), arrays.get(`moved/${shown}`), factor);
  const values = name === null ? new Float32Array(x.length) : arrays.get(`${name}/${shown}`);
  const last = name === null ? values : arrays.get(`${name}/${steps.length - 1}`);
  const [coloured, grey] = parted(arrays.get("triangles"), last);
  const lighting = flat ? {ambient: 1, diffuse: 0, specular: 0}
    : {ambient: .6, diffuse: .5, specular: .05};
  const mesh = (part, more) => ({type: "mesh3d", x, y, z, i: part[0], j: part[1], k: part[2],
    lighting, ...more});
  const traces = [
    mesh(coloured, {intensity: values, cmin: low, cmax: high, colorscale: "Viridis", name: "device",
      hovertemplate: "%{intensity:.4g}<extra></extra>",
      colorbar: {title: {text: plain(label), side: "right"}}}),
    mesh(grey, {color: "#b8b8b8", name: "no field", hoverinfo: "skip"}),
  ];
  const places = moved(arrays.get("lines"), arrays.get(`line_moved/${shown}`), factor);
  electrodes.forEach((electrode, k) => {
    const [a, b, c] = lineOf(arrays.get(`line/${electrode}`), places);
    traces.push({type: "scatter3d", mode: "lines", x: a, y: b, z: c, name: plain(electrode),
      line: {width: 6, color: COLOURS[k % COLOURS.length]}, hoverinfo: "name", showlegend: true,
      visible: at("electrodes").checked});
  });
  obstacles.forEach(([surface, motions], k) => {
    const [a, b, c] = turned(arrays.get(`obstacle/${k}`), motions[shown], factor);
    traces.push({type: "scatter3d", mode: "lines", x: a, y: b, z: c, hoverinfo: "name",
      name: plain(`obstacle at ${surface}`), line: {width: 2, color: "#5b7c99"}, showlegend: true,
      visible: at("obstacles").checked});
  });
  const ends = reach(arrays, factor);
  const sizes = ends.map(([low, high]) => high - low), largest = Math.max(...sizes);
  const ratio = sizes.map(size => 1.5 * Math.max(size / largest, .002));
  const axis = k => ({title: {text: `${data.axes[k]} (mm)`}, range: ends[k]});
  const scene = {aspectmode: "manual", aspectratio: {x: ratio[0], y: ratio[1], z: ratio[2]},
    xaxis: axis(0), yaxis: axis(1), zaxis: flat ? {visible: false} : axis(2),
    camera: flat ? {eye: {x: 0, y: 0, z: 1.7}, up: {x: 0, y: 1, z: 0}}
      : {eye: {x: -1.25, y: -1.7, z: 1}}};
  const layout = {margin: {l: 0, r: 0, t: 0, b: 0}, uirevision: "kept", scene,
    legend: {x: 0, y: 1}};
  return Plotly.react("device", traces, layout, settings);
}

function said(row) {
  const parts = [`step ${row}`];
  for (const load of data.curves.loads) {
    const [label, values] = data.curves.columns[load];
    if (values[row] !== null) parts.push(`${label}: ${Number(values[row].toPrecision(4))}`);
  }
  return parts.join(", ");
}

async function start() {
  at("title").textContent = data.title;
  at("status").textContent = [data.status, data.message].filter(text => text).join(": ");
  fill(at("events"), data.events.map(([event, step]) => [event, `step ${step}`]), "none");
  fill(at("failures"), data.failures.map(text => [text]), "none");
  fill(at("about"), data.about, "no summary.json yet", true);
  const {columns} = data.curves, names = Object.keys(columns);
  for (const axis of ["x", "y"]) {
    choose(at(axis), names, names, data.curves[axis]);
    at(axis).onchange = () => drawCurve(row());
  }
  const slider = at("step");
  const row = () => data.device ? data.device.steps[Number(slider.value)]
    : data.curves.events.length - 1;
  if (data.device) {
    at("device-part").classList.remove("hidden");
    const arrays = await unpacked();
    const {fields, steps} = data.device;
    choose(at("field"), fields.map(([one]) => one), fields.map(([, label]) => label),
      fields.length ? fields[0][0] : "");
    slider.max = steps.length - 1;
    slider.value = steps.length - 1;
    const draw = () => {
      at("load").textContent = said(row());
      return drawDevice(arrays, Number(slider.value));
    };
    slider.oninput = () => { drawCurve(row()); return draw(); };
    for (const id of ["field", "warp", "electrodes", "obstacles"]) at(id).onchange = draw;
    await draw();
  }
  document.body.dataset.ready = "yes";
  setTimeout(() => drawCurve(row()));  // below the device, which is shown first
}
start();
</script>
</body>
</html>
"""
