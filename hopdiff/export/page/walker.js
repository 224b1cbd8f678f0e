// One motion: its body, its way over the ground, and where both are at a time.

const SIDES = { left: "#0072B2", right: "#D55E00" };
// Those of left and right come last, so that few motions are never taken for sides.
const TINTS = ["#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6BB1", "#7F7F7F", "#0072B2", "#D55E00"];
const RUNG = 0.5; // m between the marks that pass below a body on the spot

// Colours are reckoned with in light, and shown as on the screen.
function colour(text) {
  return new THREE.Color(text).convertSRGBToLinear();
}

function turned(yaw, x, z) {
  return [x * Math.cos(yaw) + z * Math.sin(yaw), z * Math.cos(yaw) - x * Math.sin(yaw)];
}

function between(values, place) {
  const at = Math.min(Math.floor(place), values.length - 1);
  const next = Math.min(at + 1, values.length - 1);
  const share = place - at;
  const mixed = (a, b) => a + share * (b - a);
  return Array.isArray(values[at]) ? values[at].map((a, k) => mixed(a, values[next][k])) : mixed(values[at], values[next]);
}

class Walker {
  constructor(told, index) {
    this.told = told;
    this.tint = TINTS[index % TINTS.length];
    this.duration = (told.frames - 1) * told.frameTime;
    this.group = new THREE.Group(); // everything of this motion, in its lane
    this.body = new THREE.Group(); // on its lap
    this.laps = [-1, 0, 1].map(() => this.marks());
    this.lane = ladder(this.tint);
    this.group.add(this.body, this.lane, ...this.laps);
    for (const part of [this.body, ...this.laps]) part.matrixAutoUpdate = false;
    this.visible = true;
  }

  load() {
    const bytes = Uint8Array.from(atob(this.told.glb), (letter) => letter.charCodeAt(0));
    return new Promise((resolve, reject) => new THREE.GLTFLoader().parse(bytes.buffer, "", resolve, reject)).then((file) => {
      this.scene = file.scene;
      this.materials = new Set();
      this.scene.traverse((thing) => {
        if (!thing.isMesh) return;
        thing.frustumCulled = false;
        thing.castShadow = true;
        this.materials.add(thing.material);
      });
      for (const material of this.materials) material.userData.own = material.color.clone();
      // The loader takes some letters out of names; nodes come in the order of the joints.
      const bones = [];
      this.scene.traverse((thing) => { if (thing.isBone) bones.push(thing); });
      const plain = (name) => THREE.PropertyBinding.sanitizeNodeName(name);
      this.bones = this.told.joints.map((name) => bones.find((bone) => bone.name === plain(name)));
      this.mixer = new THREE.AnimationMixer(this.scene);
      this.action = this.mixer.clipAction(file.animations[0]);
      this.action.play();
      // Its time is set, never run: the page has one clock for all.
      this.action.paused = true;
      this.skeleton = new THREE.SkeletonHelper(this.scene);
      // Last, over all bodies.
      this.skeleton.material = new THREE.LineBasicMaterial({ depthTest: false, transparent: true });
      this.skeleton.renderOrder = 1;
      this.skeleton.visible = false;
      this.body.add(this.scene);
    });
  }

