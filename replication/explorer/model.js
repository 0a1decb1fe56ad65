// The pendulum, K, the supervisor and a policy, as the page simulates them. No number stands here: all come from the
// package with the data. Above this stands `motion`, which is derived from the energies of the pendulum. Names and
// the order of sums are the package's, and a test holds both to each other.

const RECOVERED = 1, HIT_GROUND = 2, NOT_RECOVERED = 3, TIME_OVER = 10;

// The system of mass mismatch delta; every mass is linear in it.
function systemOf(data, delta) {
  const masses = data.system.masses.map((m, i) => m + (delta - 1) * data.system.masses_per_delta[i]);
  return { masses, lengths: data.system.lengths, gravity: data.system.gravity };
}

const SCRATCH = new Map();

// Arrays for the steps of a pendulum with n links, made once.
function scratch(n) {
  if (!SCRATCH.has(n)) {
    const state = () => new Float64Array(2 * n);
    SCRATCH.set(n, {
      mass: new Float64Array(n * n), force: new Float64Array(n), diagonal: new Float64Array(n),
      slopes: [state(), state(), state(), state()], moved: state(), next: state(),
    });
  }
  return SCRATCH.get(n);
}

// The slope dx [2n] of the state x [2n] under the torques u [n]: M = L D L', solved in place.
function derivative(s, x, u, dx) {
  const n = s.masses.length, { mass: a, force: f, diagonal: d } = scratch(n);
  motion(s, x, u, a, f);
  for (let j = 0; j < n; j++) {
    d[j] = a[j * n + j];
    for (let k = 0; k < j; k++) d[j] -= a[j * n + k] * a[j * n + k] * d[k];
    for (let i = j + 1; i < n; i++) {
      for (let k = 0; k < j; k++) a[i * n + j] -= a[i * n + k] * a[j * n + k] * d[k];
      a[i * n + j] /= d[j];
    }
  }
  for (let i = 0; i < n; i++) for (let k = 0; k < i; k++) f[i] -= a[i * n + k] * f[k];
  for (let i = n - 1; i >= 0; i--) {
    f[i] /= d[i];
    for (let k = i + 1; k < n; k++) f[i] -= a[k * n + i] * f[k];
  }
  for (let i = 0; i < n; i++) {
    dx[i] = x[n + i];
    dx[n + i] = i > 0 ? f[i] - f[i - 1] : f[0];
  }
}

// One step of the classical Runge-Kutta method with u held, from x to out.
function rk4Step(s, x, u, dt, out) {
  const { slopes: [k1, k2, k3, k4], moved } = scratch(s.masses.length);
  const move = (from, h, slope, to) => { for (let i = 0; i < from.length; i++) to[i] = from[i] + h * slope[i]; };
  derivative(s, x, u, k1);
  move(x, 0.5 * dt, k1, moved);
  derivative(s, moved, u, k2);
  move(x, 0.5 * dt, k2, moved);
  derivative(s, moved, u, k3);
  move(x, dt, k3, moved);
  derivative(s, moved, u, k4);
  move(x, dt / 6, k1, out);
  move(out, dt / 6, k4, out);
  move(out, dt / 3, k2, out);
  move(out, dt / 3, k3, out);
}

// One control period with u held, x in place. Returns 0, or the outcome that ends the rollout.
function holdTorque(s, rule, x, u) {
  const n = s.masses.length, { next } = scratch(n), dt = rule.control_period / rule.substeps;
  for (let step = 0; step < rule.substeps; step++) {
    rk4Step(s, x, u, dt, next);
    for (let i = n; i < 2 * n; i++) if (!(Math.abs(next[i]) <= rule.rate_bound)) return NOT_RECOVERED;
    x.set(next);
    if (Math.abs(x[0]) >= rule.theta1_max) return HIT_GROUND;
  }
  return 0;
}

// One period of K: reads the measured y [2n], writes u [n], advances the prediction xbar [2n].
function lqgUpdate(k, xbar, y, u) {
  const m = xbar.length, n = u.length, xhat = new Float64Array(m);
  for (let i = 0; i < m; i++) {
    let s = xbar[i];
    for (let j = 0; j < m; j++) s += k.filter_gain[i][j] * (y[j] - xbar[j]);
    xhat[i] = s;
  }
  for (let i = 0; i < n; i++) {
    let s = 0;
    for (let j = 0; j < m; j++) s -= k.gain[i][j] * xhat[j];
    u[i] = Math.min(Math.max(s, -k.torque_limit), k.torque_limit);
  }
  for (let i = 0; i < m; i++) {
    let s = 0;
    for (let j = 0; j < m; j++) s += k.a[i][j] * xhat[j];
    for (let j = 0; j < n; j++) s += k.b[i][j] * u[j];
    xbar[i] = s;
  }
}

