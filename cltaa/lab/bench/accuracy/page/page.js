"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
// JSON has null for infinity: the PSNR of a frame that equals the truth.
function restored(accuracy) {
  for (const s of accuracy.sequences) for (const row of [...s.cells, ...s.yardstick]) for (const e of Object.values(row.errors)) {
    for (const key of ["mean", "p5", "p95", "largest"]) e[key] ??= Infinity;
    e.frames = e.frames.map((v) => v ?? Infinity);
  }
  return accuracy;
}
const report = restored(data.accuracy), pictures = data.pictures;
const $ = (id) => document.getElementById(id);
const state = { sequence: 0, metric: report.metrics[0], a: null, b: null, x: 0, y: 0 };
const baseName = report.variants[0].name; // the variant that all others are compared with
const groups = Object.fromEntries(report.variants.map((v) => [v.name, v.group]));
const current = () => report.sequences[state.sequence];
const counted = (n, thing) => `${n} ${thing}${n === 1 ? "" : "s"}`;
// Three digits, as plain decimals from 1e-5 to 1e6.
const number = (v) => (v === 0 ? "0" : v === Infinity ? "∞" : Math.abs(v) >= 1e6 || Math.abs(v) < 1e-5 ? v.toExponential(2).replace("+", "") : Math.abs(v) >= 100 ? String(Math.round(v)) : Number.isInteger(v) ? String(v) : v.toPrecision(3));
const tick = (v) => (v >= 1e6 || (v < 1e-4 && v > 0) ? v.toExponential(0).replace("+", "") : String(Number(v.toPrecision(3))));
const higher = new Set(data.higher_is_better);

