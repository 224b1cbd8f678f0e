// Time, buttons, numbers, and what scripts may ask of the page.

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const several = data.takes.length > 1;
const many = data.takes.length > SIX; // runs stand in rows, and the table has a row for each
const walkers = data.takes.map((told, k) => new Walker(told, k));
const longest = walkers.reduce((a, b) => (b.duration > a.duration ? b : a));
// Loops never end; what is no loop stands at its end until the longest motion is over, and all begin again.
const span = walkers.every((walker) => walker.told.loop) ? Infinity : longest.duration;
const state = {
  time: 0, playing: false, follow: true, bones: false, overlaid: several && data.together === "overlaid",
  // Runs of different speeds would leave each other behind.
  spot: many || several && walkers.some((walker) => walker.told.loop),
  turn: 0, // rad from +z towards +x, of where many bodies are looked at from
  chosen: 4, // m from which the view was last set to show all
};
const CELL = 1.7; // m across of each of many bodies
const DEEP = 4.4; // m from one of their rows to the next
const HIGH = 0.45; // rad above the ground from where they are looked at, at least
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

// How many of many bodies stand in a row: as many as fill the picture.
function columns() {
  const { clientWidth: width, clientHeight: height } = element("view");
  const seen = (count) => {
    const rows = Math.ceil(walkers.length / count);
    const tall = 1.9 + (rows - 1) * DEEP * Math.sin(HIGH);
    return Math.min(width / (count * CELL), 0.9 * height / tall);
  };
  return walkers.map((_, k) => k + 1).reduce((best, count) => (seen(count) > seen(best) ? count : best), 1);
}

// Rows one behind the other for who looks at them, the first at the back.
function rows() {
  const count = columns();
  const last = Math.ceil(walkers.length / count) - 1;
  return walkers.map((_, k) => {
    const row = Math.floor(k / count);
    return turned(state.turn, (k % count - 0.5 * (count - 1)) * CELL, (row - 0.5 * last) * DEEP);
  });
}

// Bodies next to each other start in a row across the way of the first, far enough apart for their ways.
function lanes() {
  if (many && state.spot && !state.overlaid) return rows();
  const heading = state.spot ? 0 : walkers[0].heading[0];
  const widths = walkers.map((walker) => {
    if (state.spot) return LANE;
    const { start, way } = walker;
    let [least, most] = [0, 0];
    for (let k = 0; k < way.length; k += 2) {
      const [across] = turned(-heading, way[k] - start[0], way[k + 1] - start[1]);
      [least, most] = [Math.min(least, across), Math.max(most, across)];
    }
    return Math.min(LANE + most - least, WIDEST);
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
    walker.bare = many;
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
  if (many && state.spot && !state.overlaid) {
    // Rows stay where they are, whatever is shown of them.
    stage.orbit.point.set(0, stage.orbit.point.y, 0);
    stage.orbit.back = 0;
    return;
  }
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
  stage.move(playing);
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
  if (many && apart && state.spot) {
    resetRows(view);
    return;
  }
  stage.orbit.zoomed(ROUND);
  const heading = apart && !state.spot ? walkers[0].heading[0] : walkers[0].faces;
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

function resetRows(view) {
  const [yaw, pitch] = VIEWS[view || "row"];
  stage.orbit.zoomed(FLAT);
  const steep = Math.max(pitch, HIGH);
  state.turn = view === "top" ? 0 : yaw;
  pose();
  const count = columns();
  const deep = (Math.ceil(walkers.length / count) - 1) * DEEP;
  const tall = 2.1 + deep * Math.sin(steep);
  state.chosen = stage.distanceFor(count * CELL, tall) + 0.2 * deep * Math.cos(steep);
  stage.orbit.distance = state.chosen;
  stage.orbit.from(view === "top" ? 0 : yaw, steep);
  aim();
}

function listen() {
  element("play").addEventListener("click", () => setPlaying(!state.playing));
  new ResizeObserver(() => { if (many && state.spot) reset(); }).observe(element("view"));
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
      if (now - last < 500) stage.timed((now - last) / 1000);
      state.time += Math.min((now - last) / 1000, 0.25) * Number(element("speed").value);
      if (state.time > span) state.time %= span || 1;
      pose();
    }
    if (stage.dirty) {
      if (state.follow) aim();
      stage.draw(names);
      page.drawn += 1;
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
  drawn: 0, // pictures so far
  play: () => setPlaying(true),
  pause: () => setPlaying(false),
  positions: (k = 0) => walkers[k].positions(),
};
window.hopdiff = page;

table();
element("overlay").hidden = !several;
document.body.classList.toggle("many", many);
Promise.all(data.bodies.map(read)).then((bodies) => {
  const plain = bySoftware();
  walkers.forEach((walker) => walker.embody(bodies[walker.told.body].scene, plain));
  try {
    stage = new Stage(element("canvas"), walkers);
  } catch (error) {
    trouble("This browser shows no 3D graphics (WebGL), so the motion cannot be drawn.");
    return;
  }
  names = several ? walkers.map((walker, k) => {
    const name = element("names").appendChild(document.createElement("span"));
    name.append(many ? `${k + 1} ` : walker.told.name);
    if (many) name.appendChild(document.createElement("span")).textContent = walker.told.name;
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