  // Path and footprints of one lap.
  marks() {
    const lap = new THREE.Group();
    const points = this.told.drawn.map(([x, z]) => new THREE.Vector3(x, 0.004, z));
    const pen = new THREE.LineBasicMaterial({ color: colour(this.tint), transparent: true, opacity: 0.7 });
    lap.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(points), pen));
    for (const step of this.told.steps) {
      // A loop ends with the step that it begins with.
      if (this.told.loop && step.frame === this.told.frames - 1) continue;
      const shade = new THREE.MeshBasicMaterial({ color: colour(SIDES[step.side]), transparent: true, opacity: 0.55, depthWrite: false });
      const print = new THREE.Mesh(new THREE.CircleGeometry(1, 24).rotateX(-Math.PI / 2), shade);
      print.scale.set(0.4 * step.size, 1, step.size);
      print.position.set(step.place[0], 0.005, step.place[1]);
      print.rotation.y = step.heading;
      lap.add(print);
    }
    return lap;
  }

  lapMatrix(lap) {
    const again = this.told.again;
    const once = new THREE.Matrix4().makeTranslation(again.to[0], 0, again.to[1])
      .multiply(new THREE.Matrix4().makeRotationY(again.yaw))
      .multiply(new THREE.Matrix4().makeTranslation(-again.from[0], 0, -again.from[1]));
    const found = new THREE.Matrix4();
    let power = lap > 0 ? once : once.invert();
    // By squares: a page may play for hours.
    for (let left = Math.abs(lap); left > 0; left = Math.floor(left / 2)) {
      if (left % 2) found.multiply(power);
      power = power.clone().multiply(power);
    }
    return found;
  }

  // The body at a time [s]. spot: whether it stays on the spot; at: [x, z] of its lane; moved: whether it starts there.
  pose(time, spot, at, moved) {
    const told = this.told;
    // The last frame of a lap counts as its own, not as the first of the next.
    this.lap = told.loop && this.duration > 0 ? Math.max(0, Math.ceil(time / this.duration - 1e-9) - 1) : 0;
    const own = Math.min(Math.max(time - this.lap * this.duration, 0), this.duration);
    this.frame = told.frames > 1 ? own / told.frameTime : 0;
    this.action.time = own;
    this.mixer.update(0);
    const whole = told.loop ? this.lapMatrix(this.lap) : new THREE.Matrix4();
    const way = between(told.way, this.frame);
    const heading = between(told.heading, this.frame);
    const start = told.way[0];
    this.heading = spot ? 0 : heading + (told.loop ? this.lap * told.again.yaw : 0);
    if (spot) {
      // Against its way, so that it stays where its lane is and faces as it began.
      const here = new THREE.Matrix4().makeTranslation(at[0], 0, at[1])
        .multiply(new THREE.Matrix4().makeRotationY(-heading))
        .multiply(new THREE.Matrix4().makeTranslation(-way[0], 0, -way[1]));
      this.body.matrix.copy(here);
      this.lane.position.set(at[0], 0.004, at[1]);
      this.lane.children[0].position.z = -(this.gone(time) % RUNG);
      this.centre = new THREE.Vector3(at[0], 0, at[1]);
    } else {
      const lane = new THREE.Matrix4().makeTranslation(moved ? at[0] - start[0] : 0, 0, moved ? at[1] - start[1] : 0);
      this.body.matrix.multiplyMatrices(lane, whole);
      this.laps.forEach((lap, k) => {
        lap.matrix.copy(lane);
        if (told.loop) lap.matrix.multiply(this.lapMatrix(this.lap + k - 1));
      });
      this.centre = new THREE.Vector3(way[0], 0, way[1]).applyMatrix4(this.body.matrix);
    }
    this.laps.forEach((lap, k) => { lap.visible = !spot && (told.loop ? this.lap + k > 0 : k === 1); });
    this.lane.visible = spot;
    this.group.visible = this.visible;
    this.skeleton.visible = this.visible && this.bared;
    for (const material of this.materials) {
      if (material.transparent !== this.bared) material.needsUpdate = true;
      Object.assign(material, { transparent: this.bared, opacity: this.bared ? 0.4 : 1 });
    }
    this.group.updateMatrixWorld(true);
  }

  // Metres gone until a time, along the way.
  gone(time) {
    if (!this.lengths) {
      this.lengths = [0];
      this.told.way.forEach((place, k, all) => {
        if (k) this.lengths.push(this.lengths[k - 1] + Math.hypot(place[0] - all[k - 1][0], place[1] - all[k - 1][1]));
      });
    }
    return this.lap * this.lengths[this.lengths.length - 1] + between(this.lengths, this.frame);
  }

  // Where joints are in the motion itself [m], whatever lane and lap the body is on.
  positions() {
    const back = this.scene.matrixWorld.clone().invert();
    const found = {};
    this.bones.forEach((bone, k) => {
      found[this.told.joints[k]] = new THREE.Vector3().setFromMatrixPosition(bone.matrixWorld).applyMatrix4(back).toArray();
    });
    return found;
  }

  paint(tinted) {
    for (const material of this.materials) {
      material.color.copy(tinted ? colour(this.tint) : material.userData.own);
    }
  }
}

// Marks that pass below a body on the spot, as those of a treadmill.
function ladder(tint) {
  const lane = new THREE.Group();
  const rungs = [];
  for (let z = -1.5 + RUNG; z <= 1.5 + 1e-9; z += RUNG) rungs.push(new THREE.Vector3(-0.35, 0, z), new THREE.Vector3(0.35, 0, z));
  const rails = [-0.35, 0.35].flatMap((x) => [new THREE.Vector3(x, 0, -1.5), new THREE.Vector3(x, 0, 1.5)]);
  for (const points of [rungs, rails]) {
    const line = new THREE.LineBasicMaterial({ color: colour(tint), transparent: true, opacity: 0.55 });
    lane.add(new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), line));
  }
  return lane;
}
