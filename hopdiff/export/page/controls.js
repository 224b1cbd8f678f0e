// Time, buttons, numbers, and what scripts may ask of the page.

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const several = data.takes.length > 1;
const walkers = data.takes.map((told, k) => new Walker(told, k));
const longest = walkers.reduce((a, b) => (b.duration > a.duration ? b : a));
// Loops never end; what is no loop begins again when the last of them is over.
const ends = walkers.filter((walker) => !walker.told.loop).map((walker) => walker.duration);
const span = ends.length ? Math.max(...ends) : Infinity;
const state = {
  time: 0, playing: false, follow: true, bones: false, overlaid: several && data.together === "overlaid",
  // Runs of different speeds would leave each other behind.
  spot: several && walkers.every((walker) => walker.told.loop),
};
const LANE = 1.3; // m between bodies next to each other
const WIDEST = 4; // m between those whose ways go aside
let stage = null;
let names = [];

function trouble(text) {
  const place = element("trouble");
  place.textContent = text;
  place.hidden = false;
}

// Bodies next to each other start in a row across the way of the first, far enough apart for their ways.
function lanes() {
  const heading = walkers[0].told.heading[0];
  const widths = walkers.map((walker) => {
    if (state.spot) return LANE;
    const start = walker.told.way[0];
    const across = walker.told.way.map(([x, z]) => turned(-heading, x - start[0], z - start[1])[0]);
    return Math.min(LANE + Math.max(...across) - Math.min(...across), WIDEST);
  });
  const total = widths.reduce((a, b) => a + b, 0);
  // The first on the left of who sees them come: on their own right.
  let from = -0.5 * total;
  return walkers.map((walker, k) => {
    if (state.overlaid) return [0, 0];
    from += widths[k];
    return turned(heading, from - 0.5 * widths[k], 0);
  });
}

function pose() {
  const places = lanes();
  walkers.forEach((walker, k) => {
    walker.bared = state.bones;
    walker.overlaid = state.overlaid;
    walker.pose(state.time, state.spot, places[k], several && !state.overlaid);
  });
  const seen = walkers.filter((walker) => walker.visible);
  if (state.follow && seen.length) {
    const middle = seen.reduce((sum, walker) => sum.add(walker.centre), new THREE.Vector3()).divideScalar(seen.length);
    stage.orbit.point.set(middle.x, 0.52 * Math.max(...seen.map((walker) => walker.told.height)), middle.z);
  }
  const frame = frameNow();
  element("frame").value = frame;
  element("frame").setAttribute("aria-valuetext", `frame ${frame}`);
  const own = longest.frame * longest.told.frameTime;
  element("now").textContent = `frame ${frame} / ${longest.told.frames - 1}   ${own.toFixed(2)} s`;
  stage.dirty = true;
}

function frameNow() {
  return Math.round(longest.frame);
}

// Of the longest motion; all others are as far in time.
function setFrame(frame) {
  const last = longest.told.frames - 1;
  state.time = Math.min(Math.max(Math.round(frame), 0), last) * longest.told.frameTime;
  pose();
}

function setPlaying(playing) {
  state.playing = playing;
  element("play").textContent = playing ? "Pause" : "Play";
  element("play").setAttribute("aria-pressed", String(playing));
}

function toggle(name, value) {
  state[name] = value;
  const button = element({ overlaid: "overlay" }[name] || name);
  button.setAttribute("aria-pressed", String(value));
  if (name === "overlaid") walkers.forEach((walker) => walker.paint(value));
  if (name === "overlaid" || name === "spot") reset();
  pose();
}

// Yaws are from the heading of the first body: its left is at +90 degrees.
const VIEWS = { side: [Math.PI / 2, 0.08], front: [0, 0.1], three: [0.75, 0.22], top: [Math.PI, 1.5], row: [0.4, 0.2] };

function reset(view) {
  const heading = state.spot ? 0 : walkers[0].told.heading[0];
  const apart = walkers.length > 1 && !state.overlaid;
  const ends = lanes();
  const wide = 1.6 + Math.hypot(ends[0][0] - ends[ends.length - 1][0], ends[0][1] - ends[ends.length - 1][1]);
  const tall = Math.max(...walkers.map((walker) => walker.told.height));
  stage.orbit.distance = stage.distanceFor(view === "side" ? Math.max(1.6, 0.6 * wide) : wide, tall);
  // A row is seen more from ahead, so that its bodies do not hide each other.
  const [yaw, pitch] = VIEWS[view || (apart ? "row" : "three")];
  stage.orbit.from(heading + yaw, pitch);
}

