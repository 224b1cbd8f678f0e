// Time, buttons, numbers, and what scripts may ask of the page.

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const several = data.takes.length > 1;
const walkers = data.takes.map((told, k) => new Walker(told, k));
const longest = walkers.reduce((a, b) => (b.duration > a.duration ? b : a));
// Loops never end; what is no loop stands at its end until the longest motion is over, and all begin again.
const span = walkers.every((walker) => walker.told.loop) ? Infinity : longest.duration;
const state = {
  time: 0, playing: false, follow: true, bones: false, overlaid: several && data.together === "overlaid",
  // Runs of different speeds would leave each other behind.
  spot: several && walkers.some((walker) => walker.told.loop),
  chosen: 4, // m from which the view was last set to show all
};
const ROOM = 1.6; // m across that a body takes
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
  const heading = state.spot ? 0 : walkers[0].told.heading[0];
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
  const frame = frameNow();
  element("frame").value = frame;
  element("frame").setAttribute("aria-valuetext", `frame ${frame}`);
  const own = longest.frame * longest.told.frameTime;
  element("now").textContent = `frame ${frame} / ${longest.told.frames - 1}   ${own.toFixed(2)} s`;
  stage.dirty = true;
}

// The view to the middle of all bodies that are shown, far enough off for those that left each other behind.
function aim() {
  const seen = walkers.filter((walker) => walker.visible);
  if (!seen.length) return;
  const middle = seen.reduce((sum, walker) => sum.add(walker.centre), new THREE.Vector3()).divideScalar(seen.length);
  stage.orbit.point.set(middle.x, 0.52 * Math.max(...seen.map((walker) => walker.told.height)), middle.z);
  const needed = seen.map((walker) => {
    const [aside, nearer] = turned(-stage.orbit.yaw, walker.centre.x - middle.x, walker.centre.z - middle.z);
    return stage.distanceFor(ROOM + 2 * Math.abs(aside), 0) + Math.max(0, nearer);
  });
  stage.orbit.back = Math.max(0, Math.max(...needed) - state.chosen);
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
}

function toggle(name, value) {
  state[name] = value;
  const button = element({ overlaid: "overlay" }[name] || name);
  button.setAttribute("aria-pressed", String(value));
  if (name === "overlaid") walkers.forEach((walker) => walker.paint(value));
  pose();
  if (name === "overlaid" || name === "spot") reset();
}

// Yaws are from where the first body heads, of a row from where it began to: its left is at +90 degrees.
const VIEWS = { side: [Math.PI / 2, 0.08], front: [0, 0.1], three: [0.75, 0.22], top: [Math.PI, 1.5], row: [0.4, 0.2] };

function reset(view) {
  const apart = several && !state.overlaid;
  const heading = apart && !state.spot ? walkers[0].told.heading[0] : walkers[0].heading;
  const ends = lanes();
  const wide = ROOM + Math.hypot(ends[0][0] - ends[ends.length - 1][0], ends[0][1] - ends[ends.length - 1][1]);
  const tall = Math.max(...walkers.map((walker) => walker.told.height));
  state.chosen = stage.distanceFor(view === "side" ? Math.max(ROOM, 0.6 * wide) : wide, tall);
  stage.orbit.distance = state.chosen;
  // A row is seen more from ahead, so that its bodies do not hide each other.
  const [yaw, pitch] = VIEWS[view || (apart ? "row" : "three")];
  stage.orbit.from(heading + yaw, pitch);
  aim();
}

function cell(row, text, kind, tag = "td") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (kind) made.className = kind;
  row.append(made);
  return made;
}

// Rows of all motions by what they tell, a column for each, in the order of the motion of which most is known.
function fill(body, key) {
  const rows = new Map();
  for (const told of [...data.takes].sort((a, b) => b[key].length - a[key].length)) {
    for (const [what, value, unit] of told[key]) {
      if (!rows.has(what)) rows.set(what, { unit, values: data.takes.map(() => "–") });
      rows.get(what).values[data.takes.indexOf(told)] = value;
    }
  }
  for (const [what, { unit, values }] of rows) {
    const row = body.insertRow();
    if (new Set(values.filter((value) => value !== "–")).size > 1) row.className = "differs";
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
    button.addEventListener("click", () => reset(button.dataset.view));
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
    // Space is of no use to the slider.
    const own = event.target.matches(event.key === " " ? "select, button, summary" : "select, input");
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
    if (stage.dirty) {
      if (state.follow) aim();
      stage.draw(names);
    }
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
element("overlay").hidden = !several;
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
  listen();
  for (const name of ["follow", "spot", "bones", "overlaid"]) toggle(name, state[name]);
  reset();
  pose();
  stage.draw(names);
  setPlaying(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  page.ready = true;
  run(performance.now());
}, (error) => trouble(`The motion cannot be read: ${error.message}`));