function element(name, attributes = {}, ...children) {
  const svg = ["svg", "g", "line", "path", "circle", "text", "title", "rect"].includes(name);
  const node = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

// One tab stop for many elements; the arrow keys, Home and End move among them, with `across` elements in a row.
function among(host, items, across = 1) {
  items.forEach((item, i) => item.setAttribute("tabindex", i ? -1 : 0));
  host.onkeydown = (event) => {
    const at = items.indexOf(document.activeElement), last = items.length - 1;
    const to = { ArrowRight: at + 1, ArrowLeft: at - 1, ArrowDown: at + across, ArrowUp: at - across, Home: 0, End: last }[event.key];
    if (at < 0 || to === undefined || !items[to]) return;
    event.preventDefault();
    items[at].setAttribute("tabindex", -1); items[to].setAttribute("tabindex", 0); items[to].focus();
  };
}

// A picture's error in the chosen axis: {mean, p5, p95, frames}, or null if it was not measured or is infinite.
function errorOf(cell) {
  if (state.metric !== "rounding") return Number.isFinite(cell.errors[state.metric].mean) ? cell.errors[state.metric] : null;
  const r = cell.rounding;
  return r && r.rms > 0 ? { mean: r.rms, p5: Math.min(...r.frames), p95: Math.max(...r.frames), frames: r.frames } : null;
}

const tidy = (values) => values.filter((v) => v > 0 && Number.isFinite(v));
function logScale(values, from, to) {
  const low = Math.log10(Math.min(...values)), high = Math.log10(Math.max(...values));
  const margin = Math.max((high - low) * 0.08, 0.04), a = low - margin, b = high + margin;
  const scale = (v) => from + ((Math.log10(v) - a) / (b - a)) * (to - from);
  scale.ticks = [];
  const steps = b - a > 3 ? [1] : b - a > 0.9 ? [1, 2, 5] : [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9];
  for (let e = Math.floor(a); e <= b; e++) for (const m of steps) {
    const v = m * 10 ** e;
    if (Math.log10(v) >= a && Math.log10(v) <= b) scale.ticks.push(v);
  }
  return scale;
}
function linearScale(low, high, from, to) {
  const size = high - low || 1, scale = (v) => from + ((v - low) / size) * (to - from);
  scale.ticks = [0, 0.25, 0.5, 0.75, 1].map((t) => low + t * size);
  return scale;
}
// At most six evenly spaced whole numbers, for frames.
function wholeTicks(first, last) {
  const step = Math.max(1, [1, 2, 5, 10, 20, 50, 100, 200, 500].find((s) => (last - first) / s < 6) || Math.ceil((last - first) / 5));
  return Array.from({ length: Math.floor((last - first) / step) + 1 }, (_, i) => first + i * step);
}

function axes(svg, x, y, box, labels) {
  let last = -1e9;
  for (const v of x.ticks) {
    svg.append(element("line", { class: "grid", x1: x(v), x2: x(v), y1: box.top, y2: box.bottom }));
    if (x(v) - last > 34) { svg.append(element("text", { x: x(v), y: box.bottom + 15, "text-anchor": "middle" }, tick(v))); last = x(v); }
  }
  last = 1e9;
  for (const v of [...y.ticks].sort((p, q) => p - q)) {
    svg.append(element("line", { class: "grid", x1: box.left, x2: box.right, y1: y(v), y2: y(v) }));
    if (last - y(v) > 15) { svg.append(element("text", { x: box.left - 5, y: y(v) + 4, "text-anchor": "end" }, tick(v))); last = y(v); }
  }
  svg.append(element("text", { x: box.right, y: box.bottom + 31, "text-anchor": "end" }, labels[0]));
  svg.append(element("text", { x: box.left, y: box.top - 7 }, labels[1]));
}

function limits(measured) {
  const found = [];
  if (state.metric === "rounding") found.push([2 ** -25, "half an ulp of float"], [2 ** -12, "half an ulp of half"]);
  if (state.metric !== "mse") return found;
  const weight = tick(report.variants[0].settings.blend_weight);
  if (measured.mean_noise) found.push([measured.mean_noise, `noise of an exponential mean, weight ${weight}`]);
  if (measured.truth_noise) found.push([measured.truth_noise, "noise of the truth itself"]);
  return found;
}

function drawFront() {
  const measured = current(), host = $("front"), width = Math.max(host.clientWidth, 280), height = width < 560 ? 360 : 460;
  const box = { left: 58, right: width - 12, top: 24, bottom: height - 38 };
  $("better").textContent = higher.has(state.metric) ? "up" : "down";
  const logarithmic = state.metric === "rounding" || !higher.has(state.metric);
  const cells = measured.cells.filter((c) => { const e = errorOf(c); return e && (!logarithmic || e.mean > 0); });
  const drawn = state.metric === "rounding" ? [] : measured.yardstick.filter((s) => s.added > 0 && Number.isFinite(s.errors[state.metric].mean) && (!logarithmic || s.errors[state.metric].mean > 0));
  $("yard").parentElement.hidden = !drawn.length;
  const yards = $("yard").checked ? drawn : [];
  const own = state.metric === "mse" && measured.mean_noise ? [measured.mean_noise] : [];
  const errors = cells.flatMap((c) => [errorOf(c).mean, errorOf(c).p5, errorOf(c).p95]).filter(Number.isFinite).concat(yards.map((s) => s.errors[state.metric].mean), own);
  const times = cells.flatMap((c) => [c.time.low, c.time.high]).concat(yards.map((s) => s.added), [measured.floor]);
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": "Error against time" });
  host.replaceChildren(svg);
  if (!cells.length) { svg.append(element("text", { x: 20, y: 40 }, state.metric === "rounding" && !measured.cells.some((c) => c.rounding) ? "this axis was not measured" : "nothing errs here")); return; }
  const x = logScale(tidy(times), box.left, box.right);
  const y = logarithmic ? logScale(tidy(errors), box.bottom, box.top)
    : linearScale(Math.min(...errors), Math.max(...errors), box.bottom, box.top);
  axes(svg, x, y, box, ["milliseconds a megapixel, added to drawing one sample", state.metric === "rounding" ? "rms distance from float64, relative" : state.metric]);
  svg.append(element("line", { class: "limit", x1: x(measured.floor), x2: x(measured.floor), y1: box.top, y2: box.bottom }));
  svg.append(element("text", { x: x(measured.floor) + 4, y: box.bottom - 6 }, "floor: bytes at copy speed"));
  for (const [value, name] of limits(measured)) if (y(value) > box.top && y(value) < box.bottom) {
    svg.append(element("line", { class: "limit", x1: box.left, x2: box.right, y1: y(value), y2: y(value) }));
    svg.append(element("text", { x: box.right, y: y(value) - 4, "text-anchor": "end" }, name));
  }
  drawFrontLegend(measured, yards);
  const beaten = (c) => state.metric !== "rounding" && c.dominated_by[state.metric];
  if (!measured.noisy && state.metric !== "rounding") {
    const cost = (c) => (higher.has(state.metric) ? -1 : 1) * errorOf(c).mean;
    let least = Infinity;  // points with indistinguishable times are all undominated: the line follows the better ones
    const front = cells.filter((c) => !beaten(c)).sort((p, q) => p.time.median - q.time.median || cost(p) - cost(q))
      .filter((c) => cost(c) < least && ((least = cost(c)), true));
    const path = front.map((c, i) => `${i ? "H" + x(c.time.median) + "V" : "M" + x(c.time.median) + " "}${y(errorOf(c).mean)}`);
    svg.append(element("path", { class: "front", d: path.join("") }));
  }
  if (yards.length) svg.append(element("path", { class: "yard", d: "M" + yards.map((s) => `${x(s.added)} ${y(s.errors[state.metric].mean)}`).join("L") }));
  const LINE = 14, BESIDE = 9, GAP = 24;  // pixels: height of a label, distance from its point, distance to the next label
  const labelled = [];  // labels that would cover another one, or the axis, are left out
  const named = (px, py, name, shape) => {  // the label of a point, or nothing if it would cover another
    const text = element("text", { ...shape, y: py - 6 }, name);
    svg.append(text);  // only elements on the page have a width
    const wide = text.getComputedTextLength(), right = px + BESIDE + wide < box.right, left = right ? px + BESIDE : px - BESIDE - wide;
    text.setAttribute("x", left);
    text.remove();
    if (left < box.left || labelled.some(([from, to, ly]) => left < to + GAP && from < left + wide + GAP && Math.abs(ly - py) < LINE)) return [];
    labelled.push([left, left + wide, py]);
    return [text];
  };
  const points = [...cells].sort((p, q) => Boolean(beaten(q)) - Boolean(beaten(p)))
    .map((cell) => pointOf(cell, x, y, box, beaten(cell), named, logarithmic));
  for (const s of yards) {
    const px = x(s.added), py = y(s.errors[state.metric].mean), text = `${counted(s.samples, "sample")} a pixel: ${number(s.added)} ms/Mpx of drawing, ${state.metric} ${number(s.errors[state.metric].mean)}`;
    const mark = element("g", { class: "point sample", tabindex: 0, role: "img", "aria-label": text, "data-x": px }, element("path", { d: `M${px} ${py - 6}l6 6l-6 6l-6-6z` }), element("title", {}, text));
    mark.append(...named(px, py, `${s.samples}×`));
    mark.addEventListener("focus", () => { $("point").textContent = text; });
    svg.append(mark);
  }
  svg.append(...points);
  among(svg, [...svg.querySelectorAll(".point")].sort((p, q) => p.dataset.x - q.dataset.x));
}

function drawFrontLegend(measured, yards) {
  const mark = (name) => element("span", { class: `line-mark ${name}` }), parts = [mark("limit"), `floor: the bytes that must move, at copy speed, ${number(measured.floor)} ms/Mpx`];
  for (const [value, name] of limits(measured)) parts.push(mark("limit"), `${name}: ${number(value)}` + (name.includes("weight") ? ", w / (2 − w) of one sample's error" : ""));
  if (!measured.noisy && state.metric !== "rounding") parts.push(mark("front"), "front: nothing is both faster and better");
  if (yards.length) parts.push(mark("yard"), "supersampling, by its drawing time");
  $("front-legend").replaceChildren(...parts);
}

function pointOf(cell, x, y, box, beatenBy, named, logarithmic) {
  const t = cell.time, e = errorOf(cell), px = x(t.median), py = y(e.mean), at = (v) => (logarithmic ? y(Math.max(v, e.mean * 1e-3)) : y(v));
  const clamp = (v) => Math.min(Math.max(v, box.top), box.bottom);
  const text = `${cell.variant}: ${number(t.median)} ms/Mpx [${number(t.low)}, ${number(t.high)}], ` +
    `${state.metric} ${number(e.mean)} (5 % to 95 % of frames: ${number(e.p5)} to ${number(e.p95)})` + (beatenBy ? `; beaten by ${beatenBy}` : "");
  const node = element("g", { class: "point" + (beatenBy ? " beaten" : "") + (cell.variant === state.a ? " chosen" : ""), tabindex: 0, role: "button", "aria-label": text, "data-variant": cell.variant, "data-x": px },
    element("line", { class: "bar", x1: x(t.low), x2: x(t.high), y1: py, y2: py }),
    element("line", { class: "bar", x1: px, x2: px, y1: clamp(at(e.p5)), y2: clamp(at(e.p95)) }),
    element("circle", { cx: px, cy: py, r: cell.variant === baseName ? 7 : 5 }), element("title", {}, text));
  if (cell.variant === state.a) $("point").textContent = text;
  if (!beatenBy || groups[cell.variant] === "preset" || cell.variant === baseName) node.append(...named(px, py, cell.variant, { class: "name" }));
  const choose = (second) => { $("point").textContent = text; pick(second ? "b" : "a", cell.variant); };
  node.addEventListener("click", (event) => choose(event.shiftKey));
  node.addEventListener("focus", () => { $("point").textContent = text; });
  node.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); choose(event.shiftKey); } });
  return node;
}

