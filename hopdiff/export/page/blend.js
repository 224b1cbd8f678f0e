// Clips on a grid of speed, briskness and turn, blended at one phase where the point of the pad is.

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const VIEWS = { side: [Math.PI / 2, 0.08], front: [0, 0.1], three: [0.75, 0.22], top: [Math.PI, 1.5] };
const PAD = { left: 44, right: 286, top: 14, bottom: 212 };
const middle = (line) => 0.5 * (line[0] + line[line.length - 1]);
const LINES = { speed: data.speeds, beta: data.betas, turn: data.turns };
const state = {
  phase: 0, distance: 0, heading: 0, place: [0, 0], playing: false, rate: 1,
  speed: middle(data.speeds), beta: middle(data.betas), turn: middle(data.turns),
};

// The shares of two neighbours on a line of the grid, as [number, share].
function shares(line, value) {
  if (value <= line[0]) return [[0, 1]];
  const next = line.findIndex((other) => other >= value);
  if (next < 0) return [[line.length - 1, 1]];
  const share = (value - line[next - 1]) / (line[next] - line[next - 1]);
  return [[next - 1, 1 - share], [next, share]];
}

// A weight for each clip; of a cell that lacks clips those that are there share it.
function weights() {
  const found = data.clips.map(() => 0);
  for (const [i, alongSpeed] of shares(data.speeds, state.speed)) {
    for (const [k, alongBeta] of shares(data.betas, state.beta)) {
      for (const [m, alongTurn] of shares(data.turns, state.turn)) {
        const clip = data.clips.findIndex((one) =>
          one.speed === data.speeds[i] && one.beta === data.betas[k] && one.turn === data.turns[m]);
        if (clip >= 0) found[clip] += alongSpeed * alongBeta * alongTurn;
      }
    }
  }
  const total = found.reduce((a, b) => a + b, 0);
  if (total > 1e-9) return found.map((weight) => weight / total);
  // Beside a crossing without a clip: the nearest one.
  const wide = (line) => line[line.length - 1] - line[0] || 1;
  const far = data.clips.map((one) =>
    Math.hypot(...Object.entries(LINES).map(([name, line]) => (one[name] - state[name]) / wide(line))));
  return far.map((value) => (value === Math.min(...far) ? 1 : 0));
}

class Runner {
  constructor(told) {
    this.told = told;
    this.group = new THREE.Group();
    this.skeleton = new THREE.Group(); // bones are not shown here
    this.skeleton.material = { color: null };
    this.visible = true;
    this.centre = new THREE.Vector3();
  }

  load() {
    const bytes = Uint8Array.from(atob(this.told.glb), (letter) => letter.charCodeAt(0));
    return new Promise((resolve, reject) => new THREE.GLTFLoader().parse(bytes.buffer, "", resolve, reject)).then((file) => {
      this.scene = file.scene;
      const bones = [];
      this.scene.traverse((thing) => {
        if (thing.isBone) bones.push(thing);
        if (!thing.isMesh) return;
        thing.frustumCulled = false;
        thing.castShadow = true;
      });
      const plain = (name) => THREE.PropertyBinding.sanitizeNodeName(name);
      this.bones = this.told.joints.map((name) => bones.find((bone) => bone.name === plain(name)));
      this.mixer = new THREE.AnimationMixer(this.scene);
      this.actions = file.animations.map((clip) => {
        const action = this.mixer.clipAction(clip);
        action.play();
        action.paused = true;
        return action;
      });
      this.group.add(this.scene);
    });
  }

  pose(phase, shared, [x, z], heading) {
    this.actions.forEach((action, k) => {
      action.enabled = shared[k] > 0;
      action.setEffectiveWeight(shared[k]);
      // Not quite at the end, which would be the beginning.
      action.time = Math.min(phase, 1 - 1e-6) * action.getClip().duration;
    });
    this.mixer.update(0);
    this.group.position.set(x, 0, z);
    this.group.rotation.y = heading;
    this.centre.set(x, 0, z);
    this.group.updateMatrixWorld(true);
  }

  // Where joints are against the way [m].
  positions() {
    const back = this.group.matrixWorld.clone().invert();
    return this.bones.map((bone) => new THREE.Vector3().setFromMatrixPosition(bone.matrixWorld).applyMatrix4(back).toArray());
  }
}

