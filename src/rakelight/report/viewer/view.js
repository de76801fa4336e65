// Where things are on the screen.  Camera frame: x right, y down, z forward, metres.  The first
// view is the colour camera's own; turning is about the object's middle, zooming enlarges the
// picture as a longer lens does.

const RADIAN = Math.PI / 180;

class View {
  constructor(camera, depth) {
    this.camera = camera;
    const known = depth.filter((z) => !Number.isNaN(z)).sort();
    const z = known[known.length >> 1];
    const u = (camera.width - 1) / 2, v = (camera.height - 1) / 2;
    this.pivot = this.point(u, v, z);
    const corner = this.point(0, 0, z);
    const radius = Math.hypot(...corner.map((x, k) => x - this.pivot[k]))
      + known[known.length - 1] - known[0];
    this.range = [Math.max(z / 100, z - 1.5 * radius), z + 1.5 * radius];
    this.reset();
    this.resize(1, 1);
  }

  reset() {
    Object.assign(this, { yaw: 0, pitch: 0, zoom: 1, panX: 0, panY: 0 });
  }

  resize(width, height) {
    const { width: w, height: h, fx, fy } = this.camera;
    const fit = 0.94 * Math.min(width / w, height / ((h * fx) / fy));
    const ratio = this.fit ? fit / this.fit : 1;  // what is in the middle stays there
    Object.assign(this, { width, height, fit, panX: ratio * this.panX, panY: ratio * this.panY });
  }

  // Metres of the pixel (u, v) at depth z.
  point(u, v, z) {
    const { fx, fy, cx, cy } = this.camera;
    return [((u - cx) / fx) * z, ((v - cy) / fy) * z, z];
  }

  // Rows of the rotation: right by yaw, then up by pitch, degrees.
  get turn() {
    const [a, b] = [this.yaw * RADIAN, this.pitch * RADIAN];
    const [ca, sa, cb, sb] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b)];
    return [[ca, 0, -sa], [sa * sb, cb, ca * sb], [sa * cb, -sb, ca * cb]];
  }

  turned(p) {
    const q = p.map((x, k) => x - this.pivot[k]);
    return this.turn.map((row, k) => row[0] * q[0] + row[1] * q[1] + row[2] * q[2] + this.pivot[k]);
  }

  // Scale of the screen per focal length, and the offset of its middle, for the vertex shader.
  get frame() {
    const [x, y, z] = this.pivot, f = this.camera.fx, scale = this.fit * this.zoom;
    return [
      (2 * scale) / this.width, (2 * scale) / this.height,
      (f * x) / z - this.panX / scale, (f * y) / z - this.panY / scale,
    ];
  }

  // Screen pixels (x right, y down, from the upper left corner) of a point in metres.
  project(p) {
    const [x, y, z] = this.turned(p), [sx, sy, cx, cy] = this.frame, f = this.camera.fx;
    return [
      (this.width / 2) * (1 + sx * ((f * x) / z - cx)),
      (this.height / 2) * (1 + sy * ((f * y) / z - cy)),
    ];
  }

  turnBy(yaw, pitch) {
    const limit = (angle) => Math.max(-85, Math.min(85, angle));
    this.yaw = limit(this.yaw + yaw);
    this.pitch = limit(this.pitch + pitch);
  }

  // Enlarge by a factor about the screen's point (x, y).
  zoomBy(factor, x = this.width / 2, y = this.height / 2) {
    const zoom = Math.max(0.5, Math.min(24, this.zoom * factor));
    const ratio = zoom / this.zoom;
    this.panX += (1 - ratio) * (x - this.width / 2 - this.panX);
    this.panY += (1 - ratio) * (y - this.height / 2 - this.panY);
    this.zoom = zoom;
  }

  panBy(x, y) {
    this.panX += x;
    this.panY += y;
  }
}
