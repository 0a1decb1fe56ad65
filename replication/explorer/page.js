"use strict";
// The page: one state x, moved by hand or by a trial, and four pictures of it. All pictures are drawn in `frame`, once
// per picture of the screen at most; what takes longer is done in pieces between them.

(function explorer() {
  const data = unpack(JSON.parse(document.getElementById("data").textContent));
  const find = (id) => document.getElementById(id), css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`);
  const n = data.system.lengths.length, m = 2 * n, high = data.state_max;
  const NAMES = Array.from({ length: m }, (_, i) => ((name) => (i < n ? name : `d${name}/dt`))(`θ${"₁₂₃₄₅₆₇₈"[i % n]}`));
  const UNITS = Array.from({ length: m }, (_, i) => (i < n ? "rad" : "rad/s"));
  const CELLS = 48; // per side of the plane through x
  const BUSY = 3, IDLE = 9; // ms of a picture that may go into that plane, while something moves and else
  const REACH = 28; // px around a handle that a finger takes hold of
  const GHOST = 0.6; // s of rest between two showings of what K does
  const MOST_TRIALS = 300; // that are looked through for an activation
  const EDGE = 11; // px within the plane of what lies outside it
  const calm = matchMedia("(prefers-reduced-motion: reduce)");

  const view = {
    alpha: "0.5" in data.regions ? "0.5" : Object.keys(data.regions)[0], arm: "as written", p_t: 0, delta: 1.5,
    x: Float64Array.from({ length: m }, (_, i) => [0.3, -0.5, 0.4, 0.9, 0, 0][i] ?? 0), axes: [0, n], link: 0,
    supervised: true, noisy: false, actor: -1, playing: false, at: -1, seed: 0, start: null,
  };
  view.p_t = data.regions[view.alpha].p_t;
  let now = {}, trial = null, dirty = true, ink = {}, layer = null, moved = 0, told = "";

  // ---- what is derived from the state

  const arms = Object.fromEntries(Object.entries(data.regions).map(([alpha, r]) => [alpha, Object.fromEntries(Object.keys(r.arms).map((name) => [name, armOf(r, name)]))]));
  const arm = () => arms[view.alpha][view.arm];
  const system = (delta) => systemOf(data, delta);
  const roll = (delta, record) => recover(system(delta), data.k, data.rule, view.x, record);

  function derive() {
    const a = arm(), map = a.network ? { y: place(a, view.x), near: nearest(a, view.x).near } : mapState(a, view.x), p = lookUp(a.gamma, map.y);
    now = { map, p, h: p > view.p_t, nominal: roll(1, false), real: roll(view.delta, true) };
    now.tips = now.real.path.map((x) => joints(data.system.lengths, x).at(-1));
  }

  const says = { [RECOVERED]: "recovers", [HIT_GROUND]: "hits the ground", [NOT_RECOVERED]: "does not recover in time" };
  const seconds = (periods) => `${(periods * data.rule.control_period).toFixed(2)} s`;

  function words() {
    const l = now.real.outcome === RECOVERED, ln = now.nominal.outcome === RECOVERED;
    const say = now.h
      ? l ? "π goes on, and K could still help: as it should be." : "π goes on, but K would fail: a danger that h does not see."
      : l ? "K takes over, earlier than it must." : "K takes over, too late.";
    const token = (yes, name, value) => `<span class="is ${yes ? "yes" : "no"}">${name} = <b>${value}</b></span>`;
    const text = token(now.h, "h(x)", Number(now.h)) + token(ln, "l<sub>n</sub>(x)", Number(ln)) + token(l, "l(x)", Number(l)) + `<span class="say">${say}</span>`;
    if (text !== told) find("verdict").innerHTML = told = text;
    find("recovery").textContent = `K ${says[now.real.outcome]}${now.real.outcome === NOT_RECOVERED ? "" : `, ${seconds(now.real.periods)}`}`;
    find("probability").textContent = `Γ(Ψ(x)) = ${now.p.toFixed(2)} ${now.h ? ">" : "≤"} ${view.p_t.toFixed(2)}${planeEdge(now.map.y).out ? ", off the picture" : ""}`;
    sliders.forEach(({ input, output }, i) => {
      if (document.activeElement !== input || view.playing) input.value = view.x[i];
      output.textContent = `${view.x[i].toFixed(2).replace("-", "−")} ${UNITS[i]}`;
    });
  }

  // ---- canvases

  const canvases = {};
  function fit(name) {
    const canvas = find(name), ratio = Math.min(devicePixelRatio || 1, 2), box = canvas.getBoundingClientRect();
    canvas.width = Math.max(1, Math.round(box.width * ratio));
    canvas.height = Math.max(1, Math.round(box.height * ratio));
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    canvases[name] = { canvas, context, width: box.width, height: box.height };
  }

  function look() {
    ink = Object.fromEntries(["text", "quiet", "rule", "surface", "page", ...Object.keys(data.colours).filter((c) => typeof data.colours[c] === "string")].map((c) => [c, css(c).trim()]));
    ["pendulum", "plane", "slice", "timeline", "strip"].forEach(fit);
    layer = null;
    slice.painted = false;
    strip.painted = "";
    dirty = true;
  }

  function line(c, points, colour, width) {
    c.beginPath();
    points.forEach(([x, y], i) => (i ? c.lineTo(x, y) : c.moveTo(x, y)));
    Object.assign(c, { strokeStyle: colour, lineWidth: width, lineJoin: "round", lineCap: "round" });
    c.stroke();
  }

  function dot(c, [x, y], radius, fill, edge, width = 1.5) {
    c.beginPath();
    c.arc(x, y, radius, 0, 2 * Math.PI);
    if (fill) { c.fillStyle = fill; c.fill(); }
    if (edge) { Object.assign(c, { strokeStyle: edge, lineWidth: width }); c.stroke(); }
  }

  // Where values on a grid cross a level, as pieces of lines between the centres of cells, in units of cells.
  function contour(value, across, up, level) {
    const path = new Path2D(), cut = (a, b) => (level - a) / (b - a);
    for (let i = 0; i + 1 < across; i++) {
      for (let j = 0; j + 1 < up; j++) {
        const a = value(i, j), b = value(i + 1, j), c = value(i + 1, j + 1), d = value(i, j + 1), ends = [];
        if (a > level !== b > level) ends.push([i + cut(a, b), j]);
        if (b > level !== c > level) ends.push([i + 1, j + cut(b, c)]);
        if (c > level !== d > level) ends.push([i + 1 - cut(c, d), j + 1]);
        if (d > level !== a > level) ends.push([i, j + 1 - cut(d, a)]);
        for (let e = 0; e + 1 < ends.length; e += 2) {
          path.moveTo(ends[e][0] + 0.5, ends[e][1] + 0.5);
          path.lineTo(ends[e + 1][0] + 0.5, ends[e + 1][1] + 0.5);
        }
      }
    }
    return path;
  }

  // ---- the pendulum

  const reach = data.system.lengths.reduce((a, b) => a + b, 0);
  const stage = { left: -1.04 * reach, right: 1.04 * reach, low: -0.32 * reach };
  function toScreen([x, y]) {
    const { width, height } = canvases.pendulum, unit = width / (stage.right - stage.left);
    return [(x - stage.left) * unit, height - (y - stage.low) * unit];
  }
  function fromScreen([x, y]) {
    const { width, height } = canvases.pendulum, unit = width / (stage.right - stage.left);
    return [x / unit + stage.left, (height - y) / unit + stage.low];
  }

  function drawPendulum(clock) {
    const { context: c, width, height } = canvases.pendulum, pose = (x) => joints(data.system.lengths, x).map(toScreen);
    c.clearRect(0, 0, width, height);
    line(c, [toScreen([stage.left, 0]), toScreen([stage.right, 0])], ink.ground, 2);
    const circle = Array.from({ length: 73 }, (_, i) => toScreen(target(data.task, (i / 72) * (2 * Math.PI / data.task.circle_speed))));
    c.setLineDash([5, 5]);
    line(c, circle, ink.target, 1.5);
    c.setLineDash([]);
    const inTrial = view.at >= 0, byK = inTrial && trial.activated >= 0 && view.at >= trial.activated;
    if (!byK) {
      c.globalAlpha = 0.9;
      line(c, now.tips.map(toScreen), ink.corrective, 1.6);
      const length = now.real.periods, shown = calm.matches || moved + 250 > clock ? length : Math.min(length, ((clock - moved - 250) / 1000 % (length * data.rule.control_period + GHOST)) / data.rule.control_period | 0);
      if (length > 0 && !view.playing) {
        c.globalAlpha = 0.55;
        const ghost = pose(now.real.path[shown]);
        line(c, ghost, ink.corrective, 4);
        ghost.slice(1).forEach((p) => dot(c, p, 3.5, ink.corrective));
      }
      c.globalAlpha = 1;
    }
    if (inTrial) {
      line(c, trial.tips.slice(Math.max(0, view.at - 100), Math.min(view.at, trial.activated < 0 ? Infinity : trial.activated) + 1).map(toScreen), ink.trace, 1.5);
      if (byK) line(c, trial.tips.slice(trial.activated, view.at + 1).map(toScreen), ink.corrective, 1.6);
      else dot(c, toScreen(target(data.task, view.at * data.task.control_period)), 6, ink.target);
    }
    const points = pose(view.x), colour = byK ? ink.corrective : ink.text, focused = document.activeElement === canvases.pendulum.canvas;
    line(c, points, colour, 5);
    dot(c, points[0], 4, colour);
    points.slice(1).forEach((p, i) => dot(c, p, focused && i === view.link ? 9 : 7, ink.surface, colour, 2.5));
  }

  // ---- the plane of the mapping

  // The part of the plane that is shown: a square around the training states, and so around every mean of them. A network
  // may put Ψ(x) outside.
  function shown() {
    const r = arm(), range = (k) => {
      let low = Infinity, top = -Infinity;
      for (let i = k; i < r.y_train.length; i += 2) { low = Math.min(low, r.y_train[i]); top = Math.max(top, r.y_train[i]); }
      return [(low + top) / 2, top - low];
    };
    if (!r.shown) {
      const [[x, wide], [y, tall]] = [range(0), range(1)], side = 1.16 * Math.max(wide, tall);
      r.shown = { left: x - side / 2, low: y - side / 2, side };
    }
    return r.shown;
  }
  function planePoint(y) {
    const { width } = canvases.plane, { left, low, side } = shown(), unit = width / side;
    return [(y[0] - left) * unit, width - (y[1] - low) * unit];
  }
  // The point of y, moved to the edge if it lies outside the square; out: the direction in which it does, or null.
  function planeEdge(y) {
    const { width } = canvases.plane, point = planePoint(y), inside = point.map((v) => Math.min(Math.max(v, 0), width));
    if (inside.every((v, k) => v === point[k])) return { point, out: null };
    const edge = point.map((v) => Math.min(Math.max(v, EDGE), width - EDGE)), by = Math.hypot(point[0] - edge[0], point[1] - edge[1]);
    return { point: edge, out: [(point[0] - edge[0]) / by, (point[1] - edge[1]) / by] };
  }
  // Draws with y, in cells of the grid of Γ, as coordinates.
  function inCells(c, draw) {
    const g = arm().gamma, { left, low, side } = shown(), unit = canvases.plane.width / side;
    c.save();
    c.translate((g.origin[0] - left) * unit, canvases.plane.width - (g.origin[1] - low) * unit);
    c.scale(g.cell * unit, -g.cell * unit);
    draw(g.cell * unit);
    c.restore();
  }

  function planeLayer() {
    const key = `${view.alpha} ${view.arm}`, { gamma: g, y_train: y, labels } = arm(), { canvas, width } = canvases.plane;
    if (layer?.key !== key) {
      const image = new OffscreenCanvas(g.cells, g.cells), picture = new ImageData(g.cells, g.cells), shades = data.colours.gamma;
      const shade = (p, k) => {
        const place = p * (shades.length - 1), base = Math.min(Math.floor(place), shades.length - 2);
        return (1 - place + base) * shades[base][k] + (place - base) * shades[base + 1][k];
      };
      for (let i = 0; i < g.cells; i++) {
        for (let j = 0; j < g.cells; j++) {
          const p = g.grid[i * g.cells + j];
          picture.data.set([shade(p, 0), shade(p, 1), shade(p, 2), 255], 4 * (j * g.cells + i));
        }
      }
      image.getContext("2d").putImageData(picture, 0, 0);
      const whole = new OffscreenCanvas(canvas.width, canvas.height), c = whole.getContext("2d");
      c.scale(canvas.width / width, canvas.width / width);
      Object.assign(c, { fillStyle: `rgb(${[0, 1, 2].map((k) => shade(g.empty, k)).join()})`, imageSmoothingQuality: "high" });
      c.fillRect(0, 0, width, width);
      inCells(c, () => c.drawImage(image, 0, 0, g.cells, g.cells));
      c.globalAlpha = 0.85;
      labels.forEach((z, i) => dot(c, planePoint([y[2 * i], y[2 * i + 1]]), 1.5, z ? ink.safe : ink.unsafe));
      layer = { key, whole, p_t: null };
    }
    if (layer.p_t !== view.p_t) Object.assign(layer, { p_t: view.p_t, border: contour((i, j) => g.grid[i * g.cells + j], g.cells, g.cells, view.p_t) });
    return layer;
  }

  function drawPlane() {
    const { context: c, width, height } = canvases.plane, { whole, border } = planeLayer();
    c.drawImage(whole, 0, 0, width, height);
    inCells(c, (unit) => {
      Object.assign(c, { strokeStyle: ink.border, lineWidth: 1.8 / unit });
      c.stroke(border);
    });
    const { point: here, out } = planeEdge(now.map.y), { y_train: y, labels } = arm();
    now.map.near.forEach((i, p) => {
      const state = planePoint([y[2 * i], y[2 * i + 1]]);
      if (now.map.weights) {
        c.globalAlpha = 0.35 + 0.65 * Math.min(1, 4 * now.map.weights[p]);
        line(c, [here, state], ink.background, 1);
        c.globalAlpha = 1;
      }
      dot(c, state, 3.6, labels[i] ? ink.safe : ink.unsafe, ink.background, 1.4);
    });
    if (out) {
      const [a, b] = out, tip = EDGE - 1;
      line(c, [[here[0] + 5 * a - 7 * b, here[1] + 5 * b + 7 * a], [here[0] + tip * a, here[1] + tip * b], [here[0] + 5 * a + 7 * b, here[1] + 5 * b - 7 * a]], ink.background, 2.5);
    }
    dot(c, here, out ? 5 : 7, ink.background, ink.ink, 2.5);
    if (!now.h) line(c, [[here[0] - 3, here[1]], [here[0] + 3, here[1]]], ink.ink, 2);
    else dot(c, here, 2, ink.ink);
  }

  // ---- the plane of two coordinates through x: in each cell what h says, and what K does, found piece by piece

  const slice = { gammaKey: "", labelKey: "", p: new Float32Array(CELLS * CELLS), l: new Int8Array(CELLS * CELLS), image: new OffscreenCanvas(CELLS, CELLS), painted: false };
  const ORDER = [8, 4, 2, 1].flatMap((stride) => {
    const cells = [];
    for (let i = 0; i < CELLS; i += stride) for (let j = 0; j < CELLS; j += stride) if (stride === 8 || (i / stride) % 2 || (j / stride) % 2) cells.push({ i, j, stride });
    return cells;
  });
  const COARSE = ORDER.findIndex((cell) => cell.stride < 8);

  function work(budget) {
    const [a, b] = view.axes, rest = Array.from(view.x, (v, i) => (i === a || i === b ? 0 : v)).join();
    const gammaKey = [view.alpha, view.arm, a, b, rest].join(" "), labelKey = [view.delta, a, b, rest].join(" ");
    if (gammaKey !== slice.gammaKey) Object.assign(slice, { gammaKey, gammaAt: 0, painted: false });
    if (labelKey !== slice.labelKey) Object.assign(slice, { labelKey, labelAt: 0, painted: false, known: 0 });
    const until = performance.now() + budget, x = Float64Array.from(view.x), s = system(view.delta), own = arm();
    const at = ({ i, j }) => { // the centre of the smallest cell: what is filled coarsely stands for it in the end
      x[a] = high[a] * ((2 * (i + 0.5)) / CELLS - 1);
      x[b] = high[b] * ((2 * (j + 0.5)) / CELLS - 1);
      return x;
    };
    const fill = (array, { i, j, stride }, value) => { for (let p = i; p < i + stride; p++) array.fill(value, p * CELLS + j, p * CELLS + j + stride); };
    let done = 0;
    while (slice.gammaAt < ORDER.length && (done++ % 16 || performance.now() < until)) {
      const cell = ORDER[slice.gammaAt++];
      fill(slice.p, cell, safety(own, at(cell)));
    }
    while (slice.gammaAt === ORDER.length && slice.labelAt < ORDER.length && performance.now() < until) {
      const cell = ORDER[slice.labelAt++];
      fill(slice.l, cell, Number(recover(s, data.k, data.rule, at(cell)).outcome === RECOVERED));
      done += 1;
    }
    if (done) { slice.painted = false; dirty = true; }
    return slice.labelAt < ORDER.length;
  }

  function paintSlice() {
    const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)), known = slice.labelAt >= COARSE;
    const picture = new ImageData(CELLS, CELLS), hue = [rgb(data.colours.unsafe), rgb(data.colours.safe), rgb(data.colours.ground)];
    for (let i = 0; i < CELLS; i++) {
      for (let j = 0; j < CELLS; j++) {
        const place = 4 * ((CELLS - 1 - j) * CELLS + i), from = i * CELLS + j;
        picture.data.set(hue[known ? slice.l[from] : 2], place);
        picture.data[place + 3] = slice.p[from] > view.p_t ? 235 : 62;
      }
    }
    slice.image.getContext("2d").putImageData(picture, 0, 0);
    slice.border = contour((i, j) => slice.p[i * CELLS + j], CELLS, CELLS, view.p_t);
    Object.assign(slice, { painted: true, p_t: view.p_t });
  }

  const MARGIN = { left: 34, bottom: 30, top: 4, right: 4 };
  function sliceBox() {
    const { width, height } = canvases.slice;
    return { left: MARGIN.left, top: MARGIN.top, width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom };
  }
  function slicePoint(x) {
    const box = sliceBox(), [a, b] = view.axes, part = (i) => Math.min(Math.max((x[i] / high[i] + 1) / 2, 0), 1);
    return [box.left + part(a) * box.width, box.top + (1 - part(b)) * box.height];
  }

  function drawSlice() {
    const { context: c, width, height } = canvases.slice, box = sliceBox(), [a, b] = view.axes;
    if (!slice.painted || slice.p_t !== view.p_t) paintSlice();
    c.clearRect(0, 0, width, height);
    c.imageSmoothingEnabled = false;
    c.drawImage(slice.image, box.left, box.top, box.width, box.height);
    c.save();
    c.translate(box.left, box.top + box.height);
    c.scale(box.width / CELLS, -box.height / CELLS);
    Object.assign(c, { strokeStyle: ink.text, lineWidth: (1.3 * CELLS) / box.width });
    c.stroke(slice.border);
    c.restore();
    Object.assign(c, { strokeStyle: ink.rule, lineWidth: 1 });
    c.strokeRect(box.left, box.top, box.width, box.height);
    Object.assign(c, { fillStyle: ink.quiet, font: "12px system-ui, sans-serif", textBaseline: "middle" });
    const tick = (v) => (Number.isInteger(v) ? String(v) : v.toFixed(1)).replace("-", "−");
    [-1, 0, 1].forEach((p) => {
      c.textAlign = ["left", "center", "right"][p + 1];
      c.fillText(tick(p * high[a]), box.left + ((p + 1) / 2) * box.width, box.top + box.height + 10);
      c.textAlign = "right";
      c.fillText(tick(p * high[b]), box.left - 5, box.top + ((1 - p) / 2) * box.height + [-6, 0, 6][p + 1]);
    });
    c.textAlign = "center";
    c.fillText(`${NAMES[a]} (${UNITS[a]})`, box.left + 0.75 * box.width, box.top + box.height + 20);
    c.save();
    c.translate(9, box.top + 0.25 * box.height);
    c.rotate(-Math.PI / 2);
    c.fillText(`${NAMES[b]} (${UNITS[b]})`, 0, 0);
    c.restore();
    const [px, py] = slicePoint(view.x);
    c.globalAlpha = 0.5;
    line(c, [[px, box.top], [px, box.top + box.height]], ink.text, 1);
    line(c, [[box.left, py], [box.left + box.width, py]], ink.text, 1);
    c.globalAlpha = 1;
    dot(c, [px, py], 7, ink.background, ink.ink, 2.5);
  }

  // ---- trials

  // Normal numbers, the same for the same seed: mulberry32, and the transform by Box and Muller.
  function normals(seed) {
    let state = (seed * 2654435761) >>> 0;
    const uniform = () => {
      state = (state + 0x6d2b79f5) >>> 0;
      let t = Math.imul(state ^ (state >>> 15), state | 1);
      t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
      return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
    };
    return () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
  }

  function chosenActor() {
    if (view.actor >= 0) return data.actors[view.actor];
    const own = data.actors.filter((a) => a.alpha === (view.supervised ? view.alpha : "none"));
    const among = own.length ? own : data.actors;
    return among.reduce((best, a) => (Math.abs(a.delta - view.delta) < Math.abs(best.delta - view.delta) ? a : best));
  }

  function makeTrial() {
    const actor = chosenActor(), draw = normals(view.seed + 1), supervised = view.supervised ? { arm: arm(), p_t: view.p_t } : {};
    const world = { system: system(view.delta), k: data.k, rule: data.rule, task: data.task, policy: actor, ...supervised };
    trial = runTrial(world, view.start ?? new Float64Array(m), view.noisy ? (i) => Math.exp(actor.log_std[i]) * draw() : null);
    trial.actor = actor;
    trial.tips = trial.states.map((x) => joints(data.system.lengths, x).at(-1));
    trial.p = null;
    find("scrub").max = trial.states.length - 1;
    find("scrub").value = Math.max(0, view.at);
    if (view.at >= 0) show(Math.min(view.at, trial.states.length - 1));
    timeline.painted = false;
    dirty = true;
  }

  function show(at) {
    view.at = Math.max(0, Math.min(at, trial.states.length - 1));
    view.x = Float64Array.from(trial.states[view.at]);
    find("scrub").value = view.at;
    moved = performance.now();
    dirty = true;
  }

  const ends = { [RECOVERED]: "K recovers it", [HIT_GROUND]: "it hits the ground", [NOT_RECOVERED]: "K does not recover it in time", [TIME_OVER]: "time is over" };
  const timeline = { painted: false, image: null };
  function drawTimeline() {
    const { canvas, context: c, width, height } = canvases.timeline, count = trial.states.length - 1, px = (i) => 1 + (i / Math.max(1, count)) * (width - 2), py = (p) => 6 + (1 - p) * (height - 26);
    const keyed = `${view.alpha} ${view.arm} ${view.p_t}`;
    if (!timeline.painted || timeline.keyed !== keyed) {
      trial.p ??= trial.states.map((x) => safety(arm(), x));
      timeline.image = new OffscreenCanvas(canvas.width, canvas.height);
      const t = timeline.image.getContext("2d"), until = trial.activated < 0 ? count : trial.activated;
      t.scale(canvas.width / width, canvas.width / width);
      Object.assign(t, { globalAlpha: 0.07, fillStyle: ink.text });
      t.fillRect(px(0), py(1), px(until) - px(0), py(0) - py(1));
      Object.assign(t, { globalAlpha: 0.4, fillStyle: ink.corrective });
      t.fillRect(px(until), py(1), px(count) - px(until), py(0) - py(1));
      t.globalAlpha = 1;
      t.setLineDash([4, 4]);
      line(t, [[px(0), py(view.p_t)], [px(count), py(view.p_t)]], ink.quiet, 1);
      t.setLineDash([]);
      line(t, trial.p.map((p, i) => [px(i), py(p)]), ink.text, 1.6);
      Object.assign(t, { fillStyle: ink.quiet, font: "12px system-ui, sans-serif", textBaseline: "alphabetic" });
      t.fillText("Γ(Ψ(x))", px(0) + 5, py(0) - 6);
      const length = count * data.rule.control_period, marks = length > 5 ? 2 : length > 1.6 ? 1 : 0.25;
      for (let s = 0; s <= length + 1e-9; s += marks) {
        t.textAlign = s === 0 ? "left" : px(s / data.rule.control_period) > width - 20 ? "right" : "center";
        t.fillText(`${s} s`, px(s / data.rule.control_period), height - 4);
      }
      Object.assign(timeline, { painted: true, keyed });
      const score = `return ${trial.total.toFixed(0)} in ${seconds(trial.periods)}`;
      find("outcome").textContent = trial.activated >= 0 ? `K takes over at ${seconds(trial.activated)}, and ${ends[trial.outcome].replace(/^K /, "")}` : `${score}: ${ends[trial.outcome]}`;
    }
    c.clearRect(0, 0, width, height);
    c.drawImage(timeline.image, 0, 0, width, height);
    if (view.at >= 0) {
      line(c, [[px(view.at), py(1)], [px(view.at), py(0)]], ink.text, 2);
      dot(c, [px(view.at), py(trial.p[view.at])], 5, ink.surface, ink.text, 2);
    }
  }

  function play(on) {
    view.playing = on;
    find("play").textContent = on ? "Pause" : "Play";
    if (on && (view.at < 0 || view.at >= trial.states.length - 1)) show(0);
    view.last = performance.now();
    view.part = 0;
    dirty = true;
  }

  function step(by) {
    play(false);
    show((view.at < 0 ? 0 : view.at) + by);
  }

  // Goes on with trials until K is activated; in pieces, so that the page answers meanwhile.
  function nextActivation() {
    play(false);
    if (!view.supervised) { view.supervised = find("supervised").checked = true; makeTrial(); }
    if (trial.activated > 0 && view.at < trial.activated) { arrive(); return; }
    view.noisy = find("noisy").checked = true; // the mean actions are the same in every trial
    view.start = null;
    view.at = 0;
    let left = MOST_TRIALS;
    find("next").disabled = true;
    (function some() {
      const until = performance.now() + 40;
      do { view.seed += 1; left -= 1; makeTrial(); } while (trial.activated < 0 && left > 0 && performance.now() < until);
      if (trial.activated < 0 && left > 0) { requestAnimationFrame(some); return; }
      find("next").disabled = false;
      if (trial.activated >= 0) arrive();
      else find("outcome").textContent = `K is not needed in ${MOST_TRIALS} trials`;
    })();
  }
  function arrive() {
    show(trial.activated - Math.min(trial.activated, 60)); // a little before it, to see it come
    play(true);
  }

  // ---- the strip: from which mass mismatch on K fails

  const strip = { key: "", labels: [], shown: [], painted: "" };
  function workStrip(budget) {
    const key = view.x.join();
    if (key !== strip.key) Object.assign(strip, { key, labels: [] });
    const until = performance.now() + budget;
    while (strip.labels.length < data.deltas.length && performance.now() < until) strip.labels.push(Number(roll(data.deltas[strip.labels.length], false).outcome === RECOVERED));
    return strip.labels.length < data.deltas.length;
  }
  function drawStrip() {
    const { context: c, width, height } = canvases.strip, thumb = 16, count = data.deltas.length, cell = (width - thumb) / (count - 1);
    const done = strip.labels.length === count && strip.key === view.x.join();
    if (done) strip.shown = strip.labels.slice();
    const key = done + strip.shown.join(""); // pale while it is of an earlier state
    if (key === strip.painted) return;
    strip.painted = key;
    c.clearRect(0, 0, width, height);
    c.globalAlpha = done ? 1 : 0.3;
    strip.shown.forEach((l, i) => {
      c.fillStyle = l ? ink.safe : ink.unsafe;
      const left = i ? Math.round(thumb / 2 + (i - 0.5) * cell) : 0, right = i < count - 1 ? Math.round(thumb / 2 + (i + 0.5) * cell) : width;
      c.fillRect(left, 0, right - left, height);
    });
  }

  // ---- precision and recall

  const KINDS = { uniform: "states drawn uniformly from the state space", "random policy": "states that a random policy visits" }, tested = {};
  function drawScores() {
    const which = data.deltas.reduce((best, d, i) => (Math.abs(d - view.delta) < Math.abs(data.deltas[best] - view.delta) ? i : best), 0);
    const key = `${view.alpha} ${view.arm}`;
    tested[key] ??= Object.fromEntries(Object.entries(data.test).map(([kind, { x }]) => {
      const count = x.length / m;
      return [kind, Float64Array.from({ length: count }, (_, i) => safety(arm(), x.subarray(m * i, m * (i + 1))))];
    }));
    const bar = (name, v) => `<div class="score"><span>${name}</span><div><i style="width:${Number.isNaN(v) ? 0 : 100 * v}%"></i></div><b>${Number.isNaN(v) ? "–" : `${(100 * v).toFixed(1)} %`}</b></div>`;
    find("scores").innerHTML = Object.entries(tested[key]).map(([kind, p]) => {
      const labels = data.test[kind].labels.subarray(which * p.length, (which + 1) * p.length), { precision, recall, found, safe } = judge(p, labels, view.p_t);
      return `<div><h3>${p.length} ${KINDS[kind]}: h takes ${found} for safe, ${safe} are</h3>${bar("precision", precision)}${bar("recall", recall)}</div>`;
    }).join("");
    find("tested").textContent = `Δ = ${view.delta.toFixed(1)}, p_t = ${view.p_t.toFixed(2)}`.replace("p_t", "pₜ");
  }

  // ---- Fig. 3

  const conditionName = (alpha) => (alpha === "none" ? "no supervisor" : `α = ${alpha}`);
  function drawFigure() {
    const { panels, seeds } = data.figure_3, w = 380, h = 300, box = { left: 42, top: 8, right: 6 }, split = 178, base = 276;
    const lit = view.supervised ? view.alpha : "none", nearest = panels.reduce((b, p) => (Math.abs(p.delta - view.delta) < Math.abs(b.delta - view.delta) ? p : b));
    const colour = (alpha) => `var(--condition-${alpha.replace(".", "-")})`, order = Object.keys(panels[0].curves).sort((a, b) => (a === lit) - (b === lit));
    find("fig3").innerHTML = panels.map((panel) => {
      const curves = Object.values(panel.curves), end = Math.max(...curves.flatMap((c) => c.step)), top = 800, low = -400;
      const px = (s) => box.left + (s / end) * (w - box.left - box.right), py = (v) => box.top + ((top - Math.max(v, low)) / (top - low)) * (split - box.top - 20);
      const route = (c, row) => c[row].map((v, i) => `${px(c.step[i]).toFixed(1)},${py(v).toFixed(1)}`);
      const lines = order.map((alpha) => {
        const c = panel.curves[alpha], on = alpha === lit;
        if (!c) return "";
        const band = on ? `<polygon points="${route(c, "low").concat(route(c, "high").reverse()).join(" ")}" style="fill:${colour(alpha)}" opacity="0.2"/>` : "";
        return `${band}<polyline points="${route(c, "mean").join(" ")}" fill="none" style="stroke:${colour(alpha)}" stroke-width="${on ? 2.6 : 1.2}" opacity="${on ? 1 : 0.6}"/>`;
      }).join("");
      const most = Math.max(...Object.values(panel.counts).flatMap((c) => [c.activations.mean, c.failures.mean, c.falls.mean])), names = Object.keys(panel.counts).sort();
      const slot = (w - box.left - box.right) / names.length, by = (v) => base - (v / most) * (base - split - 14);
      const bars = names.map((alpha, i) => {
        const c = panel.counts[alpha], on = alpha === lit, left = box.left + slot * i + 0.2 * slot, wide = 0.3 * slot;
        const pair = alpha === "none" ? [[c.falls.mean, 0.55]] : [[c.activations.mean, 1], [c.failures.mean, 0.55]];
        const rect = pair.map(([v, dark], j) => `<rect x="${left + (alpha === "none" ? 0.5 : j) * wide}" y="${by(v)}" width="${wide - 2}" height="${base - by(v)}" style="fill:color-mix(in srgb, ${colour(alpha)} ${100 * dark}%, var(--text))" opacity="${on ? 1 : 0.5}"/>`).join("");
        const rise = by(pair.length > 1 ? pair[1][0] : pair[0][0]) - 4, value = pair.at(-1)[0];
        return `${rect}<text x="${left + (alpha === "none" ? wide : 1.5 * wide)}" y="${rise}" text-anchor="middle" ${on ? ' style="fill:var(--text)"' : ""}>${value < 10 ? value.toFixed(1) : value.toFixed(0)}</text><text x="${left + wide}" y="${base + 15}" text-anchor="middle"${on ? ' style="fill:var(--text);font-weight:650"' : ""}>${conditionName(alpha).replace("no supervisor", "none")}</text>`;
      }).join("");
      const grid = [800, 400, 0, -400].map((v) => `<line x1="${box.left}" x2="${w - box.right}" y1="${py(v)}" y2="${py(v)}" style="stroke:var(--rule)"/><text x="${box.left - 6}" y="${py(v) + 4}" text-anchor="end">${String(v).replace("-", "−")}</text>`).join("");
      const steps = [0, 0.5, 1].map((part) => `<text x="${px(part * end)}" y="${split - 2}" text-anchor="${["start", "middle", "end"][2 * part]}">${part ? `${((part * end) / 1e6).toFixed(2)} M steps` : 0}</text>`).join("");
      const count = `<line x1="${box.left}" x2="${w - box.right}" y1="${base}" y2="${base}" style="stroke:var(--quiet)"/><text x="${box.left - 6}" y="${by(most) + 4}" text-anchor="end">${(most / 1000).toFixed(0)}k</text><text x="${box.left - 6}" y="${base + 1}" text-anchor="end">0</text>`;
      const titles = `<text x="${w - box.right}" y="${py(low) - 6}" text-anchor="end">mean return</text><text x="${w - box.right}" y="${split + 14}" text-anchor="end">how often</text>`;
      return `<button type="button" data-delta="${panel.delta}" aria-pressed="${panel === nearest}"><strong>Δ = ${panel.delta}</strong><svg viewBox="0 0 ${w} ${h}" role="img" aria-label="Learning curves and counts at Δ = ${panel.delta}">${grid}${lines}${steps}${count}${bars}${titles}</svg></button>`;
    }).join("");
    find("fig3-key").innerHTML = Object.keys(panels[0].curves).sort().map((alpha) => `<button type="button" data-alpha="${alpha}" aria-pressed="${alpha === lit}"><i class="line" style="background:${colour(alpha)}"></i>${conditionName(alpha)}</button>`).join("");
    find("fig3-seeds").textContent = `${seeds} seeds`;
  }

  // ---- controls

  function segments(id, entries, chosen, choose) {
    find(id).innerHTML = entries.map(([value, text]) => `<label><input type="radio" name="${id}" value="${value}"${value === chosen ? " checked" : ""}>${text}</label>`).join("");
    find(id).addEventListener("change", (event) => choose(event.target.value));
  }

  const PSI = {
    network: (k) => `Ψ is a small neural network, fitted to the places that t-SNE gave the training states. It no longer asks where they are: the ${k} that are nearest to x are marked only to compare.`,
    neighbours: (k) => `Ψ(x) is the mean of the places of the ${k} training states nearest to x, the nearest weighted most. Lines lead to them.`,
  };
  const EVIDENCE = {
    embedded: "Γ counts each label where t-SNE, which knew it, has put the state.",
    "held out": "Γ counts each label where Ψ, learned from other states, puts the state.",
  };
  function how() {
    const a = arm();
    find("how").textContent = `${PSI[a.network ? "network" : "neighbours"](a.neighbours)} ${EVIDENCE[a.evidence]}`;
  }

  function changed({ trials = true, scores = true, figure = true } = {}) {
    find("p_t-value").textContent = view.p_t.toFixed(2);
    find("delta-value").textContent = `= ${view.delta.toFixed(1)}`;
    how();
    find("p_t").value = view.p_t;
    find("delta").value = view.delta;
    if (scores) pending.scores = true;
    if (figure) pending.figure = true;
    if (trials) pending.trial = true;
    moved = performance.now();
    dirty = true;
  }
  const pending = {};

  function leaveTrial() {
    play(false);
    view.at = -1;
  }
  function setState(change) {
    leaveTrial();
    change(view.x);
    for (let i = 0; i < m; i++) {
      if (i > 0 && i < n) view.x[i] -= 2 * Math.PI * Math.round(view.x[i] / (2 * Math.PI));
      view.x[i] = Math.min(Math.max(view.x[i], -high[i]), high[i]);
    }
    moved = performance.now();
    dirty = true;
  }

  const order = Object.keys(data.regions).sort();
  segments("alpha", order.map((a) => [a, `α = ${a}`]), view.alpha, (a) => { view.alpha = a; changed(); });
  segments("arm", Object.keys(arms[view.alpha]).map((name) => [name, name]), view.arm, (name) => { view.arm = name; changed({ figure: false }); });
  find("p_t").addEventListener("input", (e) => { view.p_t = Number(e.target.value); changed({ figure: false }); });
  find("delta").addEventListener("input", (e) => { view.delta = Number(e.target.value); changed(); });
  find("supervised").addEventListener("change", (e) => { view.supervised = e.target.checked; changed({ scores: false }); });
  find("noisy").addEventListener("change", (e) => { view.noisy = e.target.checked; changed({ scores: false, figure: false }); });
  find("actor").innerHTML = `<option value="-1">of this α, nearest Δ</option>${data.actors.map((a, i) => `<option value="${i}">${conditionName(a.alpha)}, Δ = ${a.delta}</option>`).join("")}`;
  find("actor").addEventListener("change", (e) => { view.actor = Number(e.target.value); changed({ scores: false, figure: false }); });
  find("play").addEventListener("click", () => play(!view.playing));
  find("back").addEventListener("click", () => step(-1));
  find("forth").addEventListener("click", () => step(1));
  find("next").addEventListener("click", nextActivation);
  find("here").addEventListener("click", () => { view.start = Float64Array.from(view.x); view.at = 0; makeTrial(); play(true); });
  find("scrub").addEventListener("input", (e) => { play(false); show(Number(e.target.value)); });
  find("upright").addEventListener("click", () => { view.start = null; setState((x) => x.fill(0)); changed({ scores: false, figure: false }); });
  find("random").addEventListener("click", () => setState((x) => x.forEach((_, i) => { x[i] = high[i] * (2 * Math.random() - 1); })));
  find("fig3").addEventListener("click", (e) => {
    const panel = e.target.closest("button");
    if (panel) { view.delta = Number(panel.dataset.delta); changed(); }
  });
  find("fig3-key").addEventListener("click", (e) => {
    const alpha = e.target.closest("button")?.dataset.alpha;
    if (!alpha) return;
    view.supervised = find("supervised").checked = alpha !== "none";
    if (alpha !== "none") { view.alpha = alpha; find("alpha").querySelector(`[value="${alpha}"]`).checked = true; }
    changed();
  });

  find("coordinates").innerHTML = Array.from({ length: m }, (_, i) => (i % 2 ? n : 0) + (i >> 1)).map((i) => `<label><span>${NAMES[i]} <output></output></span><input type="range" data-i="${i}" min="${-high[i]}" max="${high[i]}" step="any"></label>`).join("");
  const sliders = Array.from({ length: m }, (_, i) => {
    const input = find("coordinates").querySelector(`[data-i="${i}"]`);
    input.addEventListener("input", () => setState((x) => { x[i] = Number(input.value); }));
    input.addEventListener("keydown", (e) => {
      const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[e.key];
      if (by) { e.preventDefault(); setState((x) => { x[i] += (by * high[i]) / 100; }); input.value = view.x[i]; }
    });
    return { input, output: input.parentElement.querySelector("output") };
  });
  ["axis-x", "axis-y"].forEach((id, which) => {
    find(id).innerHTML = NAMES.map((name, i) => `<option value="${i}"${i === view.axes[which] ? " selected" : ""}>${name}</option>`).join("");
    find(id).addEventListener("change", (e) => {
      const value = Number(e.target.value);
      if (value === view.axes[1 - which]) { view.axes[1 - which] = view.axes[which]; find(which ? "axis-x" : "axis-y").value = view.axes[which]; }
      view.axes[which] = value;
      dirty = true;
    });
  });

  // ---- pointers and keys

  function pointer(event, canvas) {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }
  // hold(point): what a pointer there takes hold of, or null, and then the page scrolls; move(held, point).
  function draggable(name, hold, move) {
    const canvas = find(name);
    let held = null;
    canvas.addEventListener("touchstart", (e) => { if (hold(pointer(e.touches[0], canvas)) !== null && e.cancelable) e.preventDefault(); }, { passive: false });
    canvas.addEventListener("pointerdown", (e) => {
      held = hold(pointer(e, canvas));
      if (held === null) return;
      canvas.setPointerCapture(e.pointerId);
      canvas.focus({ preventScroll: true });
      move(held, pointer(e, canvas));
    });
    canvas.addEventListener("pointermove", (e) => {
      if (held !== null) move(held, pointer(e, canvas));
      else canvas.style.cursor = hold(pointer(e, canvas)) === null ? "" : "grab";
    });
    ["pointerup", "pointercancel"].forEach((kind) => canvas.addEventListener(kind, () => { held = null; }));
  }
  const near = (a, b, reach = REACH) => Math.hypot(a[0] - b[0], a[1] - b[1]) < reach;

  draggable("pendulum", (at) => {
    const points = joints(data.system.lengths, view.x).map(toScreen), distance = points.slice(1).map((p) => Math.hypot(p[0] - at[0], p[1] - at[1])), best = distance.indexOf(Math.min(...distance));
    return distance[best] < REACH ? best : null;
  }, (link, at) => {
    const from = joints(data.system.lengths, view.x)[link], to = fromScreen(at);
    let before = 0;
    for (let i = 0; i < link; i++) before += view.x[i];
    view.link = link;
    setState((x) => { x[link] = Math.atan2(to[0] - from[0], to[1] - from[1]) - before; });
  });
  draggable("slice", (at) => { const box = sliceBox(); return at[0] > box.left - 8 && at[1] < box.top + box.height + 8 ? 0 : null; }, (_, at) => {
    const box = sliceBox(), [a, b] = view.axes;
    setState((x) => {
      const put = (i, part) => { x[i] = high[i] * (2 * Math.min(Math.max(part, 0.0005), 0.9995) - 1); };
      put(a, (at[0] - box.left) / box.width);
      put(b, 1 - (at[1] - box.top) / box.height);
    });
  });
  function trainingState(i) {
    const { x_train: states, scale, labels } = arm();
    setState((x) => x.forEach((_, j) => { x[j] = states[j * labels.length + i] * scale[j]; }));
  }
  function nearestTraining(at) {
    const { y_train: y, labels } = arm();
    let best = null, least = REACH;
    for (let i = 0; i < labels.length; i++) {
      const p = planePoint([y[2 * i], y[2 * i + 1]]), d = Math.hypot(p[0] - at[0], p[1] - at[1]);
      if (d < least) { least = d; best = i; }
    }
    return best;
  }
  draggable("plane", nearestTraining, (_, at) => { const i = nearestTraining(at); if (i !== null) trainingState(i); });
  draggable("timeline", () => 0, (_, at) => { play(false); show(Math.round((at[0] / canvases.timeline.width) * (trial.states.length - 1))); });

  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  find("pendulum").addEventListener("keydown", (e) => {
    const link = Number(e.key) - 1;
    if (link >= 0 && link < n) { view.link = link; dirty = true; }
    const arrow = ARROWS[e.key];
    if (arrow) { e.preventDefault(); setState((x) => { x[view.link] += 0.03 * (arrow[0] - arrow[1]); }); }
  });
  find("slice").addEventListener("keydown", (e) => {
    const arrow = ARROWS[e.key];
    if (arrow) { e.preventDefault(); setState((x) => view.axes.forEach((i, which) => { x[i] += 0.02 * high[i] * arrow[which]; })); }
  });
  let chosen = 0;
  find("plane").addEventListener("keydown", (e) => {
    const arrow = ARROWS[e.key], count = arm().labels.length;
    if (arrow) { e.preventDefault(); chosen = (chosen + arrow[0] + arrow[1] + count) % count; trainingState(chosen); }
  });
  document.addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || /^(BUTTON|SELECT)$/.test(e.target.tagName) && e.key === " ") return;
    const act = { " ": () => play(!view.playing), ",": () => step(-1), ".": () => step(1), n: nextActivation, u: () => find("upright").click() }[e.key];
    if (act && !(e.target.tagName === "INPUT" && e.target.type !== "range" && e.key === " ")) { e.preventDefault(); act(); }
  });
  ["focus", "blur"].forEach((kind) => find("pendulum").addEventListener(kind, () => { dirty = true; }));

  // ---- the loop

  function goOn(clock) {
    view.part += (clock - view.last) / 1000 / data.rule.control_period;
    view.last = clock;
    const by = Math.floor(view.part);
    if (by < 1) return;
    view.part -= by;
    if (view.at + by < trial.states.length) { show(view.at + by); return; }
    if (view.at < trial.states.length - 1) { show(trial.states.length - 1); view.rest = 0; }
    view.rest += by * data.rule.control_period;
    if (view.rest < GHOST) return;
    view.start = null; // the end was seen for a moment: the next trial begins, upright
    if (view.noisy) view.seed += 1;
    view.at = 0;
    makeTrial();
  }

  function frame(clock) {
    requestAnimationFrame(frame);
    if (view.playing) goOn(clock);
    if (pending.trial) { pending.trial = false; makeTrial(); }
    const busy = clock - moved < 120, ghostly = !calm.matches && !view.playing && now.real?.periods > 0 && clock - moved > 250;
    work(busy ? BUSY : IDLE);
    if (!busy) workStrip(BUSY);
    if (pending.scores && !busy) { pending.scores = false; drawScores(); }
    if (pending.figure && !busy) { pending.figure = false; drawFigure(); }
    drawStrip();
    if (dirty) {
      derive();
      words();
      drawPlane();
      drawSlice();
      drawTimeline();
    }
    if (dirty || ghostly) drawPendulum(clock);
    dirty = false;
  }

  addEventListener("resize", look);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { look(); timeline.painted = false; });
  look();
  changed();
  makeTrial();
  drawScores();
  drawFigure();
  requestAnimationFrame(frame);
})();