// --- frames -----------------------------------------------------------------------------------------------------------
const loaded = new Map();
function load(url) {
  if (!loaded.has(url)) loaded.set(url, new Promise((done) => { const image = new Image(); image.onload = () => done(image); image.src = url; }));
  return loaded.get(url);
}
function urlOf(name, kind) {
  const own = pictures[current().name] || { variants: {}, inputs: {} };
  return (own.variants[name] || own.inputs[name] || {})[kind] || null;
}
let painting = 0;
async function paint() {
  const there = Boolean(pictures[current().name]);
  $("no-pictures").hidden = there;
  for (const id of ["stage", "slide-row"]) $(id).hidden = !there;
  if (!there) return;
  const mine = ++painting, mode = $("mode").value, kind = { flip: "flip", count: "count" }[mode] || "picture";
  const urls = [urlOf(state.a, kind) || urlOf(state.a, "picture"), urlOf(state.b, kind) || urlOf(state.b, "picture")];
  const [a, b] = await Promise.all(urls.map(load));
  if (mine !== painting) return;
  const under = $("under"), over = $("over");
  for (const canvas of [under, over]) { canvas.width = a.width; canvas.height = a.height; }
  const split = mode !== "difference";
  if (split) { under.getContext("2d").drawImage(b, 0, 0); over.getContext("2d").drawImage(a, 0, 0); }
  else drawDifference(a, b, under.getContext("2d"));
  over.hidden = $("seam").hidden = !split;
  document.querySelector(".slide").style.visibility = split ? "visible" : "hidden";
  document.querySelector(".gain").classList.toggle("off", split);
  $("tag-a").textContent = split ? state.a : `|${state.a} − ${state.b}| × ${$("gain").value}`;
  $("tag-b").textContent = split ? state.b : "";
  place();
}
function pixelsOf(image) {
  const context = Object.assign(document.createElement("canvas"), { width: image.width, height: image.height }).getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.width, image.height);
}
function drawDifference(a, b, context) {
  const first = pixelsOf(a), second = pixelsOf(b), gain = Number($("gain").value);
  for (let i = 0; i < first.data.length; i++) if (i % 4 < 3) first.data[i] = Math.min(255, gain * Math.abs(first.data[i] - second.data[i]));
  context.putImageData(first, 0, 0);
}
function place() {
  const zoom = Number($("zoom").value), stage = $("stage"), width = stage.clientWidth, height = stage.clientHeight;
  state.x = Math.min(0, Math.max(width * (1 - zoom), state.x)); state.y = Math.min(0, Math.max(height * (1 - zoom), state.y));
  for (const id of ["under", "over"]) $(id).style.transform = `translate(${state.x}px, ${state.y}px) scale(${zoom})`;
  const share = $("slide").value / 1000, edge = share * width;
  $("seam").style.left = `${edge}px`;
  // The clip is in the canvas's own pixels, before zooming.
  $("over").style.clipPath = `inset(0 ${Math.max(0, width - (edge - state.x) / zoom)}px 0 0)`;
}
function pick(which, name) {
  state[which] = name; $(which).value = name;
  document.querySelectorAll(".point").forEach((node) => node.classList.toggle("chosen", node.dataset.variant === state.a));
  paint(); drawFrames(); drawDebug();
}
function fillChoices() {
  const own = pictures[current().name];
  const names = own ? [...Object.keys(own.inputs), ...Object.keys(own.variants)] : current().cells.map((c) => c.variant);
  for (const id of ["a", "b"]) $(id).replaceChildren(...names.map((name) => element("option", { value: name }, name)));
  state.a = names.includes(state.a) ? state.a : baseName; state.b = names.includes(state.b) ? state.b : "one sample";
  if (!names.includes(state.a)) state.a = names[names.length - 1];
  $("a").value = state.a; $("b").value = state.b;
}