const runner = new Runner(data.body);
let stage = null;

function blended() {
  const shared = weights();
  const mean = (entry) => data.clips.reduce((sum, clip, k) => sum + shared[k] * clip[entry], 0);
  // By how much a stride turns [rad].
  const angle = data.clips.reduce((sum, clip, k) => sum + shared[k] * clip.turn * clip.stride_time, 0) * Math.PI / 180;
  return { shared, time: mean("stride_time"), length: mean("stride_length"), angle };
}

// On along the way by a share of a stride.
function advance(share) {
  const { length, angle } = blended();
  const middle = state.heading + 0.5 * share * angle;
  state.place = [state.place[0] + share * length * Math.sin(middle), state.place[1] + share * length * Math.cos(middle)];
  state.heading += share * angle;
  state.distance += share * length;
}

function show() {
  const now = blended();
  runner.pose(state.phase, now.shared, state.place, state.heading);
  stage.orbit.point.set(state.place[0], 0.52 * data.body.height, state.place[1]);
  stage.dirty = true;
  element("frame").value = state.phase;
  element("now").textContent = `phase ${state.phase.toFixed(2)}   ${(state.phase * now.time).toFixed(2)} s`;
  for (const name of Object.keys(LINES)) element(name).value = state[name];
  element("speed_now").textContent = `${state.speed.toFixed(2)} m/s`;
  element("beta_now").textContent = state.beta.toFixed(2);
  element("turn_now").textContent = `${state.turn.toFixed(0)} °/s`;
  const rows = [
    ["Moves at", `${(now.length / now.time).toFixed(2)} m/s`],
    ["Stride", `${now.time.toFixed(3)} s, ${now.length.toFixed(2)} m`],
    ["Steps", `${(2 / now.time).toFixed(2)} /s`],
    ...data.clips.map((clip, k) => [clip.name, now.shared[k]]).filter((row) => row[1] > 0)
      .map(([name, share]) => [name, `${(100 * share).toFixed(0)} %`]),
  ];
  element("numbers").tBodies[0].replaceChildren(...rows.map((row) => {
    const line = document.createElement("tr");
    line.append(...row.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    return line;
  }));
  drawPoint(now.shared);
}

function drawn(kind, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  element("pad").append(made);
  return made;
}

const along = (line, value) => (line.length > 1 ? (value - line[0]) / (line[line.length - 1] - line[0]) : 0.5);
const toPad = (speed, beta) => [
  PAD.left + along(data.speeds, speed) * (PAD.right - PAD.left),
  PAD.bottom - along(data.betas, beta) * (PAD.bottom - PAD.top),
];
let dots = [];
let point = null;

function drawPad() {
  for (const speed of data.speeds) {
    const [x] = toPad(speed, data.betas[0]);
    drawn("line", { class: "cell", x1: x, x2: x, y1: PAD.top, y2: PAD.bottom });
    drawn("text", { x, y: PAD.bottom + 16, "text-anchor": "middle" }, speed.toFixed(2).replace(/\.?0+$/, ""));
  }
  for (const beta of data.betas) {
    const [, y] = toPad(data.speeds[0], beta);
    drawn("line", { class: "cell", x1: PAD.left, x2: PAD.right, y1: y, y2: y });
    drawn("text", { x: PAD.left - 8, y: y + 4, "text-anchor": "end" }, beta.toFixed(2).replace(/0$/, ""));
  }
  drawn("text", { x: 0.5 * (PAD.left + PAD.right), y: PAD.bottom + 33, "text-anchor": "middle" }, "speed, m/s");
  const half = 0.5 * (PAD.top + PAD.bottom);
  drawn("text", { x: 10, y: half, "text-anchor": "middle", transform: `rotate(-90 10 ${half})` }, "briskness β");
  // The pad is that of one turn; where a clip of any turn is there, the crossing has its dot.
  for (const { speed, beta } of data.missing) {
    if (data.clips.some((clip) => clip.speed === speed && clip.beta === beta)) continue;
    const [cx, cy] = toPad(speed, beta);
    drawn("circle", { class: "missing", cx, cy, r: 5 });
  }
  dots = data.clips.map((clip) => {
    const [cx, cy] = toPad(clip.speed, clip.beta);
    return drawn("circle", { class: "clip", cx, cy, r: 5 });
  });
  point = drawn("circle", { class: "point", r: 10 });
}

function drawPoint(shared) {
  const [x, y] = toPad(state.speed, state.beta);
  point.setAttribute("cx", x);
  point.setAttribute("cy", y);
  dots.forEach((dot, k) => dot.classList.toggle("used", shared[k] > 0.005));
}

function choose(speed, beta, turn = state.turn) {
  const inside = (line, value) => Math.min(Math.max(value, line[0]), line[line.length - 1]);
  state.speed = inside(data.speeds, speed);
  state.beta = inside(data.betas, beta);
  state.turn = inside(data.turns, turn);
  show();
}

function dragged(event) {
  const pad = element("pad");
  const here = new DOMPoint(event.clientX, event.clientY).matrixTransform(pad.getScreenCTM().inverse());
  const at = (line, share) => line[0] + share * (line[line.length - 1] - line[0]);
  choose(
    at(data.speeds, (here.x - PAD.left) / (PAD.right - PAD.left)),
    at(data.betas, (PAD.bottom - here.y) / (PAD.bottom - PAD.top)),
  );
}

function setPlaying(playing) {
  state.playing = playing;
  stage.move(playing);
  element("play").textContent = playing ? "Pause" : "Play";
}

function setPhase(phase) {
  advance(phase - state.phase);
  state.phase = phase;
  show();
}

function reset(view) {
  stage.orbit.distance = stage.distanceFor(1.6, data.body.height);
  const [yaw, pitch] = VIEWS[view];
  stage.orbit.from(state.heading + yaw, pitch);
}

function listen() {
  const pad = element("pad");
  pad.addEventListener("pointerdown", (event) => { pad.setPointerCapture(event.pointerId); dragged(event); });
  pad.addEventListener("pointermove", (event) => { if (pad.hasPointerCapture(event.pointerId)) dragged(event); });
  element("turning").hidden = data.turns.length < 2;
  for (const [name, line] of Object.entries(LINES)) {
    const slider = element(name);
    slider.min = line[0];
    slider.max = line[line.length - 1];
    slider.disabled = line.length < 2;
    slider.addEventListener("input", () => choose(...Object.keys(LINES).map((one) => (one === name ? Number(slider.value) : state[one]))));
  }
  element("frame").addEventListener("input", () => { setPlaying(false); setPhase(Number(element("frame").value)); });
  element("play").addEventListener("click", () => setPlaying(!state.playing));
  element("rate").addEventListener("change", () => { state.rate = Number(element("rate").value); });
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => reset(button.dataset.view));
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || event.target.closest("button, select")) return;
    event.preventDefault();
    setPlaying(!state.playing);
  });
}

let before = null;
function tick(now) {
  const gap = before === null ? 0 : (now - before) / 1000;
  const passed = Math.min(0.1, gap);
  before = now;
  if (state.playing) {
    // A page that was out of sight goes on where it stopped.
    if (gap > 0 && gap < 0.5) stage.timed(gap);
    const gone = state.rate * passed / blended().time;
    advance(gone);
    state.phase = (state.phase + gone) % 1;
    show();
  }
  if (stage.dirty) stage.draw([]);
  requestAnimationFrame(tick);
}

function trouble(error) {
  element("trouble").textContent = `The motion cannot be shown here: ${error.message || error}`;
  element("trouble").hidden = false;
}

window.hopdiff = {
  ready: false,
  get playing() { return state.playing; },
  get phase() { return state.phase; },
  get distance() { return state.distance; },
  get heading() { return state.heading; },
  get weights() { return weights(); },
  choose,
  pause() { setPlaying(false); },
  setPhase,
  positions() { return runner.positions(); },
};

runner.load().then(() => {
  stage = new Stage(element("canvas"), [runner]);
  drawPad();
  listen();
  show();
  reset("three");
  setPlaying(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  requestAnimationFrame(tick);
  window.hopdiff.ready = true;
}).catch(trouble);