function isUpright(rule, x) {
  const n = x.length / 2;
  return x.every((v, i) => Math.abs(v) <= (i < n ? rule.recovered_angle : rule.recovered_rate));
}

// K from the state start. Returns the outcome, the control periods until it, and with record the path of states.
function recover(s, k, rule, start, record = false) {
  const x = Float64Array.from(start), xbar = Float64Array.from(start), u = new Float64Array(s.masses.length);
  const path = [];
  let outcome = Math.abs(x[0]) >= rule.theta1_max ? HIT_GROUND : 0, periods = 0;
  for (;;) {
    if (record) path.push(Float64Array.from(x));
    if (outcome === 0 && isUpright(rule, x)) outcome = RECOVERED;
    if (outcome === 0 && periods === rule.periods) outcome = NOT_RECOVERED;
    if (outcome !== 0) return { outcome, periods, path };
    lqgUpdate(k, xbar, x, u);
    outcome = holdTorque(s, rule, x, u);
    periods += 1;
  }
}

// An arm of a region, with what the arms share: its mapping and its probabilities.
function armOf(region, name) {
  const { arms, ...shared } = region;
  return { ...shared, ...arms[name] };
}

function scaled(arm, x, j) {
  return Math.min(Math.max(x[j] / arm.scale[j], -arm.far), arm.far);
}

// The training states nearest to x: which they are, the nearest first, and their squared distances.
function nearest(arm, x) {
  const { scale, x_train: states, y_train: places, neighbours } = arm, m = scale.length, k = places.length / 2;
  const sums = (arm.sums ??= new Float64Array(k));
  for (let j = 0, at = 0; j < m; j++) {
    const v = scaled(arm, x, j);
    for (let i = 0; i < k; i++, at++) {
      const d = states[at] - v;
      sums[i] = j > 0 ? sums[i] + d * d : d * d;
    }
  }
  const near = new Int32Array(neighbours).fill(-1), squared = new Float64Array(neighbours).fill(Infinity);
  for (let i = 0; i < k; i++) {
    if (!(sums[i] < squared[neighbours - 1])) continue; // of equal ones the first stays the nearer
    let rank = neighbours - 1;
    for (; rank > 0 && sums[i] < squared[rank - 1]; rank--) {
      squared[rank] = squared[rank - 1];
      near[rank] = near[rank - 1];
    }
    squared[rank] = sums[i];
    near[rank] = i;
  }
  return { near, squared };
}

// The mapping by neighbours: the place y [2] of x, the nearest training states, and their weights, which add up to 1.
function mapState(arm, x) {
  const { near, squared } = nearest(arm, x), { y_train: places } = arm, exact = squared[0] === 0;
  const order = Array.from(near.keys()).sort((p, q) => near[p] - near[q]); // the package adds in this order
  const weights = new Float64Array(near.length), y = [0, 0];
  let total = 0;
  for (const p of order) {
    weights[p] = exact ? Number(squared[p] === 0) : 1 / Math.sqrt(squared[p]);
    y[0] += weights[p] * places[2 * near[p]];
    y[1] += weights[p] * places[2 * near[p] + 1];
    total += weights[p];
  }
  return { y: [y[0] / total, y[1] / total], near, weights: weights.map((w) => w / total) };
}

// The mapping by a network with two hidden layers: the place y [2] of x. Sums run over the units before, in their order.
function applyNetwork(arm, x) {
  const w = arm.network, layer = (inputs, weights, biases) => {
    const out = Float64Array.from(biases), wide = out.length;
    for (let i = 0; i < inputs.length; i++) for (let j = 0; j < wide; j++) out[j] += weights[i * wide + j] * inputs[i];
    return out;
  };
  const rectified = (values) => values.map((v) => Math.max(v, 0));
  const first = layer(arm.scale.map((_, j) => scaled(arm, x, j)), w.first, w.first_bias);
  return Array.from(layer(rectified(layer(rectified(first), w.second, w.second_bias)), w.last, w.last_bias));
}

// The place y [2] of x.
function place(arm, x) {
  return arm.network ? applyNetwork(arm, x) : mapState(arm, x).y;
}

// The probability that the place y is safe, by its cell of the grid.
function lookUp(gamma, y) {
  const i = Math.floor((y[0] - gamma.origin[0]) / gamma.cell), j = Math.floor((y[1] - gamma.origin[1]) / gamma.cell);
  if (i < 0 || j < 0 || i >= gamma.cells || j >= gamma.cells) return gamma.empty;
  return gamma.grid[i * gamma.cells + j];
}

function safety(arm, x) {
  return lookUp(arm.gamma, place(arm, x));
}

