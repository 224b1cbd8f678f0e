// The ground, the light, and the picture of all bodies.

const GRID = 50; // m to every side
const PIECE = 5; // m
const SHADE = 2.4; // m around a body in which its shadow falls
const LEAST = 0.5; // pixels of the picture in one of the screen while it moves, without a graphics card
const FEW = 24; // frames a second below which the picture becomes coarser
const SIX = 6; // motions that have a column each in the table, and shadows while they move; of more each has a row
const COUNTED = 12; // frames that are timed for that

// Whether the browser draws by program, without a graphics card.
function bySoftware() {
  const context = document.createElement("canvas").getContext("webgl");
  const told = context && context.getExtension("WEBGL_debug_renderer_info");
  const name = told ? context.getParameter(told.UNMASKED_RENDERER_WEBGL) : "";
  if (context && context.getExtension("WEBGL_lose_context")) context.getExtension("WEBGL_lose_context").loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

class Stage {
  constructor(canvas, walkers) {
    this.canvas = canvas;
    this.walkers = walkers;
    this.software = bySoftware();
    this.moving = false;
    this.coarse = this.software ? 0.7 : 1; // of the pixels a still picture has, along a side, while it moves
    this.times = [];
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.software });
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = this.software ? THREE.PCFShadowMap : THREE.PCFSoftShadowMap;
    this.scene = new THREE.Scene();
    this.dirty = true;
    this.orbit = new Orbit(canvas, () => { this.dirty = true; });
    // What faces up gets all of its colour, and no more.
    this.sun = new THREE.DirectionalLight(0xffffff, 0.62);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.setScalar(this.software ? 1024 : 2048);
    this.sun.shadow.radius = 4;
    this.sun.shadow.bias = -0.0005;
    this.sun.shadow.normalBias = 0.01;
    this.scene.add(this.sun, this.sun.target, new THREE.HemisphereLight(0xffffff, 0x9a9fa9, 0.5));
    // Behind what lies on it.
    const behind = (units) => ({ polygonOffset: true, polygonOffsetFactor: units, polygonOffsetUnits: units });
    const flat = new THREE.PlaneGeometry(1, 1).rotateX(-Math.PI / 2);
    this.floor = new THREE.Mesh(flat, new THREE.MeshBasicMaterial(behind(3)));
    this.floor.scale.setScalar(400);
    // Looking up shadows takes longest: only where some may be.
    this.shade = new THREE.Mesh(flat, new THREE.ShadowMaterial({ opacity: 0.3, depthWrite: false, ...behind(2) }));
    this.shade.receiveShadow = true;
    this.scene.add(this.floor, this.shade);
    this.world = new THREE.Group();
    this.world.add(...walkers.map((walker) => walker.group));
    this.scene.add(this.world, ...walkers.map((walker) => walker.skeleton));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.colours());
    const watch = new ResizeObserver(() => this.fit());
    for (const part of [canvas.parentElement, document.getElementById("views")]) watch.observe(part);
    this.colours();
    this.fit();
  }

  colours() {
    const style = getComputedStyle(document.documentElement);
    const named = (name) => colour(style.getPropertyValue(name).trim());
    // Background and fog are shown as they are given, all else is reckoned with as light.
    this.scene.background = new THREE.Color(style.getPropertyValue("--sky").trim());
    this.scene.fog = new THREE.Fog(this.scene.background, 12, 60);
    this.floor.material.color = named("--floor");
    if (this.grid) this.scene.remove(this.grid);
    this.grid = grid(named("--grid"));
    this.grid.position.y = 0.002;
    for (const walker of this.walkers) walker.skeleton.material.color = named("--ink");
    this.scene.add(this.grid);
    this.dirty = true;
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.sharpen();
    this.renderer.setSize(width, height, false);
    // Buttons lie on the picture: bodies are shown in what they leave free.
    const views = document.getElementById("views");
    const above = Math.min(views.offsetTop + views.offsetHeight, 0.5 * height);
    this.free = 1 - above / height;
    this.orbit.camera.setViewOffset(width, height, 0, -0.5 * above, width, height);
    this.dirty = true;
  }

  sharpen() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2) * (this.moving ? this.coarse : 1);
    if (ratio !== this.renderer.getPixelRatio()) this.renderer.setPixelRatio(ratio);
  }

  // A picture that moves may be coarser than a still one, and is where it would come too slowly.
  move(moving) {
    this.moving = moving;
    this.times = [];
    this.sharpen();
    this.dirty = true;
  }

  // seconds: since the frame before.
  timed(seconds) {
    this.times.push(seconds);
    if (this.times.length < COUNTED) return;
    const middle = this.times.sort((a, b) => a - b)[COUNTED >> 1];
    this.times = [];
    const least = this.software ? LEAST : Math.min(1, 1 / (window.devicePixelRatio || 1));
    if (middle < 1 / FEW || this.coarse <= least) return;
    this.coarse = Math.max(least, 0.8 * this.coarse);
    this.sharpen();
  }

  // Half the height of the picture in its distance.
  get half() {
    return Math.tan(0.5 * THREE.MathUtils.degToRad(this.orbit.camera.fov));
  }

  // As far off as shows a row of bodies this wide and this tall [m].
  distanceFor(wide, tall) {
    const half = this.half;
    return Math.max(0.58 * tall / (half * this.free), 0.5 * wide / (half * this.orbit.camera.aspect)) + 0.5;
  }

  draw(names) {
    const target = this.orbit.place();
    const away = this.orbit.away;
    // The world comes to the view, by whole cells of its grid: graphics cards reckon too coarsely far from zero, and so
    // the ground has no end.
    const cells = target.clone().round().setY(0);
    this.world.position.copy(cells).negate();
    this.orbit.camera.position.sub(cells);
    this.orbit.camera.updateMatrixWorld();
    target.sub(cells);
    this.floor.position.set(target.x, 0, target.z);
    const seen = this.walkers.filter((walker) => walker.visible);
    const off = (axis) => Math.max(0, ...seen.map((walker) => Math.abs(walker.centre[axis] - cells[axis] - target[axis])));
    // No more than is in the picture, of bodies that left each other.
    const reach = Math.min(SHADE + Math.max(off("x"), off("z")), Math.max(3, 1.9 * away * this.half));
    const high = Math.max(1, reach / 3);
    this.shade.position.copy(this.floor.position);
    this.shade.scale.setScalar(2 * reach);
    // Where all is drawn by program, shadows of what moves come half as often, and those of many not at all.
    const slow = this.software && this.moving;
    this.shade.visible = !slow || this.walkers.length <= SIX;
    this.turn = !this.turn;
    this.renderer.shadowMap.autoUpdate = !slow;
    this.renderer.shadowMap.needsUpdate = slow && this.shade.visible && this.turn;
    this.sun.target.position.set(target.x, 0, target.z);
    this.sun.position.set(target.x + 4 * high, 9 * high, target.z + 3 * high);
    const box = this.sun.shadow.camera;
    Object.assign(box, { left: -reach, right: reach, top: reach, bottom: -reach, near: 1, far: 30 * high });
    box.updateProjectionMatrix();
    // Ends before the grid does.
    this.scene.fog.near = Math.min(8 + 2 * away, 20 + away);
    this.scene.fog.far = Math.min(30 + 5 * away, 0.9 * GRID + away);
    this.renderer.render(this.scene, this.orbit.camera);
    this.walkers.forEach((walker, k) => {
      if (!names[k]) return;
      const head = walker.centre.clone().sub(cells).setY(walker.told.height + 0.18).project(this.orbit.camera);
      names[k].classList.toggle("marked", walker.marked);
      names[k].hidden = !walker.visible || walker.overlaid || head.z > 1 || Math.abs(head.x) > 1.1;
      names[k].style.zIndex = Math.round(1000 * (1 - head.z));
      names[k].style.left = `${50 + 50 * head.x}%`;
      names[k].style.top = `${50 - 50 * head.y}%`;
    });
    this.dirty = false;
  }
}

// Lines a metre apart, in short pieces: some graphics drivers lose long lines that pass behind the view.
function grid(shade) {
  const points = [];
  for (let line = -GRID; line <= GRID; line++) {
    for (let from = -GRID; from < GRID; from += PIECE) {
      points.push(line, 0, from, line, 0, from + PIECE, from, 0, line, from + PIECE, 0, line);
    }
  }
  const shape = new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
  return new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ color: shade }));
}