// --- steps, frames, stages, numbers ------------------------------------------------------------------------------------
function barOf(ratio, span, uncertain, better = ratio < 1) {
  if (!Number.isFinite(ratio)) return element("span", { class: "bar-box" }, element("i"), element("b", {}, "–"));  // no error to divide by
  const share = Math.min(1, Math.abs(Math.log2(ratio)) / span) * 50, more = ratio > 1;
  const bar = element("i", { class: uncertain ? "" : better ? "better" : "worse" });
  bar.style.left = more ? "50%" : `${50 - share}%`; bar.style.width = `${share}%`;
  const sign = ratio >= 100 ? number(ratio) : ratio.toFixed(ratio < 2 ? 3 : 2);
  return element("span", { class: "bar-box" }, bar, element("b", {}, `×${sign}`));
}
function drawSteps() {
  const measured = current(), base = measured.cells[0], host = $("steps"), rows = [];
  const cells = measured.cells.slice(1).filter((c) => errorOf(c) && errorOf(base));
  host.parentElement.hidden = !cells.length;
  const ratios = cells.map((c) => [errorOf(c).mean / errorOf(base).mean, c.ratio.median]);
  const span = [0, 1].map((i) => Math.max(0.1, ...ratios.map((r) => Math.abs(Math.log2(r[i]))).filter(Number.isFinite)));
  rows.push(element("div", { class: "step head" }, element("span", {}, ""), element("span", {}, state.metric), element("span", {}, measured.noisy ? "time (too noisy to rank)" : "time")));
  cells.forEach((cell, i) => {
    const row = element("button", { class: "step", type: "button", "data-variant": cell.variant }, element("span", {}, cell.variant), barOf(ratios[i][0], span[0], false, ratios[i][0] < 1 !== higher.has(state.metric)), barOf(ratios[i][1], span[1], measured.noisy));
    row.addEventListener("click", () => pick("a", cell.variant));
    rows.push(row);
  });
  host.replaceChildren(...rows);
  among(host, rows.slice(1));
}
// A line through points, broken at points without a position.
const pathOf = (points) => points.map(([x, y], i) => (Number.isFinite(y) ? `${i && Number.isFinite(points[i - 1][1]) ? "L" : "M"}${x} ${y}` : "")).join("");
function drawFrames() {
  const measured = current(), host = $("frames"), width = Math.max(host.clientWidth, 280), height = 240;
  const box = { left: 58, right: width - 12, top: 24, bottom: height - 38 };
  const lines = [], add = (name, colour, values) => values && values.length > 1 && lines.push({ name, colour, values });
  const of = (name) => { const c = measured.cells.find((cell) => cell.variant === name); const e = c && errorOf(c); return e && e.frames; };
  if (state.metric !== "rounding") { const one = measured.yardstick.find((s) => s.samples === 1); if (one) add("one sample", "var(--good)", one.errors[state.metric].frames); }
  add(baseName, state.a === baseName ? "var(--accent)" : "var(--grey)", of(baseName));
  if (state.b !== baseName) add(`B: ${state.b}`, "var(--second)", of(state.b));
  if (state.a !== baseName) add(`A: ${state.a}`, "var(--accent)", of(state.a));
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "Error over the frames" });
  host.replaceChildren(svg);
  if (!lines.length) return;
  const all = lines.flatMap((l) => l.values).filter(Number.isFinite), positive = all.every((v) => v > 0) && !higher.has(state.metric);
  const at = measured.frames, end = at[Math.max(...lines.map((l) => l.values.length)) - 1], first = at[0];
  const x = linearScale(first, end, box.left, box.right);
  const y = positive ? logScale(all, box.bottom, box.top) : linearScale(Math.min(...all), Math.max(...all), box.bottom, box.top);
  x.ticks = wholeTicks(first, end);
  axes(svg, x, y, box, ["frame", state.metric]);
  for (const l of lines) svg.append(element("path", { d: pathOf(l.values.map((v, i) => [x(at[i]), y(v)])), fill: "none", stroke: l.colour, "stroke-width": 2 }));
  $("frames-legend").replaceChildren(...lines.flatMap((l) => { const s = element("span", { class: "swatch" }); s.style.background = l.colour; return [s, l.name]; }));
}
function drawStages() {
  const entries = Object.entries(current().stages), total = entries.reduce((sum, [, v]) => sum + v, 0);
  const colours = ["var(--accent)", "var(--second)", "var(--good)", "var(--grey)", "var(--bad)"];
  const stack = element("div", { class: "stack", role: "img", "aria-label": entries.map(([n, v]) => `${n} ${number(v)} ms`).join(", ") });
  const legend = element("p", { class: "legend" });
  entries.forEach(([name, value], i) => {
    const part = element("span", { title: `${name}: ${number(value)} ms/Mpx` }); part.style.width = `${(100 * value) / total}%`; part.style.background = colours[i % 5];
    const s = element("span", { class: "swatch" }); s.style.background = colours[i % 5];
    stack.append(part); legend.append(s, `${name} ${number(value)} ms/Mpx`);
  });
  $("stages").replaceChildren(stack, legend);
}
function drawDebug() {
  const own = pictures[current().name], shown = [];
  $("h-debug").parentElement.hidden = !own;
  for (const [title, url] of Object.entries(own ? own.debug : {})) shown.push([title, url]);
  if (urlOf(state.a, "count")) shown.push([`samples in the history (white: ${data.count_white} and more), ${state.a}`, urlOf(state.a, "count")]);
  $("debug").replaceChildren(...shown.map(([title, url]) => element("figure", {}, element("img", { src: url, alt: title }), element("figcaption", {}, title))));
}
function drawNumbers() {
  const measured = current(), head = ["variant", "ms/Mpx", "95 %", `× ${baseName}`, ...report.metrics, "bits right", "beaten by"];
  const rows = measured.cells.map((c) => [c.variant, number(c.time.median), `${number(c.time.low)} – ${number(c.time.high)}`,
    measured.noisy ? "noisy" : c.ratio.median.toFixed(3), ...report.metrics.map((m) => number(c.errors[m].mean)), !c.rounding ? "–" : c.rounding.rms === 0 ? "all" : (-Math.log2(c.rounding.rms)).toFixed(1), c.dominated_by[state.metric] || ""]);
  for (const s of measured.yardstick) rows.push([`${counted(s.samples, "sample")} a pixel`, s.added === null ? "–" : number(s.added), "", "", ...report.metrics.map((m) => number(s.errors[m].mean)), "", ""]);
  $("numbers").replaceChildren(element("thead", {}, element("tr", {}, ...head.map((h) => element("th", {}, h)))), element("tbody", {}, ...rows.map((r) => element("tr", {}, ...r.map((v) => element("td", {}, v))))));
}