// The target at the time t in s.
function target(task, t) {
  const phase = task.circle_speed * t;
  return [task.circle_radius * Math.sin(phase), task.circle_height + task.circle_radius * Math.cos(phase)];
}

// The ends of the links, with the base: n + 1 points [x, height] in m.
function joints(lengths, x) {
  const points = [[0, 0]];
  let angle = 0;
  lengths.forEach((l, i) => {
    angle += x[i];
    points.push([points[i][0] + l * Math.sin(angle), points[i][1] + l * Math.cos(angle)]);
  });
  return points;
}

// What a policy sees: the state in units of the task, sine and cosine of the phase of the target; as in the package
// in single precision, unless another kind of Numbers is given.
function observe(task, x, period, Numbers = Float32Array) {
  const phase = task.circle_speed * (period * task.control_period);
  return Numbers.from([...x.map((v, j) => v / task.scale[j]), Math.sin(phase), Math.cos(phase)]);
}

// The mean action of a policy: a perceptron with tanh between its layers.
function act(policy, observation) {
  let values = Float64Array.from(observation);
  policy.layers.forEach(({ weights, biases }, depth) => {
    const inputs = values, out = Float64Array.from(biases);
    for (let i = 0; i < out.length; i++) {
      let s = 0;
      for (let j = 0; j < inputs.length; j++) s += weights[i * inputs.length + j] * inputs[j];
      s += out[i];
      out[i] = depth < policy.layers.length - 1 ? Math.tanh(s) : s;
    }
    values = out;
  });
  return values;
}

// One control period of a trial, x in place. Returns the reward, and 0 or why the trial ends.
function advance(s, rule, task, x, action, period) {
  const u = action.map((a) => Math.min(Math.max(task.action_unit * a, -task.torque_limit), task.torque_limit));
  let ended = holdTorque(s, rule, x, u);
  const tip = joints(s.lengths, x).at(-1), goal = target(task, (period + 1) * task.control_period);
  const reward = task.reward_constant - task.reward_slope * Math.hypot(tip[0] - goal[0], tip[1] - goal[1]);
  if (ended === 0 && period + 1 >= task.periods) ended = TIME_OVER;
  return { reward, ended };
}

// A trial from start: the policy acts until h(x) = 0, then K does. world: system, k, rule, task, policy, maybe the kind
// of Numbers that it sees; with an arm and p_t there is a supervisor. noise: draws what is added to an action.
function runTrial(world, start, noise = null) {
  const { system, k, rule, task, policy, arm } = world, x = Float64Array.from(start), states = [Float64Array.from(x)];
  const unsafe = () => arm && !(safety(arm, x) > world.p_t);
  let ended = 0, period = 0, total = 0, activated = unsafe() ? 0 : -1;
  while (ended === 0 && activated < 0) {
    const action = act(policy, observe(task, x, period, world.Numbers)), step = noise ? action.map((a, i) => a + noise(i)) : action;
    const done = advance(system, rule, task, x, step, period);
    period += 1;
    total += done.reward;
    ended = done.ended;
    states.push(Float64Array.from(x));
    if ((ended === 0 || ended === TIME_OVER) && unsafe()) activated = period;
  }
  if (activated < 0) return { states, total, periods: period, activated, outcome: ended };
  const recovery = recover(system, k, rule, x, true);
  return { states: states.concat(recovery.path.slice(1)), total, periods: period, activated, outcome: recovery.outcome };
}

// Precision and recall of h on labelled states: of those taken for safe, the safe ones; of the safe ones, those found.
function judge(probabilities, labels, p_t) {
  let found = 0, right = 0, safe = 0;
  probabilities.forEach((p, i) => {
    found += p > p_t;
    safe += labels[i];
    right += p > p_t && labels[i] === 1;
  });
  return { found, safe, precision: found ? right / found : NaN, recall: safe ? right / safe : NaN };
}

// The arrays of the data, which are written in base64, little end first.
function unpack(value) {
  if (Array.isArray(value)) return value.map(unpack);
  if (value === null || typeof value !== "object") return value;
  if ("base64" in value) {
    const bytes = Uint8Array.from(atob(value.base64), (c) => c.charCodeAt(0));
    return new { float64: Float64Array, float32: Float32Array, uint8: Uint8Array }[value.kind](bytes.buffer);
  }
  return Object.fromEntries(Object.entries(value).map(([name, part]) => [name, unpack(part)]));
}

if (typeof module !== "undefined") {
  module.exports = {
    RECOVERED, HIT_GROUND, NOT_RECOVERED, TIME_OVER, systemOf, derivative, rk4Step, recover, armOf, nearest, mapState, place,
    lookUp, safety, target, joints, observe, act, advance, runTrial, judge, unpack,
  };
}
