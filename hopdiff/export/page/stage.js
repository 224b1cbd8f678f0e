// The ground, the light, and the picture of all bodies.

const GRID = 50; // m to every side
const PIECE = 2; // m

class Stage {
  constructor(canvas, walkers) {
    this.canvas = canvas;
    this.walkers = walkers;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.scene = new THREE.Scene();
    this.dirty = true;
    this.orbit = new Orbit(canvas, () => { this.dirty = true; });
    // What faces up gets all of its colour, and no more.
    this.sun = new THREE.DirectionalLight(0xffffff, 0.62);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    this.sun.shadow.radius = 4;
    this.sun.shadow.bias = -0.0005;
    this.sun.shadow.normalBias = 0.01;
    this.scene.add(this.sun, this.sun.target, new THREE.HemisphereLight(0xffffff, 0x9a9fa9, 0.5));
    // Behind what lies on it.
    const ground = new THREE.MeshLambertMaterial({ polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 });
    this.floor = new THREE.Mesh(new THREE.PlaneGeometry(400, 400).rotateX(-Math.PI / 2), ground);
    this.floor.receiveShadow = true;
    this.scene.add(this.floor);
    for (const walker of walkers) this.scene.add(walker.group, walker.skeleton);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.colours());
    new ResizeObserver(() => this.fit()).observe(canvas.parentElement);
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
    for (const walker of this.walkers) walker.skeleton.material.color = named("--ink");
    this.scene.add(this.grid);
    this.dirty = true;
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(width, height, false);
    this.orbit.camera.aspect = width / height;
    this.orbit.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  // As far off as shows a row of bodies this wide and this tall [m].
  distanceFor(wide, tall) {
    const half = Math.tan(0.5 * THREE.MathUtils.degToRad(this.orbit.camera.fov));
    return Math.max(0.62 * tall / half, 0.5 * wide / (half * this.orbit.camera.aspect)) + 0.5;
  }

  draw(names) {
    const target = this.orbit.place();
    // The ground has no end: its grid comes along by whole cells.
    this.grid.position.set(Math.round(target.x), 0.002, Math.round(target.z));
    this.floor.position.set(target.x, 0, target.z);
    const reach = Math.max(3, 0.6 * this.orbit.distance);
    this.sun.target.position.set(target.x, 0, target.z);
    this.sun.position.set(target.x + 4, 9, target.z + 3);
    const box = this.sun.shadow.camera;
    Object.assign(box, { left: -reach, right: reach, top: reach, bottom: -reach, near: 1, far: 30 });
    box.updateProjectionMatrix();
    this.scene.fog.near = 8 + 2 * this.orbit.distance;
    this.scene.fog.far = 30 + 5 * this.orbit.distance;
    this.renderer.render(this.scene, this.orbit.camera);
    this.walkers.forEach((walker, k) => {
      if (!names[k]) return;
      const head = walker.centre.clone().setY(walker.told.height + 0.18).project(this.orbit.camera);
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