function drawOverview() {
  const sequences = report.sequences, metric = state.metric === "rounding" ? report.metrics[0] : state.metric;
  $("several").hidden = sequences.length < 2;
  const rows = report.variants.map((variant, i) => {
    const ratios = sequences.map((s) => s.cells[i].errors[metric].mean / s.cells[0].errors[metric].mean);
    const logs = ratios.filter((r) => r > 0 && Number.isFinite(r)).map(Math.log2);
    return { name: variant.name, ratios, mean: 2 ** (logs.reduce((sum, v) => sum + v, 0) / Math.max(logs.length, 1)) };
  });
  rows.sort((p, q) => (higher.has(metric) ? q.mean - p.mean : p.mean - q.mean));
  const cellOf = (ratio, name, place) => {
    const share = Math.round(Math.min(1, Math.abs(Math.log2(ratio) || 0)) * 70), good = ratio < 1 !== higher.has(metric);
    const button = element("button", { type: "button", "aria-label": `${sequences[place].name}, ${name}: ${number(ratio)} times that of ${baseName}, ${metric}` }, Number.isFinite(ratio) ? ratio.toFixed(2) : "–");
    button.addEventListener("click", () => { $("sequence").value = state.sequence = place; drawAll(); pick("a", name); });
    return element("td", { style: `background: color-mix(in srgb, var(--${good ? "good" : "bad"}) ${share}%, transparent)` }, button);
  };
  const body = rows.map((row) => element("tr", {}, element("th", { scope: "row" }, row.name), element("td", {}, row.mean.toFixed(3)), ...row.ratios.map((ratio, place) => cellOf(ratio, row.name, place))));
  $("overview").replaceChildren(element("thead", {}, element("tr", {}, ...[metric, "mean", ...sequences.map((s) => s.name)].map((h) => element("th", { scope: "col" }, h)))), element("tbody", {}, ...body));
  among($("overview"), [...$("overview").querySelectorAll("button")], sequences.length);
}