function cell(row, text, kind, tag = "td") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (kind) made.className = kind;
  row.append(made);
  return made;
}

// Rows of all motions by what they tell, a column for each.
function fill(body, key) {
  const rows = new Map();
  data.takes.forEach((told, k) => {
    for (const [what, value, unit] of told[key]) {
      if (!rows.has(what)) rows.set(what, { unit, values: data.takes.map(() => "–") });
      rows.get(what).values[k] = value;
    }
  });
  for (const [what, { unit, values }] of rows) {
    const row = body.insertRow();
    if (new Set(values).size > 1) row.className = "differs";
    cell(row, what);
    for (const value of values) cell(row, value);
    cell(row, unit, "unit");
  }
  return rows.size;
}

function table() {
  const head = element("numbers").tHead.insertRow();
  cell(head, "", "", "th");
  walkers.forEach((walker) => {
    const place = cell(head, "", "", "th");
    const title = several ? document.createElement("button") : document.createElement("span");
    if (several) {
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = walker.tint;
      title.type = "button";
      title.setAttribute("aria-pressed", "true");
      title.title = "Show or hide";
      title.append(swatch);
      title.addEventListener("click", () => {
        walker.visible = !walker.visible;
        title.setAttribute("aria-pressed", String(walker.visible));
        pose();
      });
    }
    // Long names are broken where they have a joint.
    title.append(walker.told.name.replace(/_/g, "_\u200b"));
    place.append(title);
  });
  cell(head, "", "", "th");
  fill(element("numbers").tBodies[0], "shown");
  element("more").hidden = !fill(element("more").querySelector("tbody"), "more");
}

function listen() {
  element("play").addEventListener("click", () => setPlaying(!state.playing));
  element("frame").max = longest.told.frames - 1;
  element("frame").addEventListener("input", (event) => {
    setPlaying(false);
    setFrame(Number(event.target.value));
  });
  for (const [id, name] of [["follow", "follow"], ["spot", "spot"], ["bones", "bones"], ["overlay", "overlaid"]]) {
    element(id).addEventListener("click", () => toggle(name, !state[name]));
  }
  for (const button of document.querySelectorAll("[data-view]")) {
    button.addEventListener("click", () => { reset(button.dataset.view); pose(); });
  }
  const keys = {
    " ": () => setPlaying(!state.playing),
    ArrowLeft: () => { setPlaying(false); setFrame(frameNow() - 1); },
    ArrowRight: () => { setPlaying(false); setFrame(frameNow() + 1); },
    Home: () => setFrame(0),
    End: () => setFrame(longest.told.frames - 1),
    f: () => toggle("follow", !state.follow),
    s: () => toggle("spot", !state.spot),
    b: () => toggle("bones", !state.bones),
    o: () => { if (several) toggle("overlaid", !state.overlaid); },
  };
  document.addEventListener("keydown", (event) => {
    const own = event.target.matches("select, input") || (event.key === " " && event.target.matches("button, summary"));
    if (own || event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
}

function run(last) {
  requestAnimationFrame((now) => {
    if (state.playing) {
      // A page that was out of sight goes on where it stopped.
      state.time += Math.min((now - last) / 1000, 0.25) * Number(element("speed").value);
      if (state.time > span) state.time %= span || 1;
      pose();
    }
    if (stage.dirty) stage.draw(names);
    run(now);
  });
}

const page = {
  ready: false,
  frames: longest.told.frames,
  get frame() { return frameNow(); },
  get playing() { return state.playing; },
  setFrame,
  play: () => setPlaying(true),
  pause: () => setPlaying(false),
  positions: (k = 0) => walkers[k].positions(),
};
window.hopdiff = page;

table();
Promise.all(walkers.map((walker) => walker.load())).then(() => {
  try {
    stage = new Stage(element("canvas"), walkers);
  } catch (error) {
    trouble("This browser shows no 3D graphics (WebGL), so the motion cannot be drawn.");
    return;
  }
  names = several ? walkers.map((walker) => {
    const name = element("names").appendChild(document.createElement("span"));
    name.textContent = walker.told.name;
    return name;
  }) : [];
  element("overlay").hidden = !several;
  listen();
  for (const name of ["follow", "spot", "bones", "overlaid"]) toggle(name, state[name]);
  reset();
  pose();
  stage.draw(names);
  setPlaying(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  page.ready = true;
  run(performance.now());
}, (error) => trouble(`The motion cannot be read: ${error.message}`));
