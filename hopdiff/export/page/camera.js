// A view that goes round a point: y stays up, and it never turns over.

const STEEPEST = 1.5; // rad above the ground
const NEAREST = 0.8; // m
const FARTHEST = 160;
const ROUND = 35; // degrees of the picture from below to above
const FLAT = 12; // and of rows, whose bodies are to be alike

class Orbit {
  constructor(canvas, changed) {
    this.yaw = 0.8; // rad from +z towards +x, of where the view is from
    this.pitch = 0.2; // rad above the ground
    this.distance = 4;
    this.back = 0; // m farther off than that, so that bodies which part stay in view
    this.point = new THREE.Vector3(0, 0.9, 0);
    this.shift = new THREE.Vector3(); // by which the user has moved the view
    this.camera = new THREE.PerspectiveCamera(ROUND, 1, 0.05, 300);
    this.changed = changed;
    this.held = new Map(); // pointers that are down
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.held.set(event.pointerId, { x: event.clientX, y: event.clientY, moves: event.button === 2 || event.shiftKey });
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      canvas.addEventListener(end, (event) => this.held.delete(event.pointerId));
    }
    canvas.addEventListener("pointermove", (event) => this.dragged(event, canvas.clientHeight));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * (event.deltaMode === 1 ? 0.03 : 0.0012)));
    }, { passive: false });
  }

  dragged(event, height) {
    const pointer = this.held.get(event.pointerId);
    if (!pointer) return;
    const x = event.clientX - pointer.x;
    const y = event.clientY - pointer.y;
    if (this.held.size === 2) {
      // Two fingers: apart or together is closer or farther, their middle moves the view.
      const other = [...this.held.values()].find((one) => one !== pointer);
      const before = Math.hypot(pointer.x - other.x, pointer.y - other.y);
      const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      if (before > 10 && after > 10) this.zoom(before / after);
      this.move(x / 2, y / 2, height);
    } else if (pointer.moves) {
      this.move(x, y, height);
    } else {
      this.yaw -= 0.008 * x;
      this.pitch = Math.min(STEEPEST, Math.max(-0.05, this.pitch + 0.008 * y));
      this.changed();
    }
    pointer.x = event.clientX;
    pointer.y = event.clientY;
  }

  move(x, y, height) {
    const metres = 2 * this.away * Math.tan(0.5 * THREE.MathUtils.degToRad(this.camera.fov)) / height;
    const axes = [0, 1].map((column) => new THREE.Vector3().setFromMatrixColumn(this.camera.matrix, column));
    this.shift.addScaledVector(axes[0], -x * metres).addScaledVector(axes[1], y * metres);
    this.changed();
  }

  get away() {
    return Math.min(FARTHEST, this.distance + this.back);
  }

  // Another angle of the picture [degrees].
  zoomed(angle) {
    this.camera.fov = angle;
    this.camera.updateProjectionMatrix();
  }

  zoom(factor) {
    this.distance = Math.min(FARTHEST, Math.max(NEAREST, this.distance * factor));
    this.changed();
  }

  from(yaw, pitch) {
    this.yaw = yaw;
    this.pitch = pitch;
    this.shift.set(0, 0, 0);
    this.changed();
  }

  place() {
    const flat = Math.cos(this.pitch);
    const towards = new THREE.Vector3(flat * Math.sin(this.yaw), Math.sin(this.pitch), flat * Math.cos(this.yaw));
    const target = this.point.clone().add(this.shift);
    this.camera.position.copy(target).addScaledVector(towards, this.away);
    // Never from below the ground.
    this.camera.position.y = Math.max(this.camera.position.y, 0.04);
    this.camera.lookAt(target);
    this.camera.updateMatrixWorld();
    return target;
  }
}