function drawAll() {
  const measured = current(), where = report.environment;
  $("where").textContent = `${measured.name}: ${counted(measured.frames.length, "frame")}, ${measured.width} × ${measured.height}, ${measured.effects.replaceAll(",", ", ") || "no effects declared"}${measured.profile ? `, read by profile ${measured.profile}` : ""}. ` +
    `${where.device}${where.units ? `, ${counted(where.units, "compute unit")}` : ""}; ${where.cpu}, ${counted(where.cores, "core")}, load ${where.load_before} to ${where.load_after}; ${where.date} UTC; kernels ${where.kernels_sha256.slice(0, 12)}.`;
  $("noise").hidden = !measured.noisy && measured.clock !== "processor";
  $("noise").textContent = !measured.noisy ? "Ranked by the processor time of all threads that run kernels together: what they wait for a processor is not in it." : `Too noisy to rank by time: ${baseName} against its own copy took ${number(measured.control.median)} times as long [${number(measured.control.low)}, ${number(measured.control.high)}]. Errors are exact.`;
  fillChoices(); drawFront(); drawSteps(); drawFrames(); drawStages(); drawDebug(); drawNumbers(); drawOverview(); paint();
}
function start() {
  document.querySelectorAll(".base").forEach((node) => { node.textContent = baseName; });
  $("sequence").replaceChildren(...report.sequences.map((s, i) => element("option", { value: i }, s.name)));
  const rounding = report.sequences.some((s) => s.cells.some((c) => c.rounding));
  $("metric").replaceChildren(...report.metrics.map((m) => element("option", { value: m }, `${m}, against the truth`)), ...(rounding ? [element("option", { value: "rounding" }, "rounding, against float64")] : []));
  $("sequence").addEventListener("change", () => { state.sequence = Number($("sequence").value); drawAll(); });
  $("metric").addEventListener("change", () => { state.metric = $("metric").value; drawAll(); });
  for (const id of ["a", "b"]) $(id).addEventListener("change", () => pick(id, $(id).value));
  for (const id of ["mode", "gain"]) $(id).addEventListener("change", paint);
  $("yard").addEventListener("change", drawFront);
  $("slide").addEventListener("input", place);
  $("zoom").addEventListener("change", () => { const z = Number($("zoom").value), s = $("stage"); state.x = (s.clientWidth * (1 - z)) / 2; state.y = (s.clientHeight * (1 - z)) / 2; place(); });
  $("theme").addEventListener("click", () => {
    const dark = document.documentElement.dataset.theme ? document.documentElement.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    document.documentElement.dataset.theme = dark ? "light" : "dark";
  });
  $("stage").addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[event.key];
    if (!step || $("zoom").value === "1") return;
    event.preventDefault(); state.x += step[0]; state.y += step[1]; place();
  });
  let held = null;
  $("stage").addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; $("stage").setPointerCapture(event.pointerId); drag(event); });
  $("stage").addEventListener("pointermove", (event) => { if (held) drag(event); });
  for (const end of ["pointerup", "pointercancel"]) $("stage").addEventListener(end, () => { held = null; });
  function drag(event) {
    if ($("zoom").value === "1") { const r = $("stage").getBoundingClientRect(); $("slide").value = (1000 * (event.clientX - r.left)) / r.width; }
    else { state.x += event.clientX - held[0]; state.y += event.clientY - held[1]; held = [event.clientX, event.clientY]; }
    place();
  }
  let waiting = 0;
  addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(() => { drawFront(); drawFrames(); place(); }, 100); });
  drawAll();
}
start();
