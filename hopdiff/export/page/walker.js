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

// Of numbers, `width` a frame: those at a place between frames.
function between(values, place, width = 1) {
  const last = values.length / width - 1;
  const at = Math.min(Math.floor(place), last);
  const next = Math.min(at + 1, last);
  const found = [];
  for (let k = 0; k < width; k++) {
    const a = values[at * width + k];
    found.push(a + (place - at) * (values[next * width + k] - a));
  }
  return found;
}

// Numbers that came as text.
function unpacked(text, Kind) {
  return new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
}

// A body as it came in the page.
function read(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Promise((resolve, reject) => new THREE.GLTFLoader().parse(bytes.buffer, "", resolve, reject));
}

// Another of the same body: joints and colours of its own, the mesh shared.
function twin(body, plain) {
  const copy = body.clone(true);
  const same = new Map();
  const pair = (a, b) => {
    same.set(a, b);
    a.children.forEach((child, k) => pair(child, b.children[k]));
  };
  pair(body, copy);
  let skeleton = null; // one for all parts of the mesh
  copy.traverse((thing) => {
    if (!thing.isSkinnedMesh) return;
    const { bones, boneInverses } = thing.skeleton;
    skeleton = skeleton || new THREE.Skeleton(bones.map((bone) => same.get(bone)), boneInverses);
    thing.bind(skeleton, thing.bindMatrix);
    const { color, name } = thing.material;
    thing.material = plain ? new THREE.MeshLambertMaterial({ color: color.clone(), name }) : thing.material.clone();
  });
  return copy;
}

class Walker {
  constructor(told, index) {
    this.told = told;
    this.tint = TINTS[index % TINTS.length];
    this.duration = (told.frames - 1) * told.frameTime;
    for (const name of ["root", "way", "heading"]) this[name] = unpacked(told[name], Float32Array);
    this.offsets = told.offsets && unpacked(told.offsets, Float32Array);
    this.turns = Float32Array.from(unpacked(told.turns, Int16Array)); // quaternions, of any length
    this.then = new THREE.Quaternion();
    this.start = [this.way[0], this.way[1]];
    this.group = new THREE.Group(); // everything of this motion, in its lane
    this.body = new THREE.Group(); // on its lap
    this.laps = [-1, 0, 1].map(() => this.marks());
    this.lane = ladder(this.tint);
    this.ring = ring();
    this.group.add(this.body, this.lane, this.ring, ...this.laps);
    for (const part of [this.body, ...this.laps]) part.matrixAutoUpdate = false;
    this.visible = true;
    this.marked = false;
  }

  // The body that moves. body: what was read of it; plain: whether it is lit by its corners alone.
  embody(body, plain) {
    this.scene = twin(body, plain);
    this.materials = [];
    this.scene.traverse((thing) => {
      if (!thing.isMesh) return;
      thing.frustumCulled = false;
      thing.castShadow = true;
      this.materials.push(thing.material);
    });
    for (const material of this.materials) material.userData.own = material.color.clone();
    // The loader takes some letters out of names.
    const bones = [];
    this.scene.traverse((thing) => { if (thing.isBone) bones.push(thing); });
    const letters = (name) => THREE.PropertyBinding.sanitizeNodeName(name);
    this.bones = this.told.joints.map((name) => bones.find((bone) => bone.name === letters(name)));
    this.skeleton = new THREE.SkeletonHelper(this.scene);
    // Last, over all bodies.
    this.skeleton.material = new THREE.LineBasicMaterial({ depthTest: false, transparent: true });
    this.skeleton.renderOrder = 1;
    this.skeleton.visible = false;
    this.body.add(this.scene);
  }

  // Joints at a frame, or between two.
  bend(place) {
    const last = this.told.frames - 1;
    const at = Math.min(Math.floor(place), last);
    const next = Math.min(at + 1, last);
    const count = this.bones.length;
    this.bones.forEach((bone, k) => {
      bone.quaternion.fromArray(this.turns, 4 * (at * count + k)).normalize();
      if (place > at) bone.quaternion.slerp(this.then.fromArray(this.turns, 4 * (next * count + k)).normalize(), place - at);
    });
    if (this.offsets) {
      const offsets = between(this.offsets, place, 3 * count);
      this.bones.forEach((bone, k) => bone.position.fromArray(offsets, 3 * k));
    }
    this.bones[0].position.fromArray(between(this.root, place, 3));
  }

  // Path and footprints of one lap.
  marks() {
    const lap = new THREE.Group();
    const points = [];
    for (let k = 0; k < this.told.frames; k += this.told.drawn) points.push(new THREE.Vector3(this.way[2 * k], 0.004, this.way[2 * k + 1]));
    points.push(new THREE.Vector3(this.way[this.way.length - 2], 0.004, this.way[this.way.length - 1]));
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
    this.bend(this.frame);
    const whole = told.loop ? this.lapMatrix(this.lap) : new THREE.Matrix4();
    const way = between(this.way, this.frame, 2);
    const [heading] = between(this.heading, this.frame);
    const start = this.start;
    this.faces = spot ? 0 : heading + (told.loop ? this.lap * told.again.yaw : 0);
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
    this.lane.visible = spot && !this.bare;
    this.ring.visible = this.marked;
    this.ring.position.set(this.centre.x, 0.006, this.centre.z);
    this.group.visible = this.visible;
    this.skeleton.visible = this.visible && this.bared;
    for (const material of this.materials) {
      if (material.transparent === this.bared) continue;
      material.needsUpdate = true;
      Object.assign(material, { transparent: this.bared, opacity: this.bared ? 0.4 : 1 });
    }
    this.group.updateMatrixWorld(true);
  }

  // Metres gone until a time, along the way.
  gone(time) {
    if (!this.lengths) {
      this.lengths = [0];
      for (let k = 2; k < this.way.length; k += 2) {
        const step = Math.hypot(this.way[k] - this.way[k - 2], this.way[k + 1] - this.way[k - 1]);
        this.lengths.push(this.lengths[this.lengths.length - 1] + step);
      }
    }
    return this.lap * this.lengths[this.lengths.length - 1] + between(this.lengths, this.frame)[0];
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

// Around the feet of a body that is marked.
function ring() {
  const shade = new THREE.MeshBasicMaterial({ color: colour("#E69F00"), transparent: true, opacity: 0.9, depthWrite: false });
  const found = new THREE.Mesh(new THREE.RingGeometry(0.5, 0.6, 48).rotateX(-Math.PI / 2), shade);
  found.visible = false;
  return found;
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
